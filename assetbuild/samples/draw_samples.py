"""Robots that could exist: the recipe's ranges drawn, and the draws judged."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping

import numpy as np

from assetbuild.engine.step import Files, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.robot.codec import decode_file, encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import combine, matrix_of, move_inertial
from assetbuild.robot.model import Body, Inertial, Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.randomize import (
    BodySample,
    DoesNotFitError,
    Draws,
    Ellipsoid,
    InertialRanges,
    JointSample,
    Rooms,
    Sample,
    Samples,
    draw,
    homogeneous_box,
    inconsistent,
    unit_draws,
)
from assetbuild.robot.ranges import (
    JOINT_FACTORS,
    Randomize,
    RandomPayload,
    first_match,
    per_axis,
)

WASTEFUL = 0.5
"""Share of draws that fit into the link, below which the ranges are reported as too wide."""

ACCEPTANCE = Rule(
    "randomize.acceptance",
    "warning",
    "more than half of the draws for a body leave its geometry",
    "narrow the ranges",
)


class DrawSamples(Step):
    """`tree.json`, `rooms.json` -> `samples.json`, `statistics.json`."""

    outputs = ("samples.json", "statistics.json")

    randomize: Randomize
    keep: int = 16
    """Samples to write down."""
    judge: int = 10_000
    """Samples to draw for the statistics; the kept ones are the first of them."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises StepError where the ranges lead out of a link."""
        tree = RobotFiles(files.inputs).tree
        rooms = {
            room.body: room.ellipsoid
            for room in decode_file(Rooms, files.inputs / "rooms.json").rooms
        }
        draws = dict(self._draws(tree, rooms))
        samples = tuple(self._sample(tree, draws, index) for index in range(self.keep))
        (files.outputs / "samples.json").write_bytes(encode(Samples(samples)))
        rows = [_statistics(tree.by_body[name], drawn) for name, drawn in draws.items()]
        text = json.dumps({"draws": self._count, "bodies": rows}, sort_keys=True, indent=1)
        (files.outputs / "statistics.json").write_text(text + "\n", encoding="utf-8")
        for name, drawn in draws.items():
            if drawn.acceptance < WASTEFUL:
                yield ACCEPTANCE(
                    f"link {name}",
                    f"only {drawn.acceptance:.0%} of the draws are matter inside the link: "
                    "what is kept is no longer uniform",
                    hint="narrow `com`, `stretch` or `shear` for it in `randomize.links`",
                    data={"acceptance": round(drawn.acceptance, 4)},
                )

    @property
    def _count(self) -> int:
        return max(self.keep, self.judge)

    def _draws(self, tree: Tree, rooms: Mapping[str, Ellipsoid]) -> Iterator[tuple[str, Draws]]:
        count, seed = self._count, self.randomize.seed
        for name, body in tree.by_body.items():
            matter = first_match(self.randomize.links, name)
            if matter is None or body.inertial is None or name not in rooms:
                continue
            com, stretch, shear = per_axis(matter.com), matter.stretch, matter.shear
            ranges = InertialRanges(matter.density, com, stretch, shear)
            try:
                yield name, draw(body.inertial, ranges, count, seed, name, rooms[name])
            except DoesNotFitError as error:
                hint = "check its inertia and the scale of its meshes, or narrow `com` (10 mm if "
                hint += "none is stated), `stretch` or `shear` in `randomize.links`"
                raise StepError(str(error), hint=hint) from None

    def _sample(self, tree: Tree, draws: Mapping[str, Draws], index: int) -> Sample:
        payloads = tuple(
            self._between(f"payload/{number}", payload.mass, index)
            for number, payload in enumerate(self.randomize.payloads)
        )
        bodies = []
        for body in tree.bodies:
            inertial = draws[body.name].inertial(index) if body.name in draws else body.inertial
            for payload, mass in zip(self.randomize.payloads, payloads, strict=True):
                inertial = _loaded(tree, body.name, inertial, payload, mass)
            if inertial is not None and inertial != body.inertial:
                bodies.append(BodySample(body.name, inertial))
        joints = [self._joint(joint.name, index) for joint in tree.moving_joints]
        friction = self.randomize.friction
        return Sample(
            bodies=tuple(bodies),
            joints=tuple(joint for joint in joints if joint is not None),
            payloads_kg=payloads,
            friction=None if friction is None else self._between("friction", friction, index),
        )

    def _joint(self, name: str, index: int) -> JointSample | None:
        ranges = first_match(self.randomize.joints, name)
        if ranges is None:
            return None
        unit = self._unit(f"joint/{name}", index, len(JOINT_FACTORS) + 2)
        factors = {
            key: _scaled(getattr(ranges, key), float(value))
            for key, value in zip(JOINT_FACTORS, unit, strict=False)
        }
        least, most = ranges.delay
        delay = min(most, least + int((unit[-2] + 1) / 2 * (most - least + 1)))
        return JointSample(
            name, **factors, delay=delay, encoder_bias=ranges.encoder_bias * unit[-1]
        )

    def _between(self, name: str, pair: tuple[float, float], index: int) -> float:
        return _scaled(pair, self._unit(name, index, 1)[0])

    def _unit(self, name: str, index: int, width: int) -> list[float]:
        row = unit_draws(self.randomize.seed, name, 0, index + 1, width)[index]
        return [float(value) for value in row]


def _scaled(pair: tuple[float, float], unit: float) -> float:
    """-1..1 onto a range."""
    return (pair[0] + pair[1]) / 2 + (pair[1] - pair[0]) / 2 * unit


def _loaded(
    tree: Tree, body: str, inertial: Inertial | None, payload: RandomPayload, mass: float
) -> Inertial | None:
    """The body with the payload on it, if it carries it."""
    carrier, X_body_link = tree.placement(payload.link)
    if carrier != body or mass == 0.0:
        return inertial
    box = move_inertial(homogeneous_box(mass, payload.size, payload.at), X_body_link)
    return combine([inertial, box]) if inertial else box


def _statistics(body: Body, drawn: Draws) -> dict[str, object]:
    """What the draws of one body are like."""
    assert body.inertial is not None  # noqa: S101 # only bodies with mass are drawn
    rows = drawn.rows
    return {
        "body": body.name,
        "mass_kg": _spread(rows[:, 0]),
        "com_shift_m": _spread(np.linalg.norm(rows[:, 1:4] - body.inertial.com_m, axis=1)),
        "largest_moment_kg_m2": _spread(
            np.asarray(np.linalg.eigvalsh(matrix_of(rows[:, 4:])))[:, 2]
        ),
        "inconsistent": int(inconsistent(rows).sum()),
        "acceptance": drawn.acceptance,
    }


def _spread(values: Array) -> dict[str, object]:
    low, middle, high = (float(v) for v in np.quantile(values, (0.0, 0.5, 1.0)))
    least = 1e-9 * max(abs(low), abs(high), 1e-9)  # draws without any spread are one bar
    edges = (low, high) if high - low > least else (low - least, high + least)
    counts, _ = np.histogram(values, bins=40, range=edges)
    histogram = [int(n) for n in counts]
    return {"least": low, "median": middle, "most": high, "histogram": histogram}
