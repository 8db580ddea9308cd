"""Where a robot may come from, as far as `check` looks: every kind gives the same links."""

from __future__ import annotations

import hashlib
import io
import subprocess
import tarfile
import threading
import zipfile
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from assetbuild.cli.check import check
from assetbuild.errors import (
    AssetBuildError,
    LockError,
    OutOfDateError,
    RecipeError,
    SourceError,
)
from assetbuild.findings import Finding
from assetbuild.lock import lock_path, read_lock
from assetbuild.pipeline.opening import opened, pin
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.source.plan import argument_text

URDF = """<robot name="r">
  <link name="base"><inertial><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tip"><inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j" type="continuous"><parent link="base"/><child link="tip"/></joint>
</robot>
"""
XACRO = """<robot name="r" xmlns:xacro="http://wiki.ros.org/xacro">
  <xacro:arg name="mass" default="0"/>
  <xacro:include filename="$(find arm)/parts/tip.xacro"/>
  <link name="base"/>
  <joint name="j" type="continuous"><parent link="base"/><child link="tip"/></joint>
</robot>
"""
TIP = """<robot xmlns:xacro="http://wiki.ros.org/xacro">
  <link name="tip"><inertial><mass value="$(arg mass)"/>
    <inertia ixx="0.1" iyy="0.1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
"""


@pytest.fixture(autouse=True)
def own_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "store"))


def recipe(folder: Path, source: str) -> Path:
    path = folder / "r.yaml"
    path.write_text(f"schema: assetbuild/v1\nrobot: r\nsource: {{{source}, license: MIT}}\n")
    return path


def rules(findings) -> set[str]:
    """What the planted defect (izz > ixx + iyy on `tip`) is told as."""
    return {f"{f.rule} {f.subject}" for f in findings if f.rule.startswith("inertia")}


def test_a_xacro_is_expanded_and_its_lines_are_those_of_the_urdf(tmp_path):
    robot = tmp_path / "robot"
    (robot / "parts").mkdir(parents=True)
    (robot / "r.xacro").write_text(XACRO)
    (robot / "parts/tip.xacro").write_text(TIP)
    source = "path: robot, xacro: r.xacro, args: {mass: 1.5}, packages: {arm: .}"
    findings = check(recipe(tmp_path, source))
    assert "inertia.triangle link tip" in rules(findings)
    (tip,) = {f.where for f in findings if f.rule == "inertia.triangle"}
    assert tip.startswith("r.xacro (expanded):")


def test_a_xacro_may_not_look_beside_its_packages(tmp_path):
    robot = tmp_path / "robot"
    (robot / "xacro").mkdir(parents=True)
    (robot / "other").mkdir()
    (robot / "other/tip.xacro").write_text(TIP)
    (robot / "xacro/r.xacro").write_text(XACRO.replace("$(find arm)/parts", "../other"))
    source = "path: robot, xacro: xacro/r.xacro"
    with pytest.raises(SourceError, match=r"no file `other/tip\.xacro`") as caught:
        check(recipe(tmp_path, source))
    assert "source.packages" in caught.value.hint


def test_arguments_need_a_xacro(tmp_path):
    with pytest.raises(RecipeError, match="`args` are for a `xacro`"):
        check(recipe(tmp_path, "path: robot, urdf: r.urdf, args: {a: 1}"))


def test_an_argument_of_any_kind_reaches_xacro_as_text(tmp_path):
    loaded = load_recipe(
        recipe(tmp_path, "path: robot, xacro: r.xacro, args: {a: true, b: 1, c: 0.5, d: ur10e}")
    )
    texts = [argument_text(value) for value in loaded.recipe.source.args.values()]
    assert texts == ["true", "1", "0.5", "ur10e"]


# --- archives -------------------------------------------------------------------------------


