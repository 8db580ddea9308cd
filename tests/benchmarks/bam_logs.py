"""Logs of a real servo: what was fitted predicts records that the fit never saw.

    git clone https://github.com/Rhoban/bam && cd bam && git checkout af22604 && cd ..
    python -m tests.benchmarks.bam_logs bam/bam/data.bak/processed

The logs are of a Dynamixel XL330 that swings 0.49 kg at 0.1 m, at four gains of its firmware. Two
records of one gain are fitted; the records of another trajectory and of all other gains are
predicted by the MJCF of the bundle, which knows of the log no more than what stands in it. Beside
it the same recipe without the log, whose numbers are the data sheet's.
"""

from __future__ import annotations

import csv
import itertools
import json
import sys
import tempfile
from pathlib import Path
from typing import Any  # Any: the logs are JSON

import mujoco
import numpy as np

from tests.benchmarks import assetbuild

GAIN, FITTED = 400, ("sin_sin", "sin_time_square", "up_and_down")
STALL_N_M, NO_LOAD_RAD_S, RATED_V = 0.52, 10.8, 5.0
"""From the data sheet of the XL330-M288."""
DUTY_PER_RAD = 4096 / (2 * np.pi) / (256 * 885)
"""Duty for a radian at a firmware gain of 1: counts of the encoder, and the firmware's divisors."""

URDF = """<robot name="pendulum"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 {down}"/><mass value="{mass}"/>
<inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="servo" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 -1 0"/>
<limit lower="-3" upper="3" effort="{effort}" velocity="16"/></joint></robot>
"""
RECIPE = """schema: assetbuild/v1
robot: pendulum
source: {{path: ., urdf: pendulum.urdf}}
base: fixed
actuators: [{{joints: servo, model: pd, kp: {kp}, kd: {kd}, effort: {effort}}}]
keyframes: {{home: {{joints: {{servo: 0}}}}}}
targets: [mjcf]
"""


def main(folder: Path) -> None:
    """Print the table."""
    logs = [json.loads(path.read_bytes()) for path in sorted(folder.glob("*.json"))]
    logs = [log for log in logs if all(entry["torque_enable"] for entry in log["entries"])]
    own = [log for log in logs if log["kp"] == GAIN and log["trajectory"] in FITTED]
    if len(own) != len(FITTED):
        raise SystemExit(f"{folder} has not the logs of {', '.join(FITTED)} at gain {GAIN}")
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        recipe = written(place, own)
        fit = json.loads(assetbuild("identify", recipe, "--json"))[0]

        for each in fit["parameters"]:
            value = "{value:.4g} ({low:.4g}..{high:.4g})".format(**each)
            print(f"{each['name']}: {each['refused'] or value} {each['unit']}")
        assetbuild("build", recipe, "-o", place / "with", "--fail-on", "never")
        recipe.write_text(recipe.read_text(encoding="utf-8").partition("identify:")[0])
        assetbuild("build", recipe, "-o", place / "without", "--fail-on", "never")
        models = [
            mujoco.MjModel.from_xml_path(str(place / each / "mjcf/pendulum.xml"))
            for each in ("without", "with")
        ]
    print("\n| gain | trajectory | data sheet, RMS rad | identified | |")
    print("| --- | --- | --- | --- | --- |")
    for log in sorted(logs, key=lambda log: (log["kp"], log["trajectory"])):
        before, after = (rms(model, log) for model in models)
        seen = "fitted" if any(log is each for each in own) else "not seen"
        print(f"| {log['kp']} | {log['trajectory']} | {before:.3f} | {after:.3f} | {seen} |")


def written(place: Path, logs: list[dict[str, Any]]) -> Path:
    """The pendulum, its recipe and the logs as CSV."""
    first = logs[0]
    share = first["vin"] / RATED_V
    effort, kd = STALL_N_M * share, STALL_N_M / NO_LOAD_RAD_S
    kp = GAIN * DUTY_PER_RAD * effort
    (place / "pendulum.urdf").write_text(
        URDF.format(down=-first["length"], mass=first["mass"], effort=effort)
    )
    names = []
    for log in logs:
        names.append({"file": f"{log['trajectory']}.csv"})
        with (place / names[-1]["file"]).open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["time", "position_servo", "target_servo"])
            for e in log["entries"]:
                rows.writerow([e["timestamp"], e["position"], e["goal_position"]])
    entry = {
        "logs": names,
        "recorded": {"kp": kp, "kd": kd},
        "values": "effective",
        "max_relative_interval": 3,
        "fit": ["armature", "friction", "kp", "kd", "delay"],
    }
    recipe = place / "pendulum.yaml"
    text = RECIPE.format(kp=kp, kd=kd, effort=effort)
    recipe.write_text(f"{text}identify: {json.dumps([entry])}\n", encoding="utf-8")
    return recipe


def rms(model: mujoco.MjModel, log: dict[str, Any]) -> float:
    """rad, between the record and the model under the record's commands and gain."""
    share = log["kp"] / GAIN
    kp, bias = model.actuator_gainprm[0, 0], model.actuator_biasprm[0, 1]
    model.actuator_gainprm[0, 0], model.actuator_biasprm[0, 1] = kp * share, bias * share
    data = mujoco.MjData(model)
    entries = log["entries"]
    data.qpos[0] = entries[0]["position"]
    apart = []
    for entry, then in itertools.pairwise(entries):
        data.ctrl[0] = entry["goal_position"]
        while data.time + model.opt.timestep / 2 < then["timestamp"]:
            mujoco.mj_step(model, data)
        apart.append(data.qpos[0] - then["position"])
    model.actuator_gainprm[0, 0], model.actuator_biasprm[0, 1] = kp, bias
    return float(np.sqrt(np.mean(np.square(apart))))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
