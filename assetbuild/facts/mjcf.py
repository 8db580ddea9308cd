"""What the readers of the MJCF's forms share: full, mjx, bare and scenes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.errors import UsageError
from assetbuild.facts.compare import EXACT, Precision
from assetbuild.facts.derived import SOLIMP, SOLREF
from assetbuild.facts.known_files import KnownFiles
from assetbuild.facts.mjcf_copies import leave_out_copies
from assetbuild.facts.mjcf_expected import shown_pictures
from assetbuild.facts.mjcf_meshes import Meshes
from assetbuild.facts.mjcf_model import read_model
from assetbuild.facts.mjcf_opaque import Opaque, free_joint, opaque_of, opaque_option, sensor_words
from assetbuild.facts.mjcf_words import NEVER_ALONE, Spec, is_covered, words
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.table import Key, Table, Value, Writer
from assetbuild.robot.shapes import Mesh
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
STRONGEST = (3.0, 2.0, 1.0)
"""Parameters of a contact sensor: it reports `found` and `force` of the strongest contact."""
MESHES = Precision(
    {**EXACT, "length": 1e-6},
    {("shape", "texture corners"): 1e-6, ("shape", "rgba"): 1e-6, ("shape", "mjcf:normals"): 1e-5},
)
"""MuJoCo keeps vertices, texture coordinates and colours as float32."""


NOTHING = Opaque(frozenset(), {}, frozenset())


def read_spec(
    spec: Spec,
    opaque: Opaque = NOTHING,
    stated: Collection[str] = (),
    known: KnownFiles | None = None,
    *,
    by_area: bool = False,
) -> tuple[Model, Table]:
    """A specification compiled, and as facts; MuJoCo's ValueError where it refuses it.

    stated, by_area: see `Meshes`; known: see `leave_out_copies`.
    """
    book = Writer()
    said = words(spec)
    copies = leave_out_copies(spec, known) if known else None
    model = spec.compile()
    meshes = Meshes(model, copies, stated, by_area=by_area)
    told = read_model(model, book, opaque.subjects, meshes)
    return model, _known(Table({**book.facts, **said}), opaque, told)


def _known(table: Table, opaque: Opaque, told: frozenset[tuple[str, str]]) -> Table:
    """Without the words that the vocabulary says too, and what opaque words say instead.

    told: subjects that the vocabulary tells whole.
    """
    shapes = [(key, value) for key, value in table.facts.items() if key.kind == "shape"]
    shown = {key.name for key, value in shapes if (key.quantity, value) == ("role", "visual")}
    shown -= {key.name for key, value in shapes if key.quantity in ("mask", "partners") and value}
    owned = {(key.kind, key.name, key.quantity) for key in opaque.words}

    def holds(key: Key) -> bool:
        subject = (key.kind, key.name)
        if not key.is_foreign:
            return subject not in opaque.subjects and key not in opaque.touched
        if subject in opaque.subjects or tuple(key) in owned:
            return True
        if key.kind not in NEVER_ALONE and subject not in told:
            return True
        return not is_covered(key, shown=key.name in shown)

    return table.only(holds)


def _misnamed(spec: Spec, opaque: Opaque) -> dict[Key, Value]:
    """Equalities of joints that are not called as the joint that they hold."""
    return {
        Key("joint", item.name1, "mjcf:equality"): item.name
        for item in spec.equalities
        if item.type.name == "mjEQ_JOINT" and item.name != item.name1
        if ("equality", item.name) not in opaque.subjects
    }


class MjcfReader(Reader):
    """Reads the compiled model, and by MuJoCo's parser all attributes beyond the vocabulary."""

    preload: ClassVar[tuple[str, ...]] = ("mujoco",)
    precision: ClassVar[Precision] = MESHES

    def read(self, path: Path) -> Table:
        """Read any MJCF; UsageError where MuJoCo refuses it."""
        return self._read(path, NOTHING, Assets())

    def _read(self, path: Path, opaque: Opaque, assets: Assets) -> Table:
        import mujoco

        known = assets.known if assets.files else None
        stated = {name for name, surface in assets.surfaces if surface.normals}
        with caught_warnings():
            try:
                spec = mujoco.MjSpec.from_file(str(path))
                more = _misnamed(spec, opaque)
                return read_spec(spec, opaque, stated, known)[1] | Table(more)
            except ValueError as error:
                text = " ".join(str(error).replace(f"{path.parent}/", "").split())
                raise UsageError(f"MuJoCo refuses it: {text}") from None

    def found(self, path: Path, reference: Reference) -> Table:
        """What only MJCF can say is compared word by word."""
        opaque = opaque_of(reference.control.mjcf_only, reference)
        return self._read(path, opaque, reference.assets).only(self.holds)

    def complete(self, table: Table, reference: Reference) -> Table:
        """With the words that MJCF alone has: of the source, and those of Menagerie's style."""
        opaque = opaque_of(reference.control.mjcf_only, reference)
        facts: dict[Key, Value] = {
            key: value for key, value in table.facts.items() if key not in opaque.touched
        }
        facts[Key("model", "", "mjcf:name")] = self.robot
        for frame in table.names("frame"):
            if (group := Key("frame", frame, "mjcf:group")) not in opaque.touched:
                facts[group] = 4.0
        for asset in reference.shapes.meshes:
            facts[Key("mesh", asset.name, "mjcf:inertia")] = "mjMESH_INERTIA_SHELL"
        for index in range(len(shown_pictures(reference))):
            facts[Key("texture", f"texture{index}", "mjcf:type")] = "mjTEXTURE_2D"
        for loop in reference.control.loops:
            for word, value, usual in (
                ("solref", loop.solref, SOLREF),
                ("solimp", loop.solimp, SOLIMP),
            ):
                if tuple(value) != usual:
                    facts[Key("equality", loop.name, f"mjcf:{word}")] = tuple(value)
        control = reference.control
        for kind, words_of, held in (
            ("joint", ("solref_limit", "solimp_limit"), control.soft_limits),
            ("equality", ("solref", "solimp"), control.soft_couplings),
        ):
            for name, soft in held:
                for word, numbers in zip(words_of, (soft.solref, soft.solimp), strict=True):
                    facts[Key(kind, name, f"mjcf:{word}")] = numbers
        for sensor in reference.control.sensors:
            if sensor.kind == "contact":
                facts[Key("sensor", sensor.name, "mjcf:intprm")] = STRONGEST
            if sensor.kind == "rangefinder":
                said = sensor_words(sensor.kind).items()
                facts |= {key._replace(name=sensor.name): value for key, value in said}
        surfaces = dict(reference.assets.surfaces)
        for shape in reference.shapes.shapes:
            if isinstance(shape.geometry, Mesh) and surfaces[shape.geometry.mesh].normals:
                turned = surfaces[shape.geometry.mesh].moved(
                    reference.tree.shape_placement(shape)[1]
                )
                facts[Key("shape", shape.name, "mjcf:normals")] = turned.normals
        facts |= opaque_option(reference)[1] | free_joint(reference)
        return Table({**facts, **opaque.words}).only(self.holds)
