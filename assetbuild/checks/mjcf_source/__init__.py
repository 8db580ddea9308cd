"""Is the MJCF that we write the MJCF that we read?

Both are compiled and become tables of facts, read alike. What the recipe states is not compared,
nor what the build changes by rule:

- A body without mass and joints becomes a site; a body's old frame, and the ends of a loop, too.
- A site with the name of a body is called `<site>_site`.
- A geom that collides and is drawn is two: the second is called `<geom>_visual`.
- Bodies that a joint connects are excluded.
- A camera that looks at a body without mass looks ahead.
- What counts from a joint's `ref` in a law of its own is not compared.
- MuJoCo reads the first object of an OBJ file alone, of which the bundle has all, and cuts polygons
  of five corners or more elsewhere: what follows from the faces of such meshes is not compared.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from assetbuild.checks.mjcf_source.at_rest import GREY, Facts, Side, read_side
from assetbuild.engine.step import Files
from assetbuild.facts.compare import EXACT, Difference, Precision, differences, equality_findings
from assetbuild.facts.mjcf_model import MESHES
from assetbuild.facts.table import Key, Table, Value, pair_of
from assetbuild.facts.vocabulary import Comparison
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import RecipeView, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import mj, name_of

LOAD = Rule(
    "equal.source.load", "error", "MuJoCo refuses our MJCF or the source's", "see `mjcf.load`"
)
FIRST_OBJECT = Rule(
    "mjcf.first_object",
    "info",
    "MuJoCo reads the first object of an OBJ file alone, the bundle has them all",
    "join the objects of the file, or leave the others out",
)
_OBJECT, _FACE = re.compile(rb"(?m)^[og]\b"), re.compile(rb"(?m)^f\s")
_POLYGON = re.compile(rb"(?m)^f(?:[ \t]+\S+){5}")
"""A face of five corners or more."""


class MjcfSource(mujoco.WithMujoco):
    """Findings `equal.source.<what>`; all are errors and carry both values.

    What the recipe itself says (`stated`) is not compared here; the readers of
    facts compare it with the robot.
    """

    needs = ("mjcf", "source_mjcf")
    reads = ("tree.json",)

    robot: str
    stated: tuple[str, ...] = ()
    """What the recipe states itself: actuators, base, collision, contact, decimated, exclude,
    loops, merge, senses, `keyframe <name>`, and names of options."""

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any] | None:  # Any: values of its fields
        """None for a robot that comes from no MJCF."""
        if recipe.value("source.mjcf") is None:
            return None
        links, default = (recipe.value(f"collision.{key}") for key in ("links", "default"))
        flags = {
            "actuators": bool(recipe.value("actuators")),
            "base": recipe.states("base"),
            "collision": any(
                rule.method != "keep" or rule.from_ == "visual"
                for rule in (default, *links.values())
            ),
            "contact": bool(recipe.stated("contact")),
            "decimated": recipe.value("visual.max_faces") is not None,
            "exclude": bool(recipe.stated("collision.exclude")),
            "impratio": "cone" in recipe.stated("mjcf"),  # another cone brings its own
            "loops": bool(recipe.value("loops")),
            "merge": "merge" in recipe.stated("fixed_joints"),
            "senses": any(map(recipe.states, ("feet", "imu", "sensors", "cameras"))),
        }
        stated = {key for key, value in flags.items() if value}
        stated |= {f"keyframe {name}" for name in recipe.value("keyframes")}
        stated |= {*recipe.stated("simulation"), *recipe.stated("mjcf")}
        return {"robot": recipe.value("robot"), "stated": tuple(sorted(stated))}

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `source.xml`, `files/` and `mjcf/<robot>.xml`."""
        tree, stated = RobotFiles(files.inputs).tree, frozenset(self.stated)
        flat = ElementTree.fromstring((files.inputs / "source.xml").read_bytes())  # noqa: S314 # `flatten_mjcf` wrote it
        rough = roughness(flat)
        # Without `ctrl` the source says 0; our drives hold the pose of the keyframe.
        silent = [key for key in flat.iterfind("keyframe/key") if not key.get("ctrl")]
        stated |= {f"commands {key.get('name')}" for key in silent}
        scene = flat.find("worldbody")
        if tree.root != "world" and scene is not None:
            # Shapes of the world go: rangefinders see them, and the robot lies on them.
            keys = ("geom", "geom1", "geom2", "objname", "refname")
            named = {element.get(key) for element in flat.iter() for key in keys}
            for geom in [g for g in scene.iterfind("geom") if g.get("name") not in named]:
                scene.remove(geom)
        folder = files.inputs / "files"
        objects = {str(mesh.get("name")): _objects(mesh, folder) for mesh in flat.iter("mesh")}
        for name in [name for name, count in objects.items() if count > 1]:
            yield FIRST_OBJECT(
                f"mesh {name}",
                "MuJoCo reads the first of its objects alone; in the bundle all are there",
            )
        try:
            with mujoco.caught_warnings():
                world = mujoco.body_names(tree)["world"] if tree.root == "world" else ""
                source = read_side(source_spec(flat, folder, tree), weightless=world)
                path = files.inputs / "mjcf" / f"{self.robot}.xml"
                ours = read_side(mj.MjSpec.from_file(str(path)))
        except ValueError as error:
            write_figures(files, {"skipped": str(error)})
            yield LOAD("robot", f"nothing to compare: {error}")
            return
        twins = _twins(source.facts, ours.facts)
        for key in list(source.facts):
            if key.kind == "shape" and key.quantity in MESH and objects.get(source.mesh(key.name)):
                del source.facts[key]
                for name in (key.name, twins.get(key.name, "")):
                    ours.facts.pop(key._replace(name=name), None)
        before, after = tables(source, ours, stated)
        different = compare(before, after, rough=rough)
        yield from equality_findings(different, "source", "our MJCF", {}, "the source")
        counts = {
            kind: [len(before.names(kind)), len({*before.names(kind)} & {*after.names(kind)})]
            for kind in dict.fromkeys(key.kind for key in before.facts)
        }
        figures = {
            "facts": len({*before.facts, *after.facts}),
            "compared": counts,
            "not_compared": sorted(stated),
        }
        write_figures(files, figures)


