"""Wiring faults planted in policies: which are named by `policy check`, which by `policy replay`?

python -m tests.benchmarks.wiring BUNDLE=POLICY... [--count 100] [--seed 1]

POLICY is a folder with `policy.onnx` and its `deploy.yaml`, or an ONNX file of mjlab. Each fault is
written into a copy of the files; the untouched policies must give no warning.
"""

from __future__ import annotations

import argparse
import copy
import math
import random
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import onnx
import yaml
from onnx import helper

from assetbuild.cli.policy import Wish, check_policy, replay_policy

Said = dict[str, Any]
Fault = Callable[[Said, random.Random], str]
COMMAND = (0.5, 0.0, 0.0)


def load(path: Path) -> Said:
    """The lists that a policy states, by the words of `deploy.yaml`, whichever file has them."""
    if path.suffix == ".onnx":
        props = {p.key: p.value for p in onnx.load(str(path)).metadata_props}
        lists = ("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale")
        return {"names": props["joint_names"].split(",")} | {
            key: [float(v) for v in props[key].split(",")] for key in lists
        }
    text = re.sub(r"!!python/\S+ \[.*?\]", "null", path.read_text(encoding="utf-8"))
    said: Said = yaml.safe_load(text)
    return said


def save(said: Said, source: Path, folder: Path) -> Path:
    """A copy of the policy that states this."""
    if source.suffix == ".onnx":
        model = onnx.load(str(source))
        props = {p.key: p.value for p in model.metadata_props}
        for key, values in said.items():
            if key == "names":
                props["joint_names"] = ",".join(values)
            else:
                props[key] = ",".join(f"{v:.3f}" for v in values)
        helper.set_model_props(model, props)
        onnx.save(model, str(folder / "policy.onnx"))
        return folder / "policy.onnx"
    for file in [*source.parent.parent.rglob("policy.onnx*"), *source.parent.glob("policy.onnx*")]:
        shutil.copy(file, folder)
    (folder / "deploy.yaml").write_text(yaml.safe_dump(said, sort_keys=False))
    return folder


def column(said: Said, random_: random.Random) -> tuple[str, list[float]]:
    """Gains of one kind."""
    key = random_.choice(
        [k for k in ("stiffness", "damping", "joint_stiffness", "joint_damping") if k in said]
    )
    return key, said[key]


def action(said: Said) -> list[float]:
    """The scales of the actions."""
    scale: list[float] = (
        said["action_scale"] if "names" in said else said["actions"]["JointPositionAction"]["scale"]
    )
    return scale


def exchanged_gains(said: Said, random_: random.Random) -> str:
    key, values = column(said, random_)
    pairs = [(i, j) for i in range(len(values)) for j in range(i) if values[i] != values[j]]
    if not pairs:
        return ""
    i, j = random_.choice(pairs)
    values[i], values[j] = values[j], values[i]
    return f"{key} {j} and {i} exchanged"


def gains_of_another_order(said: Said, random_: random.Random) -> str:
    key, values = column(said, random_)
    order = said.get("joint_ids_map") or sorted(range(len(values)), key=lambda i: i % 3)
    before = list(values)
    values[:] = [values[i] for i in order]
    return f"{key} in another order" if values != before else ""


def scaled_gains(said: Said, random_: random.Random) -> str:
    key, values = column(said, random_)
    factor = random_.choice((0.25, 4.0, math.radians(1.0)))
    values[:] = [factor * v for v in values]
    return f"{key} times {factor:.3g}"


def two_joints(said: Said, random_: random.Random) -> str:
    row = said.get("names") or said["joint_ids_map"]
    i, j = random_.sample(range(len(row)), 2)
    row[i], row[j] = row[j], row[i]
    return f"joints {i} and {j} exchanged"


def another_order(said: Said, random_: random.Random) -> str:
    row = said.get("names") or said["joint_ids_map"]
    before = list(row)
    row[:] = sorted(row) if row != sorted(row) else sorted(row, key=lambda name: str(name)[::-1])
    return "joints in another order" if row != before else ""


