"""What the readers of the MJCF's forms share: full, mjx and bare."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.errors import UsageError
from assetbuild.facts.compare import EXACT, Precision
from assetbuild.facts.mjcf_expected import mjcf_table, solver_facts
from assetbuild.facts.mjcf_fields import Bodies, fields
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
UNSEEN: Mapping[str, str] = {
    **LACKS,
    **dict.fromkeys(("shape rgba", "shape texture"), "one writer draws all forms"),
}
"""Facts that the mjx and bare files are not asked for: their visual shapes are not read."""
MESHES = Precision(
    {**EXACT, "length": 1e-6}, {("shape", "texture corners"): 1e-6, ("shape", "rgba"): 1e-6}
)
"""MuJoCo keeps vertices, texture coordinates and colours as float32."""


def compiled_facts(
    model: Model,
    opaque: Opaque | None = None,
    *,
    by_area: bool = False,
    bodies: Bodies | None = None,
) -> Table:
    """A compiled model as facts. by_area: see `measure`; bodies: in whose frames."""
    book, known = Writer(), opaque.subjects if opaque else ()
    told = read_model(model, book, known, by_area=by_area, bodies=bodies)
    return Table({**book.facts, **fields(model, told)})


class MjcfReader(Reader):
    """Reads the compiled model: what moves, weighs, touches, drives and senses."""

    preload: ClassVar[tuple[str, ...]] = ("mujoco",)
    precision: ClassVar[Precision] = MESHES
    folder: ClassVar[str] = "mjcf"
    lacks: ClassVar[Mapping[str, str]] = UNSEEN
    written: ClassVar[str] = "{robot}.xml"
    """The file below that folder."""
    solver: ClassVar[str] = ""
    """Section of the recipe that states the solver; none where the file has no options."""
    visuals: ClassVar[bool] = False
    """Whether shapes that touch nothing are read: one writer draws them in all forms."""

    def file(self, root: Path, robot: str) -> Path | None:
        """Where the target is built."""
        path = root / self.written.replace("{robot}", robot)
        return path if path.is_file() else None

    def robot_of(self, reference: Reference) -> Reference:
        """The robot that this form holds."""
        return reference

    def read(self, path: Path) -> Table:
        """Read any MJCF; UsageError where MuJoCo refuses it."""
        return self._read(path, None, visuals=True)

    def _read(self, path: Path, opaque: Opaque | None, *, visuals: bool) -> Table:
        import mujoco

        with caught_warnings():
            try:
                spec = mujoco.MjSpec.from_file(str(path))
                spec.compiler.discardvisual |= not visuals
                return compiled_facts(spec.compile(), opaque)
            except ValueError as error:
                text = " ".join(str(error).replace(f"{path.parent}/", "").split())
                raise UsageError(f"MuJoCo refuses it: {text}") from None

    def expected(self, reference: Reference) -> Table:
        """The robot that this form holds, and its solver."""
        here = self.robot_of(reference)
        solver = solver_facts(here, self.solver) if self.solver else {}
        return self._compared(Table({**mjcf_table(here).facts, **solver}), here)

    def found(self, path: Path, reference: Reference) -> Table:
        """All facts of a file of this robot."""
        here = self.robot_of(reference)
        return self._compared(self._read(path, opaque_of(here), visuals=self.visuals), here)

    def _compared(self, table: Table, reference: Reference) -> Table:
        """As far as MJCF holds it and the source's MJCF does not say it itself."""
        opaque, unseen = opaque_of(reference), set[str]()
        for name in () if self.visuals else table.names("shape"):
            said = table.of("shape", name)
            if not said.get("mask") and not said.get("partners"):
                unseen.add(name)
        return table.only(
            lambda key: (
                self.holds(key)
                and not opaque.says(key)
                and not (key.kind == "shape" and key.name in unseen)
            )
        )
