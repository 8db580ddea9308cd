"""The fit of one entry of `identify`: records and priors to parameters with intervals."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.findings import Finding, Rule
from assetbuild.identify.plant import Plant
from assetbuild.identify.record import Drive, Record, smooth
from assetbuild.identify.solve import LACKS, Solution, Unknown, solve
from assetbuild.robot.codec import decode_file, encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.identify import UNITS, Fit, LogUsed, Parameter, Prediction, Related
from assetbuild.robot.model import Actuator, Control, Tree
from assetbuild.robot.pose import Array

UNLIMITED = 1e6
"""N m or N; a drive without an effort limit."""
SHOWN_CORRELATION = 0.7

REFUSED = Rule(
    "identify.refused",
    "warning",
    "the logs do not show a parameter: it keeps its prior",
    "record a motion that excites it: `assetbuild identify RECIPE --excite`",
)
PRIOR_OUTSIDE = Rule(
    "identify.prior",
    "warning",
    "a refused parameter keeps a prior that the logs contradict",
    "correct the prior in the actuator table",
)
WORSE = Rule(
    "identify.worse",
    "warning",
    "on the held-out part the fitted model predicts a joint no better than the priors",
    "check the gains in `recorded`, and whether the robot carried something",
)


class FitLogs(Step):
    """`tree.json`, `prior.json`, `records/<n>.npz`, `about/<n>.json` -> `fit.json`.

    Reads as many records as `logs` has names.
    """

    outputs = ("fit.json",)
    isolated = True
    cpu_bound = True
    preload = ("mujoco",)
    usual_s = 30.0
    limits: ClassVar[Limits] = Limits(wall_s=7200.0, memory_mb=8192)

    joints: tuple[str, ...]
    logs: tuple[str, ...]
    digests: tuple[str, ...]
    fit: tuple[tuple[str, tuple[str, ...]], ...]
    """(joint, parameters) to fit."""
    shared: tuple[str, ...] = ()
    hold_out: float
    gravity: tuple[float, float, float]
    max_relative_interval: float
    effective: bool = False
    simulator_step: float | None = None
    moving: bool = False
    """The root moved, and the records say how."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Yields a finding for each parameter that is refused."""
        tree = RobotFiles(files.inputs).tree
        prior = decode_file(Control, files.inputs / "prior.json")
        plant = Plant(tree, prior, self.joints, self.gravity, self.simulator_step, self.moving)
        priors = [drive_of(row) for row in prior.actuators]
        whole = [
            record
            for number in range(len(self.logs))
            for record in read_records(files.inputs / "records" / f"{number}.npz")
        ]
        cut = [int(len(record.position) * (1.0 - self.hold_out)) for record in whole]
        fitted = [record[:n] for record, n in zip(whole, cut, strict=True)]
        unknowns = self._unknowns(priors)
        solution = solve(
            plant, fitted, priors, unknowns, self.max_relative_interval, self.effective
        )
        parameters = tuple(self._parameters(tree, solution))
        records = list(zip(whole, cut, strict=True))
        fit = Fit(
            logs=tuple(self._used(files.inputs)),
            parameters=parameters,
            predictions=tuple(_predictions(plant, records, priors, solution)),
            related=tuple(_related(parameters, solution)),
            condition=short(solution.estimate.condition),
            recorded=tuple((row.joint, row.kp, row.kd) for row in prior.actuators),
        )
        (files.outputs / "fit.json").write_bytes(encode(fit))
        yield from _findings(fit)

    def _unknowns(self, priors: Sequence[Drive]) -> list[Unknown]:
        """Those of shared joints once; a delay is common to the joints that ask for one."""
        wanted = dict(self.fit)
        unknowns, taken = [], set()
        shared = [
            {j for j, name in enumerate(self.joints) if re.fullmatch(p, name)} for p in self.shared
        ]
        for j, joint in enumerate(self.joints):
            mates = {j}.union(*(group for group in shared if j in group))
            for name in wanted.get(joint, ()):
                if (name, j) in taken:
                    continue
                shares = range(len(self.joints)) if name == "delay" else sorted(mates)
                joints = tuple(k for k in shares if name in wanted.get(self.joints[k], ()))
                taken |= {(name, k) for k in joints}
                unknowns.append(Unknown(name, joints, getattr(priors[j], name)))
        return unknowns

    def _parameters(self, tree: Tree, solution: Solution) -> Iterator[Parameter]:
        for i, unknown in enumerate(solution.unknowns):
            if not unknown.wanted:
                continue
            names = tuple(self.joints[j] for j in unknown.joints)
            slides = tree.by_joint[names[0]].kind == "prismatic"
            has_prior = unknown.name != "delay" and unknown.prior < UNLIMITED
            yield Parameter(
                name=unknown.name,
                joints=names,
                value=short(solution.estimate.theta[i]),
                low=short(max(solution.low[i], 0.0)),
                high=short(solution.high[i]),
                prior=unknown.prior if has_prior else None,
                refused=solution.refused[i],
                unit=UNITS[unknown.name][int(slides)],
            )

    def _used(self, inputs: Path) -> Iterator[LogUsed]:
        for number, (file, digest) in enumerate(zip(self.logs, self.digests, strict=True)):
            about = json.loads((inputs / "about" / f"{number}.json").read_bytes())
            held = about["seconds"] * self.hold_out
            yield LogUsed(
                file, digest, short(about["seconds"] - held), short(held), about["rate_hz"]
            )


