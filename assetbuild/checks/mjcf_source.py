"""Is the MJCF that we write the MJCF that we read: moving alike, pulling alike, sensing alike?

Both are compiled and held together by name. Poses of bodies, shapes, sites and joints, the mass
matrix, the forces of drives, springs and dampers, and all sensors are compared in several
positions; what does not move is compared as it is. The reader of the source is not asked.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.kinds import Check, write_figures
from assetbuild.recipe.models import Recipe
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array, rotation_of
from assetbuild.simulators import mujoco

TOLERANCE = 1e-9
"""Relative to the size of what is compared; sums of sines and cosines round to about 1e-15."""
ROUNDING = 1e-11
"""Absolute, SI units."""
MESH_TOLERANCE = 2e-6
"""Relative to a mesh's size: MuJoCo keeps vertices as float32."""
POSITIONS = 6
SHOWN = 12
"""Most findings of one rule."""
MESH = 7
FREE, SLIDE, HINGE = 0, 2, 3


class MjcfSource(Check):
    """Findings `equal.source.<what>`; all are errors and carry both values.

    What the recipe itself says (`stated`) is not compared.
    """

    isolated = True
    preload = ("mujoco",)
    tools = ("mujoco",)
    needs = ("mjcf", "source_mjcf")
    reads = ("tree.json",)

    robot: str
    stated: tuple[str, ...] = ()
    """Of actuators, base, collision, contact, decimated, merge, and names of options."""

    @classmethod
    def configure(cls, recipe: Recipe) -> MjcfSource | None:
        """None for a robot that comes from no MJCF."""
        if recipe.source.mjcf is None:
            return None
        rules = [recipe.collision.default, *recipe.collision.links.values()]
        said = {
            "actuators": bool(recipe.actuators),
            "base": "base" in recipe.model_fields_set,
            "collision": any(r.method != "keep" or r.from_ == "visual" for r in rules),
            "contact": bool(recipe.contact.model_fields_set),
            "decimated": recipe.visual.max_faces is not None,
            "merge": "merge" in recipe.fixed_joints.model_fields_set,
            "timestep": "timestep" in recipe.simulation.model_fields_set,
            "gravity": "gravity" in recipe.simulation.model_fields_set,
        }
        options = recipe.mjcf.model_fields_set
        stated = {key for key, value in said.items() if value} | options
        return cls(robot=recipe.robot, stated=tuple(sorted(stated)))

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `source.xml`, `files/` and `mjcf/<robot>.xml`."""
        tree = decode(Tree, (files.inputs / "tree.json").read_bytes())
        try:
            source = compile_flat(files.inputs / "source.xml", files.inputs / "files")
            ours = mujoco.load(files.inputs / "mjcf" / f"{self.robot}.xml").model
        except StepError as error:
            write_figures(files, {"skipped": error.message})
            message = f"nothing to compare: {error.message}"
            yield Finding("equal.source.load", "error", "robot", message)
            return
        comparison = _Comparison(source, ours, tree, frozenset(self.stated))
        yield from comparison.findings()
        write_figures(files, comparison.figures())


def compile_flat(path: Path, folder: Path) -> mujoco.Model:
    """The source without its pictures; StepError when MuJoCo refuses it."""
    import mujoco as mj

    root = ElementTree.fromstring(path.read_bytes())  # noqa: S314 # `flatten_mjcf` wrote it
    for parent in list(root.iter()):
        for child in list(parent):
            hfield = child.tag == "geom" and child.get("type") == "hfield"
            if child.tag in ("texture", "layer", "hfield") or hfield:
                parent.remove(child)
        if parent.tag in ("material", "light"):
            parent.attrib.pop("texture", None)
        if parent.tag == "compiler":
            parent.attrib.pop("discardvisual", None)
            parent.attrib.pop("fusestatic", None)
    meshes = [str(mesh.get("file")) for mesh in root.iterfind("asset/mesh")]
    assets = {name: (folder / name).read_bytes() for name in meshes}
    with mujoco.caught_warnings():
        try:
            return mj.MjModel.from_xml_string(ElementTree.tostring(root, "unicode"), assets)
        except ValueError as error:
            raise StepError(f"the source does not compile: {error}") from None


@dataclass
class _Side:
    """One model: ids by name of every kind, and its state."""

    model: mujoco.Model
    data: mujoco.Data
    ids: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @classmethod
    def of(cls, model: mujoco.Model) -> _Side:
        import mujoco as mj

        counts = {
            "body": model.nbody, "joint": model.njnt, "geom": model.ngeom, "site": model.nsite,
            "camera": model.ncam, "light": model.nlight, "actuator": model.nu,
            "sensor": model.nsensor, "equality": model.neq, "tendon": model.ntendon,
            "key": model.nkey,
        }  # fmt: skip
        ids = {
            kind: {str(getattr(model, kind)(i).name): i for i in range(count)}
            for kind, count in counts.items()
        }
        return cls(model, mj.MjData(model), ids)


class _Comparison:
    def __init__(
        self, source: mujoco.Model, ours: mujoco.Model, tree: Tree, stated: frozenset[str]
    ) -> None:
        self.a, self.b, self.tree, self.stated = _Side.of(source), _Side.of(ours), tree, stated
        self.names = mujoco.body_names(tree)
        self.worst: dict[str, float] = {}
        self.shown: dict[str, int] = {}
        self.compared: dict[str, list[int]] = {}

    def findings(self) -> Iterator[Finding]:
        """Counts and constants first, then motion."""
        for found in (*self.constants(), *self.motion()):
            self.shown[found.rule] = self.shown.get(found.rule, 0) + 1
            if self.shown[found.rule] <= SHOWN:
                yield found

    def figures(self) -> dict[str, object]:
        """compared: [in the source, found here] by kind."""
        return {
            "compared": dict(self.compared),
            "differences": dict(self.shown),
            "not_compared": sorted(self.stated),
            "worst_relative_error": dict(self.worst),
        }

    # --- what there is ------------------------------------------------------------------------

    def pairs(
        self, kind: str, *, expected: Iterable[str] | None = None
    ) -> list[tuple[str, int, int]]:
        """(name, id in the source, id here) of all that both have; the rest is counted."""
        wanted = list(self.a.ids[kind] if expected is None else expected)
        found = [n for n in wanted if self._here(kind, n) is not None]
        self.compared[kind] = [len(wanted), len(found)]
        return [
            (n, self.a.ids[kind][n], self.b.ids[kind][self._here(kind, n) or ""]) for n in found
        ]

    def _here(self, kind: str, name: str) -> str | None:
        if kind == "body":
            name = self.names.get(name, name)
        if kind == "joint" and self.a.model.jnt_type[self.a.ids[kind][name]] == FREE:
            return next(
                (n for n, i in self.b.ids[kind].items() if not self.b.model.jnt_type[i]), None
            )
        if kind == "site" and name not in self.b.ids[kind]:
            name = f"{name}_site"
        return name if name in self.b.ids[kind] else None

    def missing(self, kind: str, names: Iterable[str]) -> Iterator[Finding]:
        for name in names:
            if self._here(kind, name) is None:
                yield _differs("missing", f"{kind} {name}", kind, "there", "missing")

    def robot_bodies(self) -> list[str]:
        """Bodies of the source that are no scenery: not driven by hand, not below such."""
        model = self.a.model
        return [
            name
            for name, i in self.a.ids["body"].items()
            if i and int(model.body_mocapid[int(model.body_rootid[i])]) < 0
        ]

    def on_robot(self, kind: str, owners: ArrayLike) -> list[str]:
        robot = {self.a.ids["body"][name] for name in self.robot_bodies()}
        if self.tree.root == "world":
            robot.add(0)
        bodies = np.asarray(owners)
        return [name for name, i in self.a.ids[kind].items() if int(bodies[i]) in robot]

    # --- constants ------------------------------------------------------------------------------

    def constants(self) -> Iterator[Finding]:
        yield from self.bodies()
        yield from self.joints()
        yield from self.geoms()
        yield from self.sites_and_cameras()
        if "actuators" not in self.stated:
            yield from self.actuators()
        yield from self.couplings()
        yield from self.sensors()
        yield from self.options()

    def bodies(self) -> Iterator[Finding]:
        names = self.robot_bodies()
        for name in names if "merge" not in self.stated else ():
            i = self.a.ids["body"][name]
            lost = self._here("body", name) is None
            if lost and (self.a.model.body_mass[i] or name not in self.b.ids["site"]):
                yield _differs("missing", f"link {name}", "body", "there", "missing")
        for name, i, j in self.pairs("body", expected=names):
            if "merge" not in self.stated:
                mass = self.a.model.body_mass[i], self.b.model.body_mass[j]
                yield from self.same("mass", f"link {name}", "mass (kg)", *mass)
            compensated = self.a.model.body_gravcomp[i], self.b.model.body_gravcomp[j]
            yield from self.same("body", f"link {name}", "gravcomp", *compensated)
        total = self.a.model.body_mass[[self.a.ids["body"][n] for n in names]].sum()
        yield from self.same(
            "mass", "robot", "total mass (kg)", total, self.b.model.body_mass.sum()
        )

    def joints(self) -> Iterator[Finding]:
        a, b = self.a.model, self.b.model
        wanted = self.on_robot("joint", a.jnt_bodyid)
        if "base" in self.stated:
            wanted = [n for n in wanted if a.jnt_type[self.a.ids["joint"][n]] != FREE]
        yield from self.missing("joint", wanted)
        for name, i, j in self.pairs("joint", expected=wanted):
            subject = f"joint {name}"
            ref = a.qpos0[a.jnt_qposadr[i]] if a.jnt_type[i] in (SLIDE, HINGE) else 0.0
            limits = a.jnt_range[i] - ref if a.jnt_limited[i] else a.jnt_range[i] * 0
            limited = int(a.jnt_limited[i]), int(b.jnt_limited[j])
            yield from self.same("joint", subject, "type", a.jnt_type[i], b.jnt_type[j])
            yield from self.same("joint", subject, "limited", *limited)
            yield from self.same("joint", subject, "range (rad or m)", limits, b.jnt_range[j])
            fields = ["stiffness", "margin", "solref", "solimp", "group", "actfrclimited"]
            fields += ["actfrcrange", "actgravcomp", "stiffnesspoly"]
            yield from self.fields("joint", subject, "jnt", fields, i, j)
            if a.jnt_type[i] == FREE:
                continue
            u, v = int(a.jnt_dofadr[i]), int(b.jnt_dofadr[j])
            fields = ["solref", "solimp"]
            if "actuators" not in self.stated:
                fields += ["damping", "armature", "frictionloss", "dampingpoly"]
            yield from self.fields("joint", subject, "dof", fields, u, v)

    def geoms(self) -> Iterator[Finding]:
        a, b = self.a.model, self.b.model
        touches = (a.geom_contype != 0) | (a.geom_conaffinity != 0)
        wanted = [
            name
            for name in self.on_robot("geom", a.geom_bodyid)
            if "collision" not in self.stated or not touches[self.a.ids["geom"][name]]
        ]
        yield from self.missing("geom", wanted)
        for name, i, j in self.pairs("geom", expected=wanted):
            subject = f"shape {name}"
            yield from self.same("geom", subject, "type", a.geom_type[i], b.geom_type[j])
            if a.geom_type[i] != MESH:
                yield from self.same("geom", subject, "size (m)", a.geom_size[i], b.geom_size[j])
            fields = ["contype", "conaffinity", "group"]
            if touches[i]:
                fields += ["priority", "solmix", "solref", "solimp", "margin", "gap", "fluid"]
                fields += [] if "contact" in self.stated else ["friction", "condim"]
            yield from self.fields("geom", subject, "geom", fields, i, j)
            colours = self._colour(a, i), self._colour(b, j)
            yield from self.same("geom", subject, "colour", *colours, tolerance=1e-6)

    def _colour(self, model: mujoco.Model, geom: int) -> Array:
        own, material = np.array(model.geom_rgba[geom]), int(model.geom_matid[geom])
        plain = bool((own == np.float32(0.5)).sum() == 3 and own[3] == 1.0)
        return np.array(model.mat_rgba[material]) if plain and material >= 0 else own

    def sites_and_cameras(self) -> Iterator[Finding]:
        a = self.a.model
        wanted = self.on_robot("site", a.site_bodyid)
        yield from self.missing("site", wanted)
        for name, i, j in self.pairs("site", expected=wanted):
            fields = ["type", "size", "group", "rgba"]
            yield from self.fields("site", f"link {name}", "site", fields, i, j)
        for kind, prefix, owner, fields in (
            ("camera", "cam", a.cam_bodyid, ["mode", "fovy", "sensorsize", "intrinsic"]),
            ("light", "light", a.light_bodyid, ["mode", "dir", "diffuse", "castshadow", "cutoff"]),
        ):
            wanted = (
                list(self.a.ids[kind]) if self.tree.base == "fixed" else self.on_robot(kind, owner)
            )
            yield from self.missing(kind, wanted)
            for name, i, j in self.pairs(kind, expected=wanted):
                yield from self.fields(kind, f"{kind} {name}", prefix, fields, i, j)

    def actuators(self) -> Iterator[Finding]:
        a, b = self.a.model, self.b.model
        yield from self.missing("actuator", self.a.ids["actuator"])
        for name, i, j in self.pairs("actuator"):
            fields = ["trntype", "dyntype", "gaintype", "biastype", "dynprm", "gear", "group"]
            fields += ["ctrllimited", "forcelimited", "forcerange", "actlimited", "actrange"]
            yield from self.fields("actuator", f"actuator {name}", "actuator", fields, i, j)
        yield from self.same("actuator", "robot", "actuators", a.nu, b.nu)

    def couplings(self) -> Iterator[Finding]:
        """Equalities, tendons and pairs that may not touch."""
        yield from self.missing("equality", self.a.ids["equality"])
        for name, i, j in self.pairs("equality"):
            fields = ["type", "data", "solref", "solimp", "active0", "objtype"]
            yield from self.fields("equality", f"equality {name}", "eq", fields, i, j)
        yield from self.missing("tendon", self.a.ids["tendon"])
        for name, i, j in self.pairs("tendon"):
            fields = ["limited", "range", "stiffness", "damping", "frictionloss", "lengthspring"]
            fields += ["num", "margin", "solref_lim", "solimp_lim", "width", "group", "armature"]
            yield from self.fields("tendon", f"tendon {name}", "tendon", fields, i, j)
        if "merge" not in self.stated:
            lost = _excluded(self.a.model) - _excluded(self.b.model, self.names)
            for first, second in sorted(lost):
                words = f"excluded pair {first}, {second}"
                yield _differs("exclude", "robot", words, "there", "missing")
        if self.a.model.npair != self.b.model.npair:
            pairs = self.a.model.npair, self.b.model.npair
            yield from self.same("exclude", "robot", "contact pairs", *pairs)

    def sensors(self) -> Iterator[Finding]:
        yield from self.missing("sensor", self.a.ids["sensor"])
        for name, i, j in self.pairs("sensor"):
            fields = ["type", "dim", "cutoff", "noise", "intprm"]
            yield from self.fields("sensor", f"sensor {name}", "sensor", fields, i, j)

    def options(self) -> Iterator[Finding]:
        a, b = self.a.model.opt, self.b.model.opt
        for name in dir(a):
            value = getattr(a, name)
            plain = not name.startswith("_") and isinstance(value, int | float | np.ndarray)
            if plain and name not in self.stated:
                yield from self.same("option", "robot", name, value, getattr(b, name))

    # --- motion ---------------------------------------------------------------------------------

    def motion(self) -> Iterator[Finding]:
        """Both in the same positions, at the same speeds, under the same commands."""
        random = np.random.default_rng(1)
        for number in range(POSITIONS):
            self._move(random, still=number == 0)
            yield from self.poses()
            if "base" not in self.stated:
                yield from self.forces()
        yield from self.keys()

    def _move(self, random: np.random.Generator, *, still: bool) -> None:
        import mujoco as mj

        for side in (self.a, self.b):
            mj.mj_resetData(side.model, side.data)
        a, b = self.a, self.b
        for name, i in a.ids["joint"].items():
            here = self._here("joint", name)
            if here is None:
                continue
            j = b.ids["joint"][here]
            q, p = int(a.model.jnt_qposadr[i]), int(b.model.jnt_qposadr[j])
            u, v = int(a.model.jnt_dofadr[i]), int(b.model.jnt_dofadr[j])
            if a.model.jnt_type[i] == FREE:
                turn = random.normal(size=4)
                base = [*random.normal(size=3), *(turn / np.linalg.norm(turn))]
                base = [float(x) for x in a.model.qpos0[q : q + 7]] if still else base
                a.data.qpos[q : q + 7] = b.data.qpos[p : p + 7] = base
                a.data.qvel[u : u + 6] = b.data.qvel[v : v + 6] = random.normal(size=6)
                continue
            value = 0.0 if still else float(random.uniform(-1.0, 1.0))
            a.data.qpos[q], b.data.qpos[p] = a.model.qpos0[q] + value, value
            a.data.qvel[u] = b.data.qvel[v] = float(random.normal())
        for _, i, j in self.pairs("actuator"):
            command = float(random.uniform(-0.2, 0.2))
            a.data.ctrl[i], b.data.ctrl[j] = command + self._rest(i), command
        for side in (a, b):
            mj.mj_forward(side.model, side.data)

    def _rest(self, actuator: int) -> float:
        """`ref` of the joint of a position drive, from which its commands count here."""
        model = self.a.model
        joint, gain = int(model.actuator_trnid[actuator][0]), model.actuator_gainprm[actuator][0]
        pulls = gain > 0 and model.actuator_biasprm[actuator][1] == -gain
        plain = (
            not any(model.actuator_biasprm[actuator][:1]) and not model.actuator_dyntype[actuator]
        )
        if model.actuator_trntype[actuator] or not pulls or not plain:
            return 0.0
        return float(model.qpos0[model.jnt_qposadr[joint]])

    def poses(self) -> Iterator[Finding]:
        a, b = self.a.data, self.b.data
        if "merge" not in self.stated:
            for name, i, j in self.pairs("body", expected=self.robot_bodies()):
                subject = f"link {name}"
                yield from self.same("pose", subject, "axes", a.xmat[i], b.xmat[j])
                if self.a.model.body_mass[i]:
                    yield from self.same("com", subject, "centre (m)", a.xipos[i], b.xipos[j])
                    tensors = _tensor(self.a, i), _tensor(self.b, j)
                    yield from self.same("inertia", subject, "inertia (kg m2)", *tensors)
        for name, i, j in self.pairs(
            "joint", expected=self.on_robot("joint", self.a.model.jnt_bodyid)
        ):
            if self.a.model.jnt_type[i] != FREE:
                yield from self.same("axis", f"joint {name}", "axis", a.xaxis[i], b.xaxis[j])
            yield from self.same(
                "anchor", f"joint {name}", "anchor (m)", a.xanchor[i], b.xanchor[j]
            )
        for name, i, j in self.pairs(
            "site", expected=self.on_robot("site", self.a.model.site_bodyid)
        ):
            yield from self.same(
                "site", f"link {name}", "place (m)", a.site_xpos[i], b.site_xpos[j]
            )
            yield from self.same("site", f"link {name}", "axes", a.site_xmat[i], b.site_xmat[j])
        for name, i, j in self.pairs("camera"):
            yield from self.same(
                "camera", f"camera {name}", "place (m)", a.cam_xpos[i], b.cam_xpos[j]
            )
            yield from self.same("camera", f"camera {name}", "axes", a.cam_xmat[i], b.cam_xmat[j])
        yield from self.shape_poses()

    def shape_poses(self) -> Iterator[Finding]:
        a, b = self.a, self.b
        for name, i, j in self.pairs("geom", expected=self.on_robot("geom", a.model.geom_bodyid)):
            subject = f"shape {name}"
            if a.model.geom_type[i] != b.model.geom_type[j]:
                continue
            if a.model.geom_type[i] == MESH:
                if "decimated" not in self.stated:
                    lower, upper = _bounds(a, i)
                    size = float(np.linalg.norm(upper - lower))
                    error = np.abs(np.stack(_bounds(b, j)) - np.stack((lower, upper))).max()
                    bounds = [float(error)], [0.0]
                    yield from self.same(
                        "geom",
                        subject,
                        "bounds off by (m)",
                        *bounds,
                        absolute=MESH_TOLERANCE * size,
                    )
                continue
            yield from self.same(
                "geom", subject, "place (m)", a.data.geom_xpos[i], b.data.geom_xpos[j]
            )
            yield from self.same("geom", subject, "axes", a.data.geom_xmat[i], b.data.geom_xmat[j])

    def forces(self) -> Iterator[Finding]:
        """Inertia, gravity and speeds, springs and dampers, drives; and what sensors see."""
        rows = [self._dofs(side) for side in (self.a, self.b)]
        if len(rows[0]) != len(rows[1]):
            yield from self.same("dofs", "robot", "degrees of freedom", len(rows[0]), len(rows[1]))
            return
        u, v = rows
        if "actuators" not in self.stated:
            M = mujoco.mass_matrix(self.a.model, self.a.data)[np.ix_(u, u)]
            N = mujoco.mass_matrix(self.b.model, self.b.data)[np.ix_(v, v)]
            yield from self.same("mass_matrix", "robot", "mass matrix", M, N)
        names = ["qfrc_bias"] if "gravity" not in self.stated else []
        if "actuators" not in self.stated:
            names += ["qfrc_passive", "qfrc_actuator"]
        for name in names:
            x, y = getattr(self.a.data, name)[u], getattr(self.b.data, name)[v]
            yield from self.same("forces", "robot", f"{name} (N or N m)", x, y)
        for name, i, j in self.pairs("tendon"):
            lengths = self.a.data.ten_length[i], self.b.data.ten_length[j]
            yield from self.same("tendon", f"tendon {name}", "length", *lengths)
        if self.stated & {"actuators", "gravity", "collision", "contact", "merge"}:
            return  # accelerations and touches differ then, and they should
        for name, i, j in self.pairs("sensor"):
            x, y = _reading(self.a, i), _reading(self.b, j)
            # Contacts and constraints are solved to the solver's tolerance, not to rounding.
            yield from self.same("sensor", f"sensor {name}", "reading", x, y, tolerance=1e-5)

    def _dofs(self, side: _Side) -> list[int]:
        """Degrees of freedom in the order of the source's joints."""
        found: list[int] = []
        for name, i in self.a.ids["joint"].items():
            here = self._here("joint", name)
            if here is not None:
                joint = i if side is self.a else self.b.ids["joint"][here]
                width = 6 if side.model.jnt_type[joint] == FREE else 1
                first = int(side.model.jnt_dofadr[joint])
                found += range(first, first + width)
        return found

    def keys(self) -> Iterator[Finding]:
        a, b = self.a.model, self.b.model
        yield from self.missing("key", self.a.ids["key"])
        for name, i, j in self.pairs("key"):
            for joint, u, v in self.pairs("joint"):
                q, p = int(a.jnt_qposadr[u]), int(b.jnt_qposadr[v])
                width = 7 if a.jnt_type[u] == FREE else 1
                x = a.key_qpos[i][q : q + width] - (a.qpos0[q] if width == 1 else 0.0)
                if width == 7:
                    x[3:] /= np.linalg.norm(x[3:])
                y = b.key_qpos[j][p : p + width]
                yield from self.same("key", f"keyframe {name}", f"position of {joint}", x, y)
            for actuator, u, v in self.pairs("actuator") if "actuators" not in self.stated else ():
                x, y = a.key_ctrl[i][u] - self._rest(u), b.key_ctrl[j][v]
                yield from self.same("key", f"keyframe {name}", f"command of {actuator}", x, y)

    # --- comparing ------------------------------------------------------------------------------

    def fields(
        self, what: str, subject: str, prefix: str, names: Iterable[str], i: int, j: int
    ) -> Iterator[Finding]:
        """Fields `<prefix>_<name>` of both models, where this MuJoCo has them."""
        for name in names:
            key = f"{prefix}_{name}"
            if hasattr(self.a.model, key):
                x, y = getattr(self.a.model, key)[i], getattr(self.b.model, key)[j]
                yield from self.same(what, subject, name, x, y)

    def same(
        self,
        what: str,
        subject: str,
        words: str,
        expected: ArrayLike,
        found: ArrayLike,
        *,
        tolerance: float = TOLERANCE,
        absolute: float = ROUNDING,
    ) -> Iterator[Finding]:
        """A finding when two arrays differ by more than the tolerance, relative to their norm."""
        a, b = (np.atleast_1d(np.asarray(v, dtype=np.float64)).ravel() for v in (expected, found))
        if a.shape != b.shape:
            yield _differs(what, subject, words, a.tolist(), b.tolist())
            return
        distance, size = float(np.linalg.norm(a - b)), float(np.linalg.norm(a))
        if size > 0.0:
            self.worst[what] = max(distance / size, self.worst.get(what, 0.0))
        if not distance <= tolerance * size + absolute:
            yield _differs(what, subject, words, a.tolist(), b.tolist())


