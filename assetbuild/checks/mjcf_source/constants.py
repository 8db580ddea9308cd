"""What does not move: masses, ranges, surfaces, gains, couplings, sensors, options."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from assetbuild.checks.mjcf_source.compare import (
    BODY,
    FREE,
    HINGE,
    MESH,
    SIZES,
    SLIDE,
    WRAP_JOINT,
    Comparison,
    Side,
    differs,
)
from assetbuild.findings import Finding
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco


class Constants(Comparison):
    """Fields of the compiled models."""

    def constants(self) -> Iterator[Finding]:
        """Everything that can be compared without a position."""
        yield from self._bodies()
        yield from self._joints()
        yield from self._geoms()
        yield from self._sites_and_cameras()
        if "actuators" not in self.stated:
            yield from self._actuators()
        yield from self._couplings()
        yield from self._sensors()
        yield from self._options()

    def _bodies(self) -> Iterator[Finding]:
        names = self.robot_bodies()
        for name in names if "merge" not in self.stated else ():
            i = self.a.ids["body"][name]
            lost = self.here("body", name) is None
            if lost and (self.a.model.body_mass[i] or name not in self.b.ids["site"]):
                yield differs("missing", f"link {name}", "body", "there", "missing")
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

    def _joints(self) -> Iterator[Finding]:
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
            free = a.jnt_type[i] == FREE
            # A class may give a free joint what belongs to limits, of which it has none.
            fields = [] if free else ["margin", "solref", "solimp", "actfrclimited", "actfrcrange"]
            fields += ["stiffness", "group", "actgravcomp", "stiffnesspoly"]
            yield from self.fields("joint", subject, "jnt", fields, i, j)
            if free:
                continue
            u, v = int(a.jnt_dofadr[i]), int(b.jnt_dofadr[j])
            fields = ["solref", "solimp"]
            if "actuators" not in self.stated:
                fields += ["damping", "armature", "frictionloss", "dampingpoly"]
            yield from self.fields("joint", subject, "dof", fields, u, v)

    def _geoms(self) -> Iterator[Finding]:
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
                count = SIZES.get(int(a.geom_type[i]), 3)
                sizes = a.geom_size[i][:count], b.geom_size[j][:count]
                yield from self.same("geom", subject, "size (m)", *sizes)
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

    def _sites_and_cameras(self) -> Iterator[Finding]:
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

    def _actuators(self) -> Iterator[Finding]:
        a, b = self.a.model, self.b.model
        yield from self.missing("actuator", self.a.ids["actuator"])
        for name, i, j in self.pairs("actuator"):
            fields = ["trntype", "dyntype", "gaintype", "biastype", "dynprm", "gear", "group"]
            fields += ["ctrllimited", "forcelimited", "forcerange", "actlimited", "actrange"]
            yield from self.fields("actuator", f"actuator {name}", "actuator", fields, i, j)
        yield from self.same("actuator", "robot", "actuators", a.nu, b.nu)

    def _couplings(self) -> Iterator[Finding]:
        """Equalities, tendons and pairs that may not touch."""
        yield from self.missing("equality", self.a.ids["equality"])
        for name, i, j in self.pairs("equality"):
            subject = f"equality {name}"
            fields = ["type", "solref", "solimp", "active0", "objtype"]
            yield from self.fields("equality", subject, "eq", fields, i, j)
            data = _equality_data(self.a, i), _equality_data(self.b, j)
            yield from self.same("equality", subject, "data", *data)
        yield from self.missing("tendon", self.a.ids["tendon"])
        for name, i, j in self.pairs("tendon"):
            fields = ["limited", "range", "stiffness", "damping", "frictionloss", "lengthspring"]
            fields += ["num", "margin", "solref_lim", "solimp_lim", "group", "armature"]
            spatial = self.a.model.wrap_type[self.a.model.tendon_adr[i]] != WRAP_JOINT
            fields += ["width"] if spatial else []
            yield from self.fields("tendon", f"tendon {name}", "tendon", fields, i, j)
        if "merge" not in self.stated:
            there = _excluded(self.a.model)
            lost = there - _excluded(self.b.model, self.names) - self._filtered(there)
            for first, second in sorted(lost):
                words = f"excluded pair {first}, {second}"
                yield differs("exclude", "robot", words, "there", "missing")
        if self.a.model.npair != self.b.model.npair:
            pairs = self.a.model.npair, self.b.model.npair
            yield from self.same("exclude", "robot", "contact pairs", *pairs)

    def _filtered(self, pairs: set[tuple[str, str]]) -> set[tuple[str, str]]:
        """Pairs of the source's bodies that MuJoCo leaves out in ours by its own rule."""
        index = self.b.ids["body"]
        ours = {pair: [index.get(self.names.get(name, name), 0) for name in pair] for pair in pairs}
        model = self.b.model
        return {pair for pair, (a, b) in ours.items() if a and b and mujoco.passes(model, a, b)}

    def _sensors(self) -> Iterator[Finding]:
        yield from self.missing("sensor", self.a.ids["sensor"])
        for name, i, j in self.pairs("sensor"):
            fields = ["type", "dim", "cutoff", "noise", "intprm"]
            yield from self.fields("sensor", f"sensor {name}", "sensor", fields, i, j)

    def _options(self) -> Iterator[Finding]:
        a, b = self.a.model.opt, self.b.model.opt
        for side in (self.a, self.b):
            _fold_gravity(side.model)
        for name in dir(a):
            value = getattr(a, name)
            plain = not name.startswith("_") and isinstance(value, int | float | np.ndarray)
            if plain and name not in self.stated:
                yield from self.same("option", "robot", name, value, getattr(b, name))


def _fold_gravity(model: mujoco.Model) -> None:
    """Gravity that a flag switches off is none: two ways to say one thing."""
    import mujoco as mj

    bit = int(mj.mjtDisableBit.mjDSBL_GRAVITY)
    if int(model.opt.disableflags) & bit:
        model.opt.disableflags &= ~bit
        model.opt.gravity[:] = 0.0


def _equality_data(side: Side, equality: int) -> Array:
    """Its numbers; the two anchors of `connect` in the world at rest: bodies' frames may differ."""
    import mujoco as mj

    model, data = side.model, np.array(side.model.eq_data[equality])
    if model.eq_type[equality] != mj.mjtEq.mjEQ_CONNECT or model.eq_objtype[equality] != BODY:
        return data
    mj.mj_resetData(model, side.data)
    mj.mj_kinematics(model, side.data)
    bodies = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    anchors = [
        side.data.xpos[body] + side.data.xmat[body].reshape(3, 3) @ data[3 * n : 3 * n + 3]
        for n, body in enumerate(bodies)
    ]
    # A floating base rests elsewhere here: what counts is where the anchors are to one another.
    return np.asarray(anchors[0] - anchors[1])


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
