"""Newton reads the USD and the MJCF: runs in Newton's environment, without assetbuild.

`python _newton_child.py job.json`: loads each file, hands it to `SolverMuJoCo` (MuJoCo on the
CPU), writes down what that holds, and steps it. Newton's API as of 1.8.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

UNLIMITED = 1e6
"""Newton's word for an effort or a range without limit, at least."""


def main(path: Path) -> None:
    """One answer for each file of the job, by kind."""
    job = json.loads(path.read_text(encoding="utf-8"))
    import warp

    warp.config.quiet = True
    warp.set_device("cpu")
    answer = {kind: tried(kind, file, job) for kind, file in job["files"].items()}
    path.with_name("answer.json").write_text(json.dumps(answer), encoding="utf-8")


def tried(kind: str, file: str, job: dict[str, Any]) -> dict[str, Any]:
    """What one file gives; {"failure": ...} when Newton refuses it."""
    try:
        model = loaded(kind, file)
        from newton.solvers import SolverMuJoCo

        solver = SolverMuJoCo(model, use_mujoco_cpu=True)
        held = readings(model, solver.mj_model)
        return held | {"finite": stepped(model, solver, job["steps"], job["dt"])}
    except Exception as error:  # whatever Newton says is the answer
        return {"failure": f"{type(error).__name__}: {error}"[:400]}


def loaded(kind: str, file: str) -> Any:
    """The finished model."""
    import newton
    from newton.usd import SchemaResolverNewton, SchemaResolverPhysx

    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    if kind == "usd":
        resolvers = [SchemaResolverNewton(), SchemaResolverPhysx()]
        builder.add_usd(file, schema_resolvers=resolvers)
    else:
        builder.add_mjcf(file)
    return builder.finalize()


def readings(model: Any, held: Any) -> dict[str, Any]:
    """Bodies and joints by their own names, SI; None = unlimited.

    Read from the solver's model: MJCF drives live in attributes of Newton that only it sees.
    """
    names = {"_".join(label.split("/")): label.rsplit("/", 1)[-1] for label in model.joint_label}
    names |= {name.lstrip("_"): short for name, short in names.items()}
    drives = {int(held.actuator_trnid[i, 0]): i for i in range(held.nu)}
    joints = {}
    for index in range(held.njnt):
        name = held.joint(index).name
        if int(held.jnt_type[index]) not in (2, 3):  # slide, hinge
            continue
        joints[names.get(name, name)] = joint(held, index, drives.get(index))
    return {
        "masses": {
            label.rsplit("/", 1)[-1]: float(mass)
            for label, mass in zip(model.body_label, model.body_mass.numpy(), strict=True)
        },
        "dof": int(held.nv),
        "joints": joints,
    }


def joint(held: Any, index: int, drive: int | None) -> dict[str, float | None]:
    """One joint of the solver's model."""
    dof = int(held.jnt_dofadr[index])
    efforts = [float(held.jnt_actfrcrange[index, 1])] if held.jnt_actfrclimited[index] else []
    if drive is not None and held.actuator_forcelimited[drive]:
        efforts.append(float(held.actuator_forcerange[drive, 1]))
    effort = min(efforts, default=math.inf)
    limited = bool(held.jnt_limited[index]) and abs(held.jnt_range[index]).max() < UNLIMITED
    return {
        "lower": float(held.jnt_range[index, 0]) if limited else None,
        "upper": float(held.jnt_range[index, 1]) if limited else None,
        "kp": -float(held.actuator_biasprm[drive, 1]) if drive is not None else 0.0,
        "kd": -float(held.actuator_biasprm[drive, 2]) if drive is not None else 0.0,
        "effort": effort if effort < UNLIMITED else None,
        "armature": float(held.dof_armature[dof]),
        "friction": float(held.dof_frictionloss[dof]),
        "damping": float(held.dof_damping[dof]),
    }


def stepped(model: Any, solver: Any, steps: int, dt: float) -> bool:
    """Whether all coordinates are finite after some steps in the air."""
    import newton
    import numpy

    now, after, control = model.state(), model.state(), model.control()
    newton.eval_fk(model, model.joint_q, model.joint_qd, now)
    for _ in range(steps):
        solver.step(now, after, control, None, dt)
        now, after = after, now
    return bool(numpy.isfinite(now.joint_q.numpy()).all())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
