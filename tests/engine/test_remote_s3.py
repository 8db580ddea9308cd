"""The shared cache in a bucket, on moto's server: another implementation of S3's protocol."""

from __future__ import annotations

import pytest
from builds_for_tests import Machine, assert_second_machine_builds_nothing
from servers_for_tests import serving

from assetbuild.engine.share.remote import Budget

pytest.importorskip("obstore", reason="needs assetbuild[remote]")
QUICK = Budget(request_s=0.5, lost_s=1.0, object_bytes=1 << 20)
URL = "s3://assets/some/prefix"


@pytest.fixture(scope="module")
def endpoint():
    server = pytest.importorskip("moto.server", reason="needs moto[server,s3]")
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    running.start()
    host, port = running.get_host_and_port()
    yield f"http://{host}:{port}"
    running.stop()


@pytest.fixture
def bucket(endpoint: str, monkeypatch: pytest.MonkeyPatch):
    """A fresh bucket `assets` and the variables that lead there."""
    boto3 = pytest.importorskip("boto3")
    use(endpoint, monkeypatch)
    client = boto3.client("s3", endpoint_url=endpoint)
    client.create_bucket(Bucket="assets")
    yield client
    for row in client.list_objects_v2(Bucket="assets").get("Contents", []):
        client.delete_object(Bucket="assets", Key=row["Key"])
    client.delete_bucket(Bucket="assets")


def use(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (
        ("AWS_ENDPOINT_URL", endpoint),
        ("AWS_ACCESS_KEY_ID", "it"),
        ("AWS_SECRET_ACCESS_KEY", "secret"),
        ("AWS_DEFAULT_REGION", "us-east-1"),
    ):
        monkeypatch.setenv(name, value)


def names(bucket) -> set[str]:
    return {row["Key"] for row in bucket.list_objects_v2(Bucket="assets").get("Contents", [])}


def test_the_second_machine_builds_nothing(tmp_path, robot, bucket):
    assert_second_machine_builds_nothing(tmp_path, robot, URL)
    folders = {name.rsplit("/", 1)[0] for name in names(bucket)}
    assert folders == {"some/prefix/ac", "some/prefix/cas"}


def test_what_the_bucket_has_removed_is_a_miss(tmp_path, robot, bucket):
    """Buckets may expire old objects. Corrupt objects are tested with all servers."""
    gold = Machine(tmp_path / "a", URL, write=True).build(robot)
    for name in names(bucket):
        if "/cas/" in name:
            bucket.delete_object(Bucket="assets", Key=name)
    second = Machine(tmp_path / "b", URL)
    results = second.build(robot)
    assert [r.outputs for r in results.values()] == [r.outputs for r in gold.values()]
    assert second.warnings == []


def test_a_large_object_comes_in_parts(tmp_path, bucket):
    from urllib.parse import urlsplit

    from assetbuild.engine.share.remote_s3 import PART, S3Place

    source, dest = tmp_path / "large", tmp_path / "came"
    source.write_bytes(bytes(range(256)) * (7 * PART // 256) + b"end")
    place = S3Place(urlsplit(URL), 10.0)
    place.put("cas/large", source)
    assert place.save("cas/large", source.stat().st_size, dest)
    assert dest.read_bytes() == source.read_bytes()


@pytest.mark.parametrize("fault", ["500", "slow_headers", "nobody"])
def test_an_endpoint_that_misbehaves_costs_a_bounded_time(tmp_path, robot, monkeypatch, fault):
    with serving() as server:
        use("http://127.0.0.1:9" if fault == "nobody" else server.url, monkeypatch)
        server.fault = fault
        machine = Machine(tmp_path / "a", URL, budget=QUICK)
        assert [r.status for r in machine.build(robot).values()] == ["ran"] * 3
        assert machine.seconds < 30
    if fault == "nobody":
        assert len(machine.warnings) == 1
        assert "\n" not in machine.warnings[0]