def packed(path: Path, files: dict[str, str]) -> Path:
    """A zip or tar, by the suffix."""
    if path.suffix == ".zip":
        with zipfile.ZipFile(path, "w") as archive:
            for name, text in files.items():
                archive.writestr(name, text)
        return path
    with tarfile.open(path, f"w:{path.suffix[1:]}" if path.suffix != ".tar" else "w") as tar:
        for name, text in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(text)
            tar.addfile(info, io.BytesIO(text.encode()))
    return path


@pytest.mark.parametrize("name", ["r.zip", "r.tar", "r.tar.gz", "r.tar.xz", "r.tar.bz2"])
def test_an_archive_is_read_without_unpacking_it_by_hand(tmp_path, name):
    packed(tmp_path / name, {"./top/r.urdf": URDF} if ".tar" in name else {"top/r.urdf": URDF})
    findings = check(recipe(tmp_path, f"path: {name}, root: top, urdf: r.urdf"))
    assert "inertia.triangle link tip" in rules(findings)


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE])
def test_a_tar_member_that_is_no_file_is_refused(tmp_path, kind):
    packed(tmp_path / "r.tar", {"good.urdf": URDF})
    with tarfile.open(tmp_path / "r.tar", "a") as tar:
        info = tarfile.TarInfo("r.urdf")
        info.type, info.linkname = kind, "/etc/hostname"
        tar.addfile(info)
    with pytest.raises(SourceError, match=r"symbolic link|not a regular file"):
        check(recipe(tmp_path, "path: r.tar, urdf: r.urdf"))
    assert check(recipe(tmp_path, "path: r.tar, urdf: good.urdf")), "nobody asks for the other"


@pytest.mark.parametrize(
    ("name", "files", "message"),
    [
        ("r.tar", {"../../r.urdf": URDF, "r.urdf": URDF}, "leads outside"),
        ("r.tar.xz", {"r.urdf": " " * (64 << 20)}, "would unpack to"),
    ],
    ids=["climbs out", "bomb"],
)
def test_a_hostile_tar_is_refused_before_it_is_unpacked(tmp_path, name, files, message):
    packed(tmp_path / name, files)
    with pytest.raises(SourceError, match=message):
        check(recipe(tmp_path, f"path: {name}, urdf: r.urdf"))
    assert not (tmp_path.parent / "r.urdf").exists()


# --- git and the web ------------------------------------------------------------------------


