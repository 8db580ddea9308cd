"""Readers of a stored robot, made when this is imported: once for all forks of a process."""

from __future__ import annotations

from assetbuild.robot.codec import reader_of
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.shapes import Shapes

READERS = tuple(map(reader_of, (Tree, Shapes, Control)))