def scaled_actions(said: Said, random_: random.Random) -> str:
    factor = random_.choice((0.5, 2.0, -1.0, 4.0))
    scale = action(said)
    scale[:] = [factor * v for v in scale]
    return f"action scale times {factor:g}"


def one_sign(said: Said, random_: random.Random) -> str:
    scale = action(said)
    i = random_.randrange(len(scale))
    scale[i] = -scale[i]
    return f"action {i} has the other sign"


def pose(said: Said, random_: random.Random) -> str:
    """One joint's sign, 0 everywhere, or two joints exchanged; the offset stays or follows."""
    values = said["default_joint_pos"]
    moved = [i for i, v in enumerate(values) if abs(v) > 0.05]
    way = random_.choice(("sign", "zero", "exchanged"))
    i, j = random_.sample(moved, 2)
    if way == "sign":
        values[i] = -values[i]
    elif way == "zero":
        values[:] = [0.0] * len(values)
    elif values[i] == values[j]:
        return ""
    else:
        values[i], values[j] = values[j], values[i]
    follows = "names" in said or random_.random() < 0.5
    if follows and "actions" in said:
        said["actions"]["JointPositionAction"]["offset"] = list(values)
    return f"pose: {way} at {i}{', the offset too' if follows else ''}"


def rhythm(said: Said, random_: random.Random) -> str:
    if "step_dt" not in said:
        return ""
    said["step_dt"] *= (factor := random_.choice((0.25, 0.5, 2.0)))
    return f"time step times {factor:g}"


def observation(said: Said, random_: random.Random) -> str:
    """The sign of gravity, or the scale of a velocity."""
    terms = said.get("observations")
    if not terms:
        return ""
    name, factor = random_.choice(
        (("projected_gravity", -1.0), ("base_ang_vel", 5.0), ("joint_vel_rel", 20.0))
    )
    terms[name]["scale"] = [factor * v for v in terms[name]["scale"]]
    return f"{name} times {factor:g}"


FAULTS: tuple[Fault, ...] = (
    exchanged_gains, gains_of_another_order, scaled_gains, two_joints, another_order,
    scaled_actions, one_sign, pose, rhythm, observation,
)  # fmt: skip


def evaluate(policy: Path, bundle: Path) -> tuple[str, str]:
    """(by what it is named, in which words); nothing where it is not."""
    found = [f for f in check_policy(policy, bundle)[1] if f.severity != "info"]
    if found:
        return "check", found[0].message
    done = replay_policy(policy, bundle, Wish(command=COMMAND), lambda line: None)
    if done.diagnosis is not None:
        return "replay", done.diagnosis.fault
    return "", "; ".join(run.verdict for run in done.runs.values())


def main() -> None:
    """A line for each fault, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pairs", nargs="+", metavar="BUNDLE=POLICY")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    random_ = random.Random(arguments.seed)
    pairs = []
    for text in arguments.pairs:
        bundle, _, policy = text.partition("=")
        path = Path(policy)
        file = path if path.suffix == ".onnx" else next(path.rglob("deploy.yaml"))
        named = [f for f in check_policy(path, Path(bundle))[1] if f.severity != "info"]
        print(f"untouched {policy}: {len(named)} named", flush=True)
        pairs.append((Path(bundle), file))
    counts = {"check": 0, "replay": 0, "": 0}
    while sum(counts.values()) < arguments.count:
        bundle, file = random_.choice(pairs)
        said = copy.deepcopy(load(file))
        if not (fault := random_.choice(FAULTS)(said, random_)):
            continue
        with tempfile.TemporaryDirectory(prefix="wiring-") as folder:
            by, words = evaluate(save(said, file, Path(folder)), bundle)
        counts[by] += 1
        print(f"{by or 'MISSED':6} {bundle.name}: {fault}: {words[:140]}", flush=True)
    by_check, by_replay, missed = (counts[by] for by in ("check", "replay", ""))
    named = f"{by_check} named by check, {by_replay} by replay, {missed} by none"
    print(f"{sum(counts.values())} faults: {named}")


if __name__ == "__main__":
    main()
