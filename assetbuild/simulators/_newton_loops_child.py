"""Newton swings the driven joints of a USD with loops: runs in Newton's environment alone.

`python _newton_loops_child.py job.json`: MuJoCo on the CPU through `SolverMuJoCo`, no contacts, the
base held. The answer: times in s, and positions by the names of the joint prims, rad or m.
Newton's API as of 1.8.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

UNLIMITED = 1e9
"""N m or N: an effort that no servo asks for."""


def main(path: Path) -> None:
    """One motion, or why there is none."""
    job = json.loads(path.read_text(encoding="utf-8"))
    import warp

    warp.config.quiet = True
    warp.set_device("cpu")
    try:
        answer = swung(job)
    except Exception as error:  # whatever Newton says is the answer
        answer = {"failure": f"{type(error).__name__}: {error}"[:400]}
    path.with_name("answer.json").write_text(json.dumps(answer), encoding="utf-8")


def swung(job: dict[str, Any]) -> dict[str, Any]:
    """Where every joint was; ends early where a number is not finite."""
    import newton
    import numpy

    model, solver, places = loaded(job)
    q = model.joint_q.numpy()
    for name, start in job["start"].items():
        q[places[name][0]] = start
    model.joint_q.assign(q)
    now, after, control = model.state(), model.state(), model.control()
    newton.eval_fk(model, model.joint_q, model.joint_qd, now)
    targets = control.joint_target_q.numpy()
    times: list[float] = []
    tracks: dict[str, list[float]] = {name: [] for name in job["start"]}
    for step in range(job["steps"] + 1):
        if step:
            wave = math.sin(2.0 * math.pi * job["frequency"] * job["dt"] * step)
            for name, (middle, swing, _, _) in job["servos"].items():
                targets[places[name][1]] = middle + swing * wave
            control.joint_target_q.assign(targets)
            solver.step(now, after, control, None, job["dt"])
            now, after = after, now
        if step % job["every"] and step != job["steps"]:
            continue
        q = now.joint_q.numpy()
        if not numpy.isfinite(q).all():
            return {"finite": False}
        times.append(job["dt"] * step)
        for name, track in tracks.items():
            track.append(float(q[places[name][0]]))
    return {"finite": True, "time": times, "joints": tracks, "held": int(solver.mj_model.neq)}


def loaded(job: dict[str, Any]) -> tuple[Any, Any, dict[str, tuple[int, int]]]:
    """Model, solver, and by joint the places of its position and of its target."""
    import newton
    from newton.usd import SchemaResolverNewton, SchemaResolverPhysx

    builder = newton.ModelBuilder(gravity=job["gravity"])
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    resolvers = [SchemaResolverNewton(), SchemaResolverPhysx()]
    held = {"floating": False} if job["hold"] else {}
    builder.add_usd(job["file"], schema_resolvers=resolvers, **held)
    at = {label.rsplit("/", 2)[-1]: i for i, label in enumerate(builder.joint_label)
          if "/Joints/" in label}  # fmt: skip
    for name in job["start"]:
        dof = builder.joint_qd_start[at[name]]
        builder.joint_effort_limit[dof] = UNLIMITED
        if name in job["servos"]:
            gains = job["servos"][name][2:]
            builder.joint_target_ke[dof], builder.joint_target_kd[dof] = gains
            builder.joint_target_mode[dof] = newton.JointTargetMode.POSITION
    model = builder.finalize()
    here, there = model.joint_q_start.numpy(), model.joint_target_q_start.numpy()
    places = {name: (int(here[at[name]]), int(there[at[name]])) for name in job["start"]}
    solver = newton.solvers.SolverMuJoCo(model, use_mujoco_cpu=True, disable_contacts=True)
    return model, solver, places


if __name__ == "__main__":
    main(Path(sys.argv[1]))
