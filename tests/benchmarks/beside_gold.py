"""Every difference of our Go1 and the hand-made one of MuJoCo Menagerie, with its reason.

    ASSETBUILD_SHARED=... python -m tests.benchmarks.beside_gold BUNDLE

Compares the compiled `mjcf/go1.xml` with `gold/unitree_go1.json`: counts, options, bodies, joints,
drives, collision geoms, sites, keyframe. Differences alike are one row. One that has no reason here
ends the run with 1.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

REASONS = (
    (r"number of sites", "every frame of the URDF (sensors, rotors, feet) survives as a site"),
    (r"number of sensors", "IMU and foot contacts, as the recipe asks"),
    (r"number of keyframes", "the recipe adds `crouch`"),
    (r"number of excludes", "the trunk's box reaches over the hips, beside which the thighs swing"),
    (r"number of collision geoms|collision of .*", "ours are the URDF's shapes, one to a link, and "
     "a box fitted to the trunk's mesh; Menagerie's were placed by hand along the mesh"),
    (r"total mass.*|(mass|centre of mass|inertia) of trunk.*", "Menagerie left out four hip "
     "rotors (0.089 kg each), the IMU and sensors that the URDF fixes to the trunk"),
    (r"position of trunk.*", "at rest ours stands where `home` puts it; Menagerie's drops"),
    (r"timestep.*", "the recipe's, as mjlab trains with; smaller works too"),
    (r"impratio", "50 is what our MJCF writes so that feet do not creep; Menagerie has 100"),
    (r"integrator", "implicitfast integrates gains and damping implicitly, so 5 ms are stable"),
    (r"damping of .*", "ours is all in the drive (kd); the URDF's 0.01 is dropped by the recipe"),
    (r"armature of .*", "ours is rotor inertia times gear squared; Menagerie has a round 0.01"),
    (r"kp of .*|kd of .*", "the recipe's 80 and 4, customary for quadrupeds; variant "
     "`gains_menagerie` has 100 and joint damping"),
    (r"home: .*", "hips and knees of the recipe (0.8, -1.6), base where the feet touch the ground"),
    (r"site .*", "ours keep the URDF's names and places; Menagerie's `head` is its own, its `imu` "
     "sits in the trunk's origin, its feet are called FR, FL, RR, RL"),
    (r"surface of feet.*", "radius 0.02 is the URDF's; Menagerie's 0.023 reaches to the mesh's "
     "skin and its soft solimp was tuned by hand"),
    (r"surface of others.*", "Menagerie: frictionless but for the feet (condim 1, margin 1 mm); "
     "ours: friction as in the recipe everywhere"),
    (r"name of free joint", "named, because mjlab asks for it"),
)  # fmt: skip
COUNTS = {
    "bodies": "nbody", "joints": "njnt", "drives": "nu", "sites": "nsite", "sensors": "nsensor",
    "excludes": "nexclude", "equalities": "neq", "keyframes": "nkey",
}  # fmt: skip
Row = tuple[str, str, str]


def main(bundle: str) -> int:
    """Prints the table; 1 when a difference has no reason."""
    gold = json.loads((Path(os.environ["ASSETBUILD_SHARED"]) / "gold/unitree_go1.json").read_text())
    model = mujoco.MjModel.from_xml_path(str(Path(bundle) / "mjcf/go1.xml"))
    unexplained = 0
    print("| what | ours | Menagerie | reason |\n| --- | --- | --- | --- |")
    for what, ours, theirs in _merged(differences(model, gold)):
        reason = next((why for pattern, why in REASONS if re.fullmatch(pattern, what)), None)
        unexplained += reason is None
        print(f"| {what} | {ours} | {theirs} | {reason or 'NOT EXPLAINED'} |")
    print("\nEqual: " + ", ".join(EQUAL))
    return 1 if unexplained else 0


SIX_DIGITS = 1e-6
"""Menagerie's inertials were written by MuJoCo, which rounds."""
EQUAL = (
    "bodies with their parents, places and names",
    "joints with their axes, ranges, friction and names",
    "inertials of the legs to the six digits that Menagerie has",
    "effort limits, command ranges, names and joints of the drives",
    "gravity, cone, solver iterations",
)
"""Compared below, and not in the table."""


