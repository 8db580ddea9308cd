"""What the readers of the MJCF's forms share: full, mjx and bare."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.errors import UsageError
from assetbuild.facts.compare import EXACT, Precision
from assetbuild.facts.known_files import KnownFiles
from assetbuild.facts.mjcf_fields import fields
from assetbuild.facts.mjcf_meshes import Meshes, Spec, leave_out_copies
from assetbuild.facts.mjcf_model import read_model
from assetbuild.facts.mjcf_opaque import Opaque, opaque_of
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Table, Writer
from assetbuild.simulators.mujoco import Model, caught_warnings

LACKS: Mapping[str, str] = {
    "robot articulation root": "MJCF has a tree of bodies, which needs no such mark",
    "robot self-collision": "the masks of the shapes and excluded pairs say it",
    "robot up axis": "MJCF has gravity alone",
    "robot metres per unit": "MJCF has no units",
    "robot kilograms per unit": "as above",
    "robot start pose": "keyframes say it",
    "robot soft limits": "they belong to the trainer",
    "joint velocity": "MJCF has no limit of velocity",
    "joint stall": "the motor's law acts outside of the simulator",
    "joint delay": "as above",
    "joint start": "keyframes say it",
    "joint drive target": "keyframes say it",
    "shape material": "materials that look alike share the first one's name",
    "shape collides": "the masks say it",
    "shape restitution": "MuJoCo's contacts have softness instead",
    "simulation decimation": "it belongs to the trainer",
    "floor": "the scene has one",
}
MESHES = Precision(
    {**EXACT, "length": 1e-6}, {("shape", "texture corners"): 1e-6, ("shape", "rgba"): 1e-6}
)
"""MuJoCo keeps vertices, texture coordinates and colours as float32."""
NOTHING = Opaque()


def read_spec(
    spec: Spec, opaque: Opaque = NOTHING, known: KnownFiles | None = None, *, by_area: bool = False
) -> tuple[Model, Table]:
    """A specification compiled, and as facts; MuJoCo's ValueError where it refuses it.

    known: see `leave_out_copies`; by_area: see `Meshes`.
    """
    copies = leave_out_copies(spec, known) if known else None
    model, book = spec.compile(), Writer()
    told = read_model(model, book, opaque.subjects, Meshes(model, copies, by_area=by_area))
    return model, Table({**book.facts, **fields(model, told)})


class MjcfReader(Reader):
    """Reads the compiled model: what moves, weighs, touches, drives and senses."""

    preload: ClassVar[tuple[str, ...]] = ("mujoco",)
    precision: ClassVar[Precision] = MESHES
    copies: ClassVar[bool] = True
    """Whether copies of the robot's own files are known by their bytes."""

    def read(self, path: Path) -> Table:
        """Read any MJCF; UsageError where MuJoCo refuses it."""
        return self._read(path, NOTHING, None)

    def _read(self, path: Path, opaque: Opaque, known: KnownFiles | None) -> Table:
        import mujoco

        with caught_warnings():
            try:
                return read_spec(mujoco.MjSpec.from_file(str(path)), opaque, known)[1]
            except ValueError as error:
                text = " ".join(str(error).replace(f"{path.parent}/", "").split())
                raise UsageError(f"MuJoCo refuses it: {text}") from None

    def found(self, path: Path, reference: Reference) -> Table:
        """Without what the source's MJCF alone says."""
        return self.complete(self.compiled(path, reference), reference)

    def compiled(self, path: Path, reference: Reference) -> Table:
        """All facts of a file of this robot."""
        known = reference.assets.known if self.copies and reference.assets.files else None
        return self._read(path, opaque_of(reference), known)

    def complete(self, table: Table, reference: Reference) -> Table:
        """As far as MJCF holds it and the source's MJCF does not say it itself."""
        opaque = opaque_of(reference)
        return table.only(lambda key: self.holds(key) and not opaque.says(key))