def _tensor(side: _Side, body: int) -> Array:
    """(3, 3) about the centre of mass, in world axes."""
    R = np.array(side.data.xmat[body]).reshape(3, 3)
    return R @ mujoco.inertia_of(side.model, body) @ R.T


def _bounds(side: _Side, geom: int) -> tuple[Array, Array]:
    """Lowest and highest corner of a mesh in the frame of its body, m."""
    model = side.model
    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    w, x, y, z = (float(v) for v in model.geom_quat[geom])
    points = model.mesh_vert[first : first + count] @ rotation_of((w, x, y, z)).T
    points = points + model.geom_pos[geom]
    return points.min(axis=0), points.max(axis=0)


def _reading(side: _Side, sensor: int) -> Array:
    first, width = int(side.model.sensor_adr[sensor]), int(side.model.sensor_dim[sensor])
    return np.array(side.data.sensordata[first : first + width])


def _excluded(model: mujoco.Model, names: Mapping[str, str] | None = None) -> set[tuple[str, str]]:
    """Pairs of body names, each sorted, in the source's words."""
    back = {written: name for name, written in (names or {}).items()}
    found = set()
    for signature in model.exclude_signature:
        pair = [
            str(model.body(int(i)).name) for i in (int(signature) >> 16, int(signature) & 0xFFFF)
        ]
        first, second = sorted(back.get(name, name) for name in pair)
        found.add((first, second))
    return found


def _differs(what: str, subject: str, words: str, expected: Any, found: Any) -> Finding:
    # Any: a list of numbers or a word
    return Finding(
        f"equal.source.{what}",
        "error",
        subject,
        f"{words}: the source has {_shown(expected)}, our MJCF {_shown(found)}",
        hint="the robot lost something on the way from MJCF to MJCF: please report it",
        data={"expected": _data(expected), "found": _data(found)},
    )


def _shown(value: Any) -> str:  # Any: as above
    if isinstance(value, list):
        return " ".join(f"{v:.9g}" for v in value[:16]) + (" ..." if len(value) > 16 else "")
    return str(value)


def _data(value: Any) -> str | tuple[float, ...]:  # Any: as above
    return tuple(float(v) for v in value[:16]) if isinstance(value, list) else str(value)
