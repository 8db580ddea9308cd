"""A log that cannot be what the recipe says is refused in one sentence that says why."""

import subprocess
import sys

import numpy as np
import pytest
from logs import JOINTS, RATE_HZ, chirps, columns_of, read, write_csv

from assetbuild.errors import StepError
from assetbuild.identify import table
from assetbuild.identify.fit_logs import read_records
from assetbuild.robot.identify import Columns


@pytest.fixture
def good():
    """A position that follows its command a little late."""
    target = chirps(6.0)
    return columns_of(target, 0.95 * np.roll(target, 2, axis=0))


def refused(tmp_path, columns, **keys):
    with pytest.raises(StepError) as error:
        read(tmp_path, columns, **keys)
    assert error.value.message.startswith("log.csv") and error.value.hint
    return str(error.value)


def test_a_good_log_is_one_record(tmp_path, good):
    findings, _ = read(tmp_path, good)
    (record,) = read_records(tmp_path / "out/record.npz")
    assert not findings
    assert record.period_s == pytest.approx(1 / RATE_HZ)
    assert record.position[:, 0] == pytest.approx(good["position_shoulder"], abs=1e-6)


def test_degrees_are_converted_when_they_are_stated(tmp_path, good):
    degrees = {k: v if k == "time" else np.degrees(v) for k, v in good.items()}
    _, record = read(tmp_path, degrees, angle_unit="deg")
    assert record["target_0"][:, 1] == pytest.approx(good["target_elbow"], abs=1e-5)


def all_but_time(log, change):
    return {name: v if name == "time" else change(v) for name, v in log.items()}


def with_elbow(log, change):
    return log | {"position_elbow": change(log["position_elbow"])}


def beyond_its_limits(log):
    both = ("position_elbow", "target_elbow")
    return {name: v * 0.2 - 2.4 if name in both else v for name, v in log.items()}


def swapped(log):
    elbow, shoulder = log["position_elbow"], log["position_shoulder"]
    return log | {"position_elbow": shoulder, "position_shoulder": elbow}


def with_clock(log, change):
    return log | {"time": change(log["time"], np.arange(len(log["time"])))}


def of_another_robot(log):
    return {name.replace("shoulder", "hip"): values for name, values in log.items()}


def without_half_of_its_rows(log):
    keep = np.flatnonzero(np.arange(len(log["time"])) % 50 < 25)
    return {name: values[keep] for name, values in log.items()}


EXCHANGED = {
    f"{a}_{joint}": f"{b}_{joint}"
    for joint in JOINTS
    for a, b in (("position", "target"), ("target", "position"))
}
# What has become of a good log | words of the error.
SPOILED = {
    "degrees that nobody stated": (
        lambda log: all_but_time(log, np.degrees), "angle_unit: deg"),
    "ticks that nobody stated": (
        lambda log: all_but_time(log, lambda v: 2048 + v * 4096 / 6.283), "ticks of one turn"),
    "a wrong sign": (
        lambda log: with_elbow(log, lambda q: -q), "`elbow` moves against its command"),
    "beyond the limits": (beyond_its_limits, "outside of its limits"),
    "swapped columns": (swapped, "two columns are swapped"),
    "position and command exchanged": (
        lambda log: {name: log[EXCHANGED.get(name, name)] for name in log},
        "the columns of position and command are exchanged"),
    "a joint that never moves": (
        lambda log: with_elbow(log, lambda q: 0 * q + 0.3), "`elbow` never moves"),
    "a number that is none": (
        lambda log: with_elbow(log, lambda q: np.where(np.arange(len(q)) == 700, np.nan, q)),
        "`position_elbow` is not a number in row 701"),
    "a clock that goes back": (
        lambda log: with_clock(log, lambda t, row: t - (row >= 800)), "the time goes back by"),
    "milliseconds that nobody stated": (
        lambda log: with_clock(log, lambda t, _: 1000.0 * t), "check `time_unit`"),
    "a file of another robot": (of_another_robot, "has no column `position_shoulder`"),
    "a second of it": (
        lambda log: {name: values[: int(RATE_HZ)] for name, values in log.items()},
        "at least 2 s are used"),
    "many dropped samples": (without_half_of_its_rows, "samples are missing"),
}  # fmt: skip


