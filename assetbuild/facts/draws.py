"""What the recipe's `randomize` draws, as facts that `dr.yaml` and the trainers' modules share.

`drawn:density` of a body, `drawn:kp` of a joint: the least and the most, of a factor or of an
offset in SI units. A range that changes nothing is no fact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from assetbuild.facts.derived import first_match, per_axis
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Key, Table, Value
from assetbuild.robot.model import Actuator
from assetbuild.robot.pose import Pose

Ranges = Mapping[str, Any]
"""A section of the recipe's `randomize`. Any: JSON."""
Draws = Callable[[Actuator | None, str], object]
"""Whether a format draws one of `FACTORS` of a joint with this drive."""
FACTORS = ("kp", "kd", "effort", "damping", "friction", "armature")
SHEARS = ("shear 12", "shear 13", "shear 23")
OF_MATTER = ("density", "com x", "com y", "com z", "stretch", *SHEARS)


def varied(reference: Reference, section: str, name: str) -> Ranges | None:
    """What the recipe's `randomize` says of a body (`links`) or a joint (`joints`)."""
    table = (reference.options.get("randomize") or {}).get(section) or {}
    ranges: Ranges | None = first_match(table, name)
    return ranges


def put_draw(table: Table, kind: str, name: str, word: str, stated: Any) -> None:  # Any: JSON
    """Note what is drawn of a subject; several draws of one quantity one after another."""
    numbers = tuple(_flat(stated))
    unchanged = 1.0 if word in (*FACTORS, "density") else 0.0
    if any(number != unchanged for number in numbers):
        key = Key(kind, name, f"drawn:{word}")
        before: Value = table.facts.get(key, ())
        table.facts[key] = (*before, *numbers)  # type: ignore[misc] # a tuple, as written here


def _flat(stated: Any) -> Iterator[Any]:  # Any: as above
    """All numbers of a matrix, row by row."""
    if isinstance(stated, list | tuple):
        for item in stated:
            yield from _flat(item)
    elif stated is not None:
        yield stated


def drawn(reference: Reference, draws: Draws, without: tuple[str, ...] = ()) -> Table:
    """All that a format must draw. without: the words that it has no way to draw."""
    table, tree = Table(), reference.tree
    recipe = reference.options.get("randomize") or {}
    for body in tree.bodies:
        matter = varied(reference, "links", body.name)
        for word, pair in _matter(matter) if matter and not body.is_massless else ():
            put_draw(table, "body", body.name, word, pair)
    for payload in recipe.get("payloads", ()):
        name, X_body_link = tree.placement(payload["link"])
        if not tree.by_body[name].is_massless:
            put_draw(table, "body", name, "payload mass", payload["mass"])
            put_draw(table, "body", name, "payload box", _box(payload, X_body_link))
    for joint in tree.moving_joints:
        ranges = varied(reference, "joints", joint.name) or {}
        row = reference.control.by_joint.get(joint.name)
        for word in FACTORS:
            if draws(row, word):
                put_draw(table, "joint", joint.name, word, ranges.get(word))
        bias = ranges.get("encoder_bias") or 0.0
        put_draw(table, "joint", joint.name, "encoder bias", (-bias, bias))
    put_draw(table, "robot", "", "surface friction", recipe.get("friction"))
    put_draw(table, "robot", "", "restitution", recipe.get("restitution"))
    return table.only(lambda key: key.quantity.removeprefix("drawn:") not in without)


def _matter(matter: Ranges) -> Iterator[tuple[str, tuple[float, float]]]:
    yield "density", tuple(matter["density"])
    for axis, most in zip("xyz", per_axis(matter["com"]), strict=True):
        yield f"com {axis}", (-most, most)
    yield "stretch", (-matter["stretch"], matter["stretch"])
    for shear in SHEARS:
        yield shear, (-matter["shear"], matter["shear"])


def _box(payload: Ranges, X_body_link: Pose) -> list[list[float]]:
    """(4, 4) [[S, h], [h, 1]] of one kilogram: second moments e²/12 along its edges, m²."""
    turn = X_body_link.rotation
    centre = turn @ np.array(payload["at"]) + np.array(X_body_link.xyz)
    matter = np.eye(4)
    second = turn @ np.diag(np.square(payload["size"]) / 12.0) @ turn.T
    matter[:3, :3] = second + np.outer(centre, centre)
    matter[:3, 3] = matter[3, :3] = centre
    box: list[list[float]] = matter.tolist()
    return box
