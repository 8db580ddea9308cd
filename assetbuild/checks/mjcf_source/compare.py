"""Two models held together by name, and numbers compared."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco

TOLERANCE = 1e-9
"""Relative to the size of what is compared; sums of sines and cosines round to about 1e-15."""
ROUGH = 1e-5
"""The same where an old MuJoCo turned a full inertia to its axes, see `is_rough`."""
ROUNDING = 1e-11
"""Absolute, SI units."""

FREE, SLIDE, HINGE = 0, 2, 3
MESH = 7
SIZES = {0: 3, 2: 1, 3: 2, 4: 3, 5: 2, 6: 3}
"""Numbers of a size that mean something, by MuJoCo's number of the kind: plane, sphere, capsule,
ellipsoid, cylinder, box. The others are whatever the file said."""
BODY = 1
WRAP_JOINT = 1
"""MuJoCo's numbers of kinds of joints, geoms, objects and parts of tendons."""

DIFFERS = Rule(
    "equal.source.*",
    "error",
    "our MJCF differs from the MJCF that it was read from, at rest or moving",
    "report it with both numbers: this is a bug",
)


@dataclass
class Side:
    """One model: ids by name of every kind, and its state."""

    model: mujoco.Model
    data: mujoco.Data
    ids: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @classmethod
    def of(cls, model: mujoco.Model) -> Side:
        """A model at rest."""
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


class Comparison:
    """A source and our MJCF. stated: what the recipe says itself, see `MjcfSource`."""

    def __init__(
        self, source: mujoco.Model, ours: mujoco.Model, tree: Tree, stated: frozenset[str]
    ) -> None:
        self.a, self.b, self.tree, self.stated = Side.of(source), Side.of(ours), tree, stated
        self.names = mujoco.body_names(tree)
        self.tolerance = TOLERANCE
        self.worst: dict[str, float] = {}
        self.shown: dict[str, int] = {}
        self.compared: dict[str, list[int]] = {}

    def figures(self) -> dict[str, object]:
        """compared: [in the source, found here] by kind."""
        return {
            "compared": dict(self.compared),
            "differences": dict(self.shown),
            "not_compared": sorted(self.stated),
            "tolerance": self.tolerance,
            "worst_relative_error": dict(self.worst),
        }

    # --- what there is ------------------------------------------------------------------------

    def pairs(
        self, kind: str, *, expected: Iterable[str] | None = None
    ) -> list[tuple[str, int, int]]:
        """(name, id in the source, id here) of all that both have; the rest is counted."""
        wanted = list(self.a.ids[kind] if expected is None else expected)
        found = [n for n in wanted if self.here(kind, n) is not None]
        self.compared[kind] = [len(wanted), len(found)]
        return [(n, self.a.ids[kind][n], self.b.ids[kind][self.here(kind, n) or ""]) for n in found]

    def here(self, kind: str, name: str) -> str | None:
        """The name of the same thing in our MJCF; None when it is not there."""
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
        """A finding for each that our MJCF lacks."""
        for name in names:
            if self.here(kind, name) is None:
                yield differs("missing", f"{kind} {name}", kind, "there", "missing")

    def robot_bodies(self) -> list[str]:
        """Bodies of the source that are no scenery: not driven by hand, not below such."""
        model = self.a.model
        return [
            name
            for name, i in self.a.ids["body"].items()
            if i and int(model.body_mocapid[int(model.body_rootid[i])]) < 0
        ]

    def on_robot(self, kind: str, owners: ArrayLike) -> list[str]:
        """Names of those that sit on the robot. owners: body of each."""
        robot = {self.a.ids["body"][name] for name in self.robot_bodies()}
        if self.tree.root == "world":
            robot.add(0)
        bodies = np.asarray(owners)
        return [name for name, i in self.a.ids[kind].items() if int(bodies[i]) in robot]

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
        tolerance: float | None = None,
        absolute: float = ROUNDING,
    ) -> Iterator[Finding]:
        """A finding when two arrays differ by more than the tolerance, relative to their norm."""
        a, b = (np.atleast_1d(np.asarray(v, dtype=np.float64)).ravel() for v in (expected, found))
        if a.shape != b.shape:
            yield differs(what, subject, words, a.tolist(), b.tolist())
            return
        distance, size = float(np.linalg.norm(a - b)), float(np.linalg.norm(a))
        if size > 0.0:
            self.worst[what] = max(distance / size, self.worst.get(what, 0.0))
        slack = self.tolerance if tolerance is None else tolerance
        if not distance <= slack * size + absolute:
            yield differs(what, subject, words, a.tolist(), b.tolist())


def differs(what: str, subject: str, words: str, expected: Any, found: Any) -> Finding:
    """The finding for two values."""
    # Any: a list of numbers or a word
    return DIFFERS.named(what)(
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