def short(value: float) -> float:
    """Six digits: as many as a measurement has, and no more than all CPUs agree on."""
    return float(f"{float(value):.6g}") if math.isfinite(value) else 0.0


def read_records(path: Path) -> list[Record]:
    """The stretches of one log."""
    with np.load(path) as arrays:
        period = float(arrays["period_s"])
        count = sum(name.startswith("position_") for name in arrays.files)
        return [
            Record(
                period,
                arrays[f"position_{n}"],
                arrays[f"target_{n}"],
                arrays[f"torque_{n}"] if f"torque_{n}" in arrays.files else None,
                smooth(arrays[f"base_{n}"], 1.0 / period) if f"base_{n}" in arrays.files else None,
            )
            for n in range(count)
        ]


def drive_of(row: Actuator) -> Drive:
    """The drive of a row of the table."""
    effort = UNLIMITED if row.effort is None else row.effort
    return Drive(row.kp, row.kd, row.armature, row.damping, row.friction, effort)


def _related(parameters: Sequence[Parameter], solution: Solution) -> Iterator[Related]:
    """The pairs of parameters that the data hardly separate, the closest first."""
    wanted = [i for i, unknown in enumerate(solution.unknowns) if unknown.wanted]
    table = solution.estimate.correlation[np.ix_(wanted, wanted)]
    pairs = [
        (abs(float(table[i, k])), i, k)
        for i in range(len(wanted))
        for k in range(i)
        if abs(table[i, k]) > SHOWN_CORRELATION
    ]
    for _, i, k in sorted(pairs, reverse=True)[:40]:
        yield Related(parameters[i].label, parameters[k].label, short(table[i, k]))


# --- predictions ----------------------------------------------------------------------------


def _predictions(
    plant: Plant,
    records: Sequence[tuple[Record, int]],
    priors: Sequence[Drive],
    solution: Solution,
) -> Iterator[Prediction]:
    """The RMS of each joint, as the priors and the fit predict it, from a calm moment on.

    records: with the number of samples that were fitted.
    """
    # The constant torques of the fit stand in no table.
    pairs = zip(priors, solution.drives, strict=True)
    stated = [replace(prior, offset=drive.offset) for prior, drive in pairs]
    squares: dict[str, list[Array]] = {"fitted": [], "before": [], "after": []}
    for record, fitted in records:
        calm = record.from_rest()
        cut = max(0, fitted - (len(record.position) - len(calm.position)))
        q, _ = plant.simulate(calm, [stated, solution.drives])
        before, after = (q - calm.position) ** 2
        squares["fitted"].append(after[calm.lead : cut])
        squares["before"].append(before[cut:])
        squares["after"].append(after[cut:])
    rms = {
        name: np.sqrt(np.concatenate(parts).mean(axis=0)) if sum(map(len, parts)) else None
        for name, parts in squares.items()
    }
    for j, joint in enumerate(plant.joints):
        values = {
            name: 0.0 if errors is None else short(float(errors[j])) for name, errors in rms.items()
        }
        yield Prediction(joint, **values)


# --- findings -------------------------------------------------------------------------------


def _findings(fit: Fit) -> Iterator[Finding]:
    for each in fit.parameters:
        if not each.refused:
            continue
        kept = "no prior" if each.prior is None else f"its prior {each.prior:.4g} {each.unit}"
        yield REFUSED(
            f"joint {each.joints[0]}",
            f"{each.label} is not identified: {each.refused}; it keeps {kept}",
            hint="did the robot carry or touch something, or were commands late? check `recorded`"
            if LACKS in each.refused
            else "lower gains while recording show more; `assetbuild identify RECIPE --excite` "
            "writes commands that excite it",
            data={"parameter": each.name, "low": each.low, "high": each.high},
        )
        outside = each.prior is not None and not each.low <= each.prior <= each.high
        # A model that lacks something puts what it lacks into the numbers that it has.
        if outside and LACKS not in each.refused and "together" not in each.refused:
            yield PRIOR_OUTSIDE(
                f"joint {each.joints[0]}",
                f"{each.label} keeps its prior {each.prior:.4g} {each.unit}, but the logs allow "
                f"only {each.low:.4g}..{each.high:.4g}",
                hint="state a value inside this range in the actuator table",
                data={"parameter": each.name, "low": each.low, "high": each.high},
            )
    for joint in (p for p in fit.predictions if p.after > 1.05 * p.before > 0.0):
        yield WORSE(
            f"joint {joint.joint}",
            f"held-out RMS {joint.after:.3g} with the fit, {joint.before:.3g} with the priors",
            data={"before": joint.before, "after": joint.after},
        )
