"""A module is executed with stand-ins: what it says is recorded, what it may not do refused."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from assetbuild.errors import UsageError
from assetbuild.facts import standins
from assetbuild.facts.standins import recorded

SAID = """
from pathlib import Path
from trainer.deep import Robot, task
from trainer import decorated
XML = str(Path(__file__).parent.parent / "mjcf/a.xml")
@decorated
class Events:
    push = Robot.Event(force=(1, 2), of={"leg": XML})
@decorated(mode="start")
def config():
    cfg = task(3)
    cfg.sim.dt = 0.5
    cfg.actions["legs"].scale = {"a.*": 1.0}
    cfg.events |= {"push": None, "pull": Robot.pull}
    cfg.events.pop("slip", None)
    del cfg.terms["height"]
    for sensor in cfg.sensors:
        sensor.name = "never"
    return cfg
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "robot.py"
    path.write_text(text)
    return path


def test_calls_attributes_and_items_are_one_table(tmp_path: Path):
    record = recorded(written(tmp_path, SAID), ["config", "absent"])
    assert record["XML"] == "/bundle/mjcf/a.xml"
    assert record["imports"] == ["trainer", "trainer.deep"]
    push = record["Events"]["push"]
    assert (push["()"], push["force"]) == ("trainer.deep.Robot.Event", [1, 2])
    assert push["of"] == {"leg": "/bundle/mjcf/a.xml"}
    said = record["config()"]
    assert (said["()"], said["*"], said["@"]) == ("trainer.deep.task", [3], 11)
    assert said["sim"]["dt"] == 0.5
    assert said["actions"]["legs"]["scale"] == {"a.*": 1.0}
    assert said["events"]["pull"]["()"] == "trainer.deep.Robot.pull"
    assert said["events"]["slip"] is None
    assert said["terms"]["height"] is None


def test_a_byte_order_mark_means_nothing(tmp_path: Path):
    assert recorded(written(tmp_path, "\ufeffDT = 0.5"))["DT"] == 0.5


@pytest.mark.parametrize(
    "text",
    [
        "open({canary!r}, 'w')",
        "open({secret!r}).read()",
        "import os\nos.system('touch {canary}')",
        "import subprocess\nsubprocess.run(['touch', {canary!r}])",
        "import socket\nsocket.create_connection(('127.0.0.1', 9))",
        "import os\nos.fork()",
        "import ctypes\nctypes.CDLL(None)",
        "import os\nos.kill(os.getppid(), 9)",
    ],
)
def test_what_no_configuration_needs_is_refused(text: str, tmp_path: Path):
    canary, secret = str(tmp_path / "canary"), str(written(tmp_path / "..", "SECRET = 1"))
    file = written(tmp_path, text.format(canary=canary, secret=secret))
    with pytest.raises(UsageError, match="Error"):
        recorded(file)
    assert not Path(canary).exists()


@pytest.mark.parametrize(
    "text",
    [
        "A = 'x' * 10**12",
        "A = 1\nfor _ in range(60): A = (A, A)",
        "def f(): f()\nf()",
        "A = []\nA.append(A)",
        "x = " + "(" * 500,
        "import os\nos._exit(0)",
        "import os\nos.write(1, b'[' * 100)\nos._exit(0)",
        "raise SystemExit(0)",
        "A = 9**9**7",
        "A = {10**5000: 1}",
    ],
)
def test_what_never_ends_well_is_one_clear_error(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(standins, "SECONDS", 2.0)
    with pytest.raises(UsageError, match=r"robot\.py"):
        recorded(written(tmp_path, text))


def test_a_module_that_never_stops_talking_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(standins, "MOST_BYTES", 1000)
    began = time.monotonic()
    text = "import os\nwhile True:\n    for n in range(3, 20):\n        try: os.write(n, b'x' * 99)"
    with pytest.raises(UsageError):
        recorded(written(tmp_path, f"{text}\n        except OSError: pass"))
    assert time.monotonic() - began < 10.0