def roughness(root: ElementTree.Element) -> Mapping[Comparison, float]:
    """Return relative tolerances for what MuJoCo itself reads to six digits only.

    Before 4.0 it diagonalised a `fullinertia` to 3e-6 (measured in 3.11); we take the source's own
    numbers.
    """
    full = any(inertial.get("fullinertia") for inertial in root.iter("inertial"))
    return {"tensor": 1e-5, "vector": 1e-5} if full and mj.__version__.startswith("3.") else {}


def _objects(mesh: ElementTree.Element, folder: Path) -> int:
    """How many objects an OBJ file has that MuJoCo does not read as we do; 0 for any other file.

    It leaves out all but the first, and cuts polygons whose corners lie in no plane elsewhere.
    """
    path = folder / str(mesh.get("file"))
    if path.suffix.lower() != ".obj":
        return 0
    data = path.read_bytes()
    count = sum(bool(_FACE.search(part)) for part in _OBJECT.split(data))
    return count if count > 1 or _POLYGON.search(data) else 0


def source_spec(root: ElementTree.Element, folder: Path, tree: Tree) -> Any:  # Any: MjSpec
    """The source without its pictures and skins; ValueError when MuJoCo refuses it.

    A world that is the robot's root is a body of our MJCF, so its contents become one here too.
    """
    for parent in list(root.iter()):
        for child in list(parent):
            hfield = child.tag == "geom" and child.get("type") == "hfield"
            if child.tag in ("texture", "layer", "hfield", "skin") or hfield:
                parent.remove(child)
        if parent.tag in ("material", "light"):
            parent.attrib.pop("texture", None)
    world = root.find("worldbody")
    if tree.root == "world" and world is not None:
        whole = ElementTree.Element("body", {"name": mujoco.body_names(tree)["world"]})
        of_bodies = {geom for body in world.iter("body") for geom in body.iter("geom")}
        for geom in set(world.iter("geom")) - of_bodies:
            geom.set("mass", "0")  # the world has none
        whole[:], world[:] = list(world), [whole]
    assets = {}  # numbered: to MuJoCo, files of one name in two folders are one
    for number, mesh in enumerate(root.iterfind("asset/mesh")):
        path = folder / str(mesh.get("file"))
        mesh.set("file", f"{number}{path.suffix}")
        assets[f"{number}{path.suffix}"] = path.read_bytes()
    return mj.MjSpec.from_string(ElementTree.tostring(root, "unicode"), assets=assets)