def git(folder: Path, *words: str) -> str:
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "init.defaultBranch=main"]
    command = ["git", "-C", str(folder), *who, *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    folder = tmp_path / "repo"
    folder.mkdir()
    git(folder, "init", "-q")
    (folder / "r.urdf").write_text(URDF)
    (folder / "LICENSE").write_text("MIT")
    git(folder, "add", ".")
    git(folder, "commit", "-qm", "one")
    git(folder, "tag", "-a", "v1", "-m", "v1")
    return folder


def fetched(path: Path) -> list[Finding]:
    """What is said of a robot whose source a build has pinned and brought here."""
    loaded = load_recipe(path)
    pin(loaded, frozen=False, say=lambda _: None)
    with opened(loaded) as build:
        build.made(build.plan)
    return check(path)


@pytest.mark.parametrize("rev", ["v1", "main"])
def test_a_repository_is_pinned_to_its_commit(tmp_path, repository, rev):
    path = recipe(tmp_path, f"git: repo, rev: {rev}, urdf: r.urdf")
    assert "inertia.triangle link tip" in rules(fetched(path))
    lock = read_lock(lock_path(path))
    assert lock.source.commit == git(repository, "rev-parse", "HEAD")
    first = lock_path(path).read_bytes()
    (repository / "r.urdf").write_text("<robot/>")
    git(repository, "commit", "-qam", "two")
    assert fetched(path)  # the pinned commit, though the branch went on
    assert lock_path(path).read_bytes() == first


def test_other_content_than_the_lock_pins_is_refused(tmp_path, repository):
    path = recipe(tmp_path, "git: repo, rev: v1, urdf: r.urdf")
    fetched(path)
    lock = lock_path(path)
    lock.write_text(lock.read_text().replace(read_lock(lock).source.sha256, "0" * 64))
    with pytest.raises(LockError, match="the lock pins 000"):
        fetched(path)


def test_frozen_does_not_resolve_and_an_unknown_rev_names_the_known(tmp_path, repository):
    loaded = load_recipe(recipe(tmp_path, "git: repo, rev: v2, urdf: r.urdf"))
    with pytest.raises(OutOfDateError, match="no lock"):
        pin(loaded, frozen=True, say=print)
    with pytest.raises(SourceError, match="no branch or tag `v2`") as caught:
        pin(loaded, frozen=False, say=lambda _: None)
    assert "v1" in caught.value.hint


def test_no_hook_of_the_repository_or_the_user_runs(tmp_path, repository, monkeypatch):
    canary = tmp_path / "ran"
    hooks = tmp_path / "hooks"
    hooks.mkdir()
    for name in ("post-checkout", "reference-transaction", "post-receive", "pre-auto-gc"):
        for folder in (hooks, repository / ".git/hooks"):
            hook = folder / name
            hook.write_text(f"#!/bin/sh\ntouch {canary}\n")
            hook.chmod(0o755)
    monkeypatch.setenv("GIT_CONFIG_COUNT", "1")
    monkeypatch.setenv("GIT_CONFIG_KEY_0", "core.hooksPath")
    monkeypatch.setenv("GIT_CONFIG_VALUE_0", str(hooks))
    assert fetched(recipe(tmp_path, "git: repo, rev: v1, urdf: r.urdf"))
    assert not canary.exists()


@pytest.mark.parametrize(
    "source",
    [
        "git: 'file:///repo', rev: v1",
        "git: 'ext::sh -c true', rev: v1",
        "git: '--upload-pack=touch', rev: v1",
        "git: 'https://user:password@example.org/r', rev: v1",
        "git: repo, rev: '--output=x'",
        "git: repo",
        "url: 'file:///etc/hostname', sha256: '" + "0" * 64 + "'",
        "url: 'https://user:password@example.org/r.zip', sha256: '" + "0" * 64 + "'",
        "url: 'https://example.org/r.zip'",
    ],
)
def test_an_address_that_is_none_is_refused_by_the_recipe(tmp_path, source):
    with pytest.raises(RecipeError):
        load_recipe(recipe(tmp_path, f"{source}, urdf: r.urdf"))


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def do_GET(self) -> None:
        if self.path == "/away.zip":
            self.send_response(302)
            self.send_header("Location", "ftp://127.0.0.1/r.zip")
            self.end_headers()
        else:
            super().do_GET()


@pytest.fixture
def server(tmp_path: Path):
    folder = tmp_path / "www"
    folder.mkdir()
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder))) as http:
        threading.Thread(target=http.serve_forever, daemon=True).start()
        yield folder, f"http://127.0.0.1:{http.server_port}"
        http.shutdown()


def test_a_file_from_the_web_must_have_its_digest(tmp_path, server):
    folder, address = server
    archive = packed(folder / "r.zip", {"r.urdf": URDF})
    digest = hashlib.sha256(archive.read_bytes()).hexdigest()
    good = f"url: '{address}/r.zip', sha256: '{digest}', urdf: r.urdf"
    assert "inertia.triangle link tip" in rules(fetched(recipe(tmp_path, good)))
    assert not lock_path(tmp_path / "r.yaml").exists()

    other = good.replace(digest, "1" * 64)
    for name, message in (
        ("r.zip", f"sha256 is {digest}"),
        ("gone.zip", "404"),
        ("away.zip", "sends us on to"),
    ):
        with pytest.raises(AssetBuildError, match=message):
            fetched(recipe(tmp_path, other.replace("r.zip", name)))
