"""What is no plain file where a file is asked for, a disk that is really full, another user's
machine: refused in a sentence, or the same bundle.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tiny import stl

from .conftest import Place, new_legs

pytestmark = pytest.mark.slow

NOBODY = 65534
MESH = stl(np.eye(3)[None])
MOTORS = "m: {effort: 10, velocity: 20}\n"
ODD: dict[str, Callable[[Path], object]] = {
    "a pipe": os.mkfifo,
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link to nothing": lambda path: path.symlink_to("nowhere"),
    "a folder": Path.mkdir,
    "a device": lambda path: path.symlink_to("/dev/zero"),
}
LIMIT_S = 20.0
"""For a refusal on a busy machine; a build that waits for a pipe or reads a device never ends."""


@pytest.fixture
def whole(warm_legs: Place) -> Place:
    """A recipe that names a file in every way it can."""
    legs = warm_legs
    (legs.robot / "foot.stl").write_bytes(MESH)
    (legs.folder / "motors.yaml").write_text(MOTORS)
    text = legs.urdf.read_text()
    visual = '<visual><geometry><mesh filename="foot.stl"/></geometry></visual>'
    legs.urdf.write_text(text.replace("<collision>", f"{visual}<collision>", 1))
    legs.recipe.write_text(f"{legs.recipe.read_text()}motor_file: motors.yaml\n")
    return legs


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("robot/four_legs.urdf", "a pipe"),
        ("robot/four_legs.urdf", "a folder"),
        ("robot/four_legs.urdf", "a link to nothing"),
        ("legs.yaml", "a pipe"),
        ("motors.yaml", "a device"),
        ("robot/foot.stl", "a link to itself"),
    ],
)
def test_what_is_no_file_is_refused_in_seconds(whole: Place, name: str, kind: str):
    path = whole.folder / name
    path.unlink()
    ODD[kind](path)
    began = time.monotonic()
    assert path.name in whole.refused("build", whole.name)
    assert time.monotonic() - began < LIMIT_S
    assert not whole.bundle.exists()


def test_names_that_are_no_text_lie_in_the_source_unharmed(whole: Place):
    strange = os.fsencode(whole.robot) + b"/\xff\xfe.stl"
    with open(strange, "wb") as file:  # noqa: PTH123 - the name is bytes
        file.write(MESH)
    done = whole.build()
    assert done.returncode == 0, done.stderr


def built(legs: Place, **options: object) -> bytes:
    """The manifest that a process with these options of `subprocess` builds."""
    done = subprocess.run(
        legs.command("build", "legs.yaml"),
        cwd=legs.folder,
        env=legs.env(HOME=str(legs.folder), TZ="Asia/Tokyo"),
        capture_output=True,
        timeout=300,
        **options,  # type: ignore[call-overload]  # keyword arguments of subprocess
    )
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    return legs.manifest()


def test_a_robot_in_a_folder_whose_name_is_no_text(tmp_path: Path, built_legs: Place):
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9 \xff"))
    assert built(new_legs(folder, tmp_path / "store")) == built_legs.manifest()


def test_a_private_umask_and_files_in_another_order_with_other_dates(
    legs: Place, built_legs: Place
):
    for path in (legs.urdf, legs.recipe):  # the other way round, and long ago
        text = path.read_bytes()
        path.unlink()
        path.write_bytes(text)
        os.utime(path, (1e9, 1e9))
    assert built(legs, umask=0o077) == built_legs.manifest()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can build as another user")
def test_another_user(tmp_path: Path, built_legs: Place):
    legs = new_legs(tmp_path / "legs")
    for path in (tmp_path, *tmp_path.rglob("*")):
        os.chown(path, NOBODY, NOBODY)
    for parent in tmp_path.parents:
        if not parent.stat().st_mode & 0o001:
            pytest.skip(f"another user cannot reach {parent}")
    assert built(legs, user=NOBODY, group=NOBODY) == built_legs.manifest()


def test_a_clock_a_year_on_changes_no_byte(tmp_path: Path, built_legs: Place):
    """Every Python of the build believes that it is another year."""
    shift = tmp_path / "shift"
    shift.mkdir()
    (shift / "sitecustomize.py").write_text(
        "import time\n"
        "_s, _ns, _l, _g = time.time, time.time_ns, time.localtime, time.gmtime\n"
        "YEAR = 366 * 86400\n"
        "time.time = lambda: _s() + YEAR\n"
        "time.time_ns = lambda: _ns() + YEAR * 10**9\n"
        "time.localtime = lambda s=None: _l(_s() + YEAR if s is None else s)\n"
        "time.gmtime = lambda s=None: _g(_s() + YEAR if s is None else s)\n"
    )
    later = new_legs(tmp_path / "later")
    path = os.pathsep.join([str(shift), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    done = later.build(PYTHONPATH=path)
    assert done.returncode == 0, done.stderr
    assert later.manifest() == built_legs.manifest()


SMALL_DISK = 'mount -t tmpfs -o size={size}k none "$1" && cd "$2" && shift 2 && exec "$@"'


def _can_mount(folder: Path) -> bool:
    if shutil.which("unshare") is None:
        return False
    tried = ["unshare", "-Urm", "mount", "-t", "tmpfs", "none", str(folder)]
    return subprocess.run(tried, capture_output=True).returncode == 0


@pytest.mark.parametrize(
    ("kilobytes", "what"), [(16, "the store"), (96, "the store"), (16, "the bundle")]
)
def test_a_small_disk_that_fills_up_is_one_error(
    warm_legs: Place, tmp_path: Path, kilobytes: int, what: str
):
    """In a mount namespace of its own. Below the bundle, another store would not help."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if not _can_mount(disk):
        pytest.skip("no disk can be mounted here without being root")
    words = ["sh", "-c", SMALL_DISK.format(size=kilobytes), "sh", str(disk), str(warm_legs.folder)]
    command = warm_legs.command("build", "legs.yaml")
    env = warm_legs.env(ASSETBUILD_CACHE=str(disk / "store"))
    if what == "the bundle":
        command, env = [*command, "-o", str(disk / "bundle")], warm_legs.env()
    done = subprocess.run(
        ["unshare", "-Urm", *words, *command], env=env, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 1, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert "o space left" in done.stderr
    if what == "the bundle":
        assert f"no space left on the disk that holds {disk}" in done.stderr
        assert "choose another folder with `-o`" in done.stderr
        assert "ASSETBUILD_CACHE" not in done.stderr
    assert not warm_legs.bundle.exists()
    assert warm_legs.build().returncode == 0