# --- what a rule of the build, or the recipe, explains -------------------------------------------


SNAPPED = 2e-6
"""m or rad: MuJoCo's compiler takes frames of a body that differ by 1e-6 for one, in each file."""
DRIVE = frozenset({"model", "kp", "kd", "gear", "effort", "command range", "drive name",
                   "drive parameters", "damping", "friction", "armature",
                   "mjcf:actuatorfrcrange", "mjcf:effort range", "mjcf:dampingpoly"})  # fmt: skip
SURFACE = frozenset({"friction", "condim", "priority", "solref", "solimp", "margin", "gap",
                     "mjcf:solmix"})  # fmt: skip
MESH = frozenset({"area", "volume", "mean corner", "corner moments"})
LOOKS = frozenset({"texture", "texture corners", "triangles"})
"""Not compared: pictures are no input of this check; how many triangles keep an area depends on
rounding, and tells how precise the area is."""
OPTIONS = {"ls_iterations": "line search iterations"}
"""Key of a recipe -> quantity, where they differ."""


def compare(before: Table, after: Table, *, rough: Mapping[Comparison, float]) -> list[Difference]:
    """Everything that differs. rough: see `roughness`."""
    by: dict[Comparison, float] = {**EXACT, "length": 1e-6, **rough}
    poses = {("shape", "pose"): SNAPPED, ("frame", "pose"): SNAPPED}
    found = differences(before, after, Precision(by, {**MESHES.by_quantity, **poses}))
    return [difference for difference in found if difference.key.quantity not in LOOKS]


def tables(source: Side, ours: Side, stated: frozenset[str]) -> tuple[Table, Table]:
    """What neither a rule above nor the recipe (`stated`, see `MjcfSource`) explains, of both."""
    wanted = _drawn_apart(_with_our_names(source, ours), ours.facts)
    parts = [
        {key: value for key, value in facts.items() if not _is_stated(key, facts, stated)}
        for facts in (wanted, ours.facts)
    ]
    known = {(key.kind, key.name) for key in parts[0]}
    made = {"frame"} | ({"sensor", "camera"} if "senses" in stated else set())
    made |= {"loop", "equality"} if "loops" in stated else set()
    after = {k: v for k, v in parts[1].items() if k[:2] in known or k.kind not in made}
    before = {k: v for k, v in parts[0].items() if not _is_changed(k, source, ours, after, stated)}
    return Table(before), Table({k: v for k, v in after.items() if not _moves(k, source)})


def _with_our_names(source: Side, ours: Side) -> Facts:
    """Sites that are called as a body have another name in ours."""
    taken = {name_of(side.model, "body", i) for side in (source, ours)
             for i in range(side.model.nbody)}  # fmt: skip
    names: dict[str, str] = {}
    for old in dict.fromkeys(key.name for key in source.facts if key.kind == "frame"):
        new = old
        while new in taken:
            new += "_site"
        taken.add(new)
        names[old] = new

    def renamed(value: Value) -> Value:
        if isinstance(value, tuple):
            return tuple(renamed(one) for one in value)  # type: ignore[return-value] # alike
        kind, _, name = value.partition(" ") if isinstance(value, str) else ("", "", "")
        return f"{kind} {names[name]}" if kind == "site" and name in names else value

    return {
        key._replace(name=names[key.name]) if key.kind == "frame" else key: renamed(value)
        for key, value in source.facts.items()
    }


def _twins(facts: Facts, ours: Facts) -> dict[str, str]:
    """Shape of the source -> the second one that ours has of it, which is seen."""
    known = {key.name for key in facts if key.kind == "shape"}
    made = {key.name for key in ours if key.kind == "shape"} - known
    return {old: new for new in made if (old := re.sub(r"_visual\d*$", "", new)) in known}