def differences(model: mujoco.MjModel, gold: dict) -> Iterator[Row]:
    """(what, ours, theirs) of all that differs."""
    for part in (_counts, _bodies, _joints, _drives, _geoms, _rest):
        yield from part(model, gold)


def _merged(rows: Iterator[Row]) -> Iterator[Row]:
    """FR_, FL_, RR_ and RL_ with the same numbers are one row."""
    found: dict[Row, None] = {}
    for what, ours, theirs in rows:
        found[re.sub(r"\b[FR][LR]_", "*_", what), ours, theirs] = None
    yield from found


def _differ(what: str, ours: object, theirs: object, tolerance: float = 0.0) -> Iterator[Row]:
    if isinstance(theirs, str) or theirs is None:
        same = ours == theirs
    else:
        same = np.allclose(np.ravel(ours), np.ravel(theirs), rtol=0, atol=tolerance)
    if not same:
        yield what, _shown(ours), _shown(theirs)


def _shown(value: object) -> str:
    if isinstance(value, str) or value is None:
        return str(value)
    return " ".join(f"{float(v):.6g}" for v in np.ravel(np.asarray(value)))


def _counts(model: mujoco.MjModel, gold: dict) -> Iterator[Row]:
    for what, key in COUNTS.items():
        yield from _differ(f"number of {what}", getattr(model, key), gold[key])
    solid = int(_solid(model).sum())
    yield from _differ("number of collision geoms", solid, gold["ncollision_geom"])
    yield from _differ("total mass, kg", model.body_mass.sum(), gold["total_mass"], 1e-6)
    option, theirs = model.opt, gold["option"]
    integrator, cone = mujoco.mjtIntegrator(option.integrator), mujoco.mjtCone(option.cone)
    yield from _differ("timestep, s", option.timestep, theirs["timestep"])
    yield from _differ("gravity", option.gravity, theirs["gravity"])
    yield from _differ("integrator", integrator.name, theirs["integrator"])
    yield from _differ("cone", cone.name, theirs["cone"])
    for name in ("impratio", "iterations", "ls_iterations"):
        yield from _differ(name, getattr(option, name), theirs[name])


def _bodies(model: mujoco.MjModel, gold: dict) -> Iterator[Row]:
    for body in gold["bodies"]:
        name, ours = body["name"], model.body(body["name"])
        yield from _differ(f"parent of {name}", model.body(ours.parentid[0]).name, body["parent"])
        yield from _differ(f"position of {name}, m", ours.pos, body["pos"], 1e-9)
        yield from _differ(f"turn of {name}", ours.quat, body["quat"], 1e-9)
        yield from _differ(f"mass of {name}, kg", ours.mass, body["mass"], 1e-9)
        yield from _differ(f"centre of mass of {name}, m", ours.ipos, body["ipos"], SIX_DIGITS)
        mine = _tensor(ours.iquat, ours.inertia)
        other = _tensor(body["iquat"], body["principal_inertia"])
        if np.abs(mine - other).max() > 1e-5 * np.abs(other).max():
            mine, other = np.linalg.eigvalsh(mine), np.linalg.eigvalsh(other)
            yield f"inertia of {name}, principal, kg m2", _shown(mine), _shown(other)


def _tensor(quat, moments) -> np.ndarray:  # type: ignore[no-untyped-def] # numbers of a table
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quat, dtype=float) / np.linalg.norm(quat))
    axes = matrix.reshape(3, 3)
    return axes @ np.diag(np.ravel(moments)) @ axes.T


