"""Payloads that the generated module draws in mjlab, beside MuJoCo's own sum of body and box.

    PYTHON tests/benchmarks/mjlab_payload.py BUNDLE [ENVIRONMENTS]

PYTHON: of an environment with mjlab 1.6; nothing of assetbuild is imported. `dr.yaml` of the
bundle says what is carried. Each environment's body is compared with one that MuJoCo compiles
from the bare model with a box of the drawn mass welded on. Prints the largest relative difference
of mass, centre of mass (over its distance from the body's origin) and inertia.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def main(bundle: str, environments: str = "64") -> None:
    """Runs on the processor; all other events are left out."""
    os.environ.setdefault("CUDA_VISIBLE_DEVICES", "")
    (module,) = Path(bundle).resolve().glob("python/*_mjlab.py")
    sys.path.insert(0, str(module.parent))
    robot = importlib.import_module(module.stem)

    import yaml
    from mjlab.envs import ManagerBasedRlEnv

    stated = yaml.safe_load((Path(bundle) / "dr.yaml").read_text(encoding="utf-8"))
    cfg = robot.velocity_flat_cfg(int(environments))
    cfg.events = {k: v for k, v in robot.randomize_events().items() if k.startswith("payload_")}
    env = ManagerBasedRlEnv(cfg=cfg, device="cpu")
    for payload in stated["payloads"]:
        own = [row for row in stated["payloads"] if row["body"] == payload["body"]]
        if len(own) > 1:
            print(f"{payload['link']}: left out, its body carries {len(own)} boxes")
            continue
        rows = [compared(env, robot, payload, world) for world in range(int(environments))]
        drawn = [row[0] for row in rows]
        worst = [max(row[i] for row in rows) for i in (1, 2, 3)]
        print(
            f"{payload['link']} on {payload['body']}: {min(drawn):.3f} to {max(drawn):.3f} kg of "
            f"{payload['mass']}; mass {worst[0]:.1e}, centre {worst[1]:.1e}, inertia {worst[2]:.1e}"
        )


def compared(
    env: Any, robot: Any, payload: Mapping[str, Any], world: int
) -> tuple[float, float, float, float]:
    """(kg drawn, relative differences of mass, centre and inertia) of one environment."""
    import mujoco
    import numpy as np

    held, name = env.sim.mj_model, f"robot/{payload['body']}"
    body = mujoco.mj_name2id(held, mujoco.mjtObj.mjOBJ_BODY, name)
    fields = ("body_mass", "body_ipos", "body_inertia", "body_iquat")
    got = [getattr(env.sim.model, field)[world, body].numpy() for field in fields]
    drawn = float(got[0] - held.body_mass[body])

    spec = robot.spec()
    carrier = spec.body(payload["body"])
    if payload["link"] != payload["body"]:  # a merged link is a site of the bare model
        frame = spec.site(payload["link"])
        seat = carrier.add_body(name="seat", pos=frame.pos, quat=frame.quat)
    else:
        seat = carrier.add_body(name="seat")
    half = [edge / 2 for edge in payload["size"]]
    box = mujoco.mjtGeom.mjGEOM_BOX
    seat.add_geom(type=box, size=half, pos=payload["at"], mass=max(drawn, 1e-9))
    spec.compiler.fusestatic = True
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    whole = spec.compile()
    want = [getattr(whole.body(payload["body"]), key) for key in ("mass", "ipos", "inertia")]
    centre = float(np.linalg.norm(got[1] - want[1]) / np.linalg.norm(want[1]))
    theirs = tensor(want[2], whole.body(payload["body"]).iquat)
    inertia = float(np.abs(tensor(got[2], got[3]) - theirs).max() / np.abs(theirs).max())
    return drawn, float(abs(got[0] - want[0][0]) / want[0][0]), centre, inertia


def tensor(moments: Any, quat: Any) -> Any:
    """(3, 3) in the body's axes."""
    import mujoco
    import numpy as np

    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, np.asarray(quat, dtype=float))
    return axes.reshape(3, 3) @ np.diag(moments) @ axes.reshape(3, 3).T


if __name__ == "__main__":
    main(*sys.argv[1:])
