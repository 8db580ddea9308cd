"""A robot's files are decoded when they are asked for, each once."""

from __future__ import annotations

from pathlib import Path

import pytest

from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles, SourceControl
from assetbuild.robot.model import Body, Control, Tree

TREE = Tree("tiny", "fixed", (Body("base"),), ())


def test_only_what_is_asked_for_must_be_there(tmp_path: Path):
    (tmp_path / "tree.json").write_bytes(encode(TREE))
    robot = RobotFiles(tmp_path)
    assert robot.tree == TREE
    with pytest.raises(FileNotFoundError):
        _ = robot.control


def test_a_file_is_read_once(tmp_path: Path):
    (tmp_path / "links.json").write_bytes(encode(TREE))
    robot = RobotFiles(tmp_path)
    first = robot.links
    (tmp_path / "links.json").unlink()
    assert robot.links is first


def test_a_source_may_say_nothing_of_drives(tmp_path: Path):
    assert RobotFiles(tmp_path).source_control is None
    said = SourceControl(Control(), ("base",))
    (tmp_path / "source_control.json").write_bytes(encode(said))
    assert RobotFiles(tmp_path).source_control == said