def _joints(model: mujoco.MjModel, gold: dict) -> Iterator[Row]:
    for joint in gold["joints"]:
        if joint["name"] is None:
            yield from _differ("name of free joint", model.joint(0).name, None)
            continue
        ours, name = model.joint(joint["name"]), joint["name"]
        yield from _differ(f"body of {name}", model.body(ours.bodyid[0]).name, joint["body"])
        yield from _differ(f"axis of {name}", ours.axis, joint["axis"], 1e-9)
        yield from _differ(f"range of {name}, rad", ours.range, joint["range"], 1e-9)
        for what in ("damping", "armature", "frictionloss"):
            yield from _differ(f"{what} of {name}", getattr(ours, what)[0], joint[what], 1e-9)


def _drives(model: mujoco.MjModel, gold: dict) -> Iterator[Row]:
    for drive in gold["actuators"]:
        ours, name = model.actuator(drive["name"]), drive["name"]
        yield from _differ(f"joint of {name}", model.joint(ours.trnid[0]).name, drive["joint"])
        yield from _differ(f"kp of {name}", ours.gainprm[0], drive["kp"])
        yield from _differ(f"kd of {name}", -ours.biasprm[2], -drive["bias"][2])
        yield from _differ(f"command range of {name}", ours.ctrlrange, drive["ctrlrange"], 1e-9)
        yield from _differ(f"effort of {name}, N m", ours.forcerange, drive["forcerange"], 1e-9)


def _geoms(model: mujoco.MjModel, gold: dict) -> Iterator[Row]:
    ours = [_geom(model, int(i)) for i in np.flatnonzero(_solid(model))]
    for name in dict.fromkeys(geom["body"] for geom in gold["collision_geoms"]):
        own, their = (
            [geom for geom in geoms if geom["body"] == name]
            for geoms in (ours, gold["collision_geoms"])
        )
        yield from _differ(f"collision of {name}", _kinds(own), _kinds(their))
        for who in ("feet", "others"):
            mine, other = (
                {_surface(g) for g in geoms if (g["type"] == "sphere") == (who == "feet")}
                for geoms in (own, their)
            )
            if mine and other and mine != other:
                yield f"surface of {who}", "; ".join(sorted(mine)), "; ".join(sorted(other))


def _solid(model: mujoco.MjModel) -> np.ndarray:
    """Which geoms collide."""
    return (model.geom_contype != 0) | (model.geom_conaffinity != 0)


def _geom(model: mujoco.MjModel, i: int) -> dict:
    """Return the attributes of a geom that the gold table lists."""
    geom = model.geom(i)
    kind = mujoco.mjtGeom(int(geom.type[0])).name.removeprefix("mjGEOM_").lower()
    said = {"body": model.body(geom.bodyid[0]).name, "type": kind}
    said |= {key: getattr(geom, key) for key in ("size", "friction", "solimp")}
    return said | {key: getattr(geom, key)[0] for key in ("condim", "priority", "margin")}


def _kinds(geoms: list[dict]) -> str:
    counts = Counter(geom["type"] for geom in geoms)
    return ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))


def _surface(geom: dict) -> str:
    radius = f"radius {geom['size'][0]:g}, " if geom["type"] == "sphere" else ""
    return (
        f"{radius}condim {geom['condim']}, friction {_shown(geom['friction'])}, "
        f"priority {geom['priority']}, solimp {_shown(geom['solimp'][:3])}, "
        f"margin {geom['margin']:g}"
    )


def _rest(model: mujoco.MjModel, gold: dict) -> Iterator[Row]:
    for site in gold["sites"]:
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, site["name"])
        if index < 0:
            yield f"site {site['name']}", "absent", f"in {site['body']}, {_shown(site['pos'])}"
    home, key = model.key("home"), gold["keyframes"][0]
    yield from _differ("home: base height, m", home.qpos[2], key["qpos"][2], 1e-9)
    for index, joint in ((7, "hip"), (8, "thigh"), (9, "knee")):
        yield from _differ(f"home: {joint}, rad", home.qpos[index], key["qpos"][index], 1e-9)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