def _drawn_apart(facts: Facts, ours: Facts) -> Facts:
    """The facts of the source, where what both collides and is drawn is two shapes as in ours."""
    twins = _twins(facts, ours)
    apart = dict(facts)
    for key, value in facts.items():
        if key.kind != "shape" or key.name not in twins:
            continue
        twin = key._replace(name=twins[key.name])
        if key.quantity == "role":
            apart |= {key: "collision", twin: "visual"}
        elif key.quantity == "rgba":
            apart |= {key: GREY, twin: value}
        elif key.quantity in ("contype", "conaffinity"):
            apart[twin] = 0.0
        elif key.quantity not in SURFACE and not key.is_foreign:
            apart[twin] = value
    return apart


def _is_changed(key: Key, source: Side, ours: Side, after: Facts, stated: frozenset[str]) -> bool:
    """Whether a rule of the build changes it."""
    if key.kind == "pair":
        return key not in after and ("exclude" in stated or _are_neighbours(key.name, source))
    if key.kind == "camera" and key.quantity in ("tracking", "mjcf:target"):
        target = int(source.model.cam_targetbodyid[source.model.camera(key.name).id])
        names = {name_of(ours.model, "body", index) for index in range(ours.model.nbody)}
        return target > 0 and name_of(source.model, "body", target) not in names
    return _moves(key, source)


def _moves(key: Key, source: Side) -> bool:
    """Whether it counts from a `ref` in a way that only the engine knows."""
    law = key.quantity == "drive parameters" and key.name in source.rest
    return law or (bool(source.rest) and key.kind == "tendon" and
                   key.quantity in ("mjcf:range", "mjcf:lengthspring"))  # fmt: skip


def _are_neighbours(pair: str, side: Side) -> bool:
    """Whether the body of one of two shapes carries that of the other."""
    one, other = (side.facts.get(Key("shape", name, "body")) for name in pair_of(pair))
    parents = [key for key in side.facts if key.kind == "joint" and key.quantity == "parent"]
    joints = {(side.facts[k], side.facts[k._replace(quantity="body")]) for k in parents}
    return bool({(one, other), (other, one)} & joints)


def _is_stated(key: Key, facts: Facts, stated: frozenset[str]) -> bool:
    """Whether the recipe says it."""
    kind, name, quantity = key
    if kind == "simulation":
        names = {OPTIONS.get(word, word) for word in stated}
        return quantity.removeprefix("mjcf:") in names
    return any(reason in stated for reason in _reasons(kind, name, quantity, facts))


def _reasons(kind: str, name: str, quantity: str, facts: Facts) -> Iterator[str]:
    """Words of `stated` that would explain it."""
    touches = facts.get(Key(kind, name, "contype")) or facts.get(Key(kind, name, "conaffinity"))
    command = kind == "keyframe" and quantity in ("target", "mjcf:command")
    watched = str(facts.get(Key(kind, name, "object"), "")).startswith("actuator ")
    if (
        kind == "actuator"
        or (kind == "joint" and quantity in DRIVE)
        or command
        or (kind == "sensor" and watched)
    ):
        yield "actuators"
    if quantity in ("base", "base pose") or (
        kind == "joint" and Key(kind, name, "type") not in facts
    ):
        yield "base"
    if kind in ("camera", "frame") and quantity in ("body", "pose"):
        body = facts.get(Key(kind, name, "body"))
        if not body or not facts.get(Key("body", str(body), "parent")):
            yield "base"  # what stands in the world stands on a fixed root, and not on a free one
    if kind == "pair":
        yield from ("collision", "merge", "contact")
    if kind == "shape" and touches:
        yield "collision"
    if kind == "shape" and quantity in SURFACE:
        yield "contact"
    if kind == "shape" and not touches and quantity in MESH:
        yield "decimated"
    if kind == "loop" or (kind == "equality" and quantity in ("mjcf:solref", "mjcf:solimp")):
        yield "loops"
    if kind == "body" and quantity == "mjcf:gravcomp":
        yield "merge"
    if kind == "keyframe":
        yield f"keyframe {name.split('/')[0]}"
    if command:
        yield f"commands {name.split('/')[0]}"