@pytest.mark.parametrize("case", SPOILED)
def test_a_log_that_cannot_be_what_the_recipe_says_is_refused(case, tmp_path, good):
    spoil, words = SPOILED[case]
    assert words in refused(tmp_path, spoil(good))


def test_a_few_dropped_samples_cut_the_log_in_two(tmp_path, good):
    cut = {name: np.delete(values, np.s_[740:790]) for name, values in good.items()}
    findings, _ = read(tmp_path, cut)
    assert [finding.rule for finding in findings] == ["identify.dropped"]
    assert len(read_records(tmp_path / "out/record.npz")) == 2


def test_a_log_without_end_is_refused_after_so_many_rows(tmp_path, good, monkeypatch):
    monkeypatch.setattr(table, "MOST_ROWS", 1000)
    monkeypatch.setattr(table, "BLOCK", 20_000)
    assert "more than 1,000 rows" in refused(tmp_path, good)


def test_an_interval_is_all_that_is_read(tmp_path, good):
    good["position_elbow"][0] = np.nan
    _, record = read(tmp_path, good, interval=(1.0, 4.0))
    assert len(record["position_0"]) == pytest.approx(3 * RATE_HZ, abs=1)


def test_an_episode_of_what_has_none_is_refused(tmp_path, good):
    assert "only a Parquet file has an `episode`" in refused(tmp_path, good, episode=3)


def test_two_joints_need_two_columns(tmp_path, good):
    with pytest.raises(StepError, match="would be read for several joints"):
        read(tmp_path, good, columns=Columns(position="position_shoulder"))


def test_a_file_without_lines_is_not_read_to_its_end(tmp_path, good, monkeypatch):
    monkeypatch.setattr(table, "BLOCK", 20_000)
    write_csv(tmp_path / "log", good)
    head = (tmp_path / "log").read_bytes().partition(b"\n")[0]
    (tmp_path / "log").write_bytes(head + b"\n" + b"0" * 100_000)
    columns = [name for name in good if "elbow" in name]
    with pytest.raises(StepError, match="a line of more than 20,000 characters"):
        table.read_columns(tmp_path / "log", "log.csv", ["time", *columns], None, 1.0)


@pytest.mark.slow
def test_the_memory_that_a_large_log_takes_does_not_grow_with_the_file(tmp_path, good):
    """60 MB, of which the last seconds are used: 40 MB more at most than 6 s of it alone."""
    text = write_csv(tmp_path / "part", good).read_text()
    head, _, body = text.partition("\n")
    with (tmp_path / "large").open("w") as file:
        file.write(f"{head}\n")
        for _ in range(60_000_000 // len(body)):
            file.write(body)
        end = "\n".join(f"{1e4 + n / 250:.4f},0,0,0,0" for n in range(1000))
        file.write(f"{end}\n")
    lines = (
        "import resource, sys; from pathlib import Path\n"
        "from assetbuild.identify.table import read_columns\n"
        f"names = {list(good)!r}\n"
        "rows = read_columns(Path(sys.argv[1]), 'log.csv', names, (float(sys.argv[2]), 1e9), 1.0)\n"
        "print(len(rows), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    found = {}
    for name, begin in (("part", 0.0), ("large", 1e4)):
        done = subprocess.run(
            [sys.executable, "-c", lines, str(tmp_path / name), str(begin)],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        found[name] = [int(word) for word in done.stdout.split()]
    assert found["large"][0] == 1000
    assert found["large"][1] - found["part"][1] < 40_000  # kB
