"""`dr.yaml`: how far the real robot may be from its description."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.facts.derived import first_match, per_axis
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Table, Writer
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.facts.yaml_file import read_yaml, words
from assetbuild.robot.model import Actuator, Inertial

FORM = "dr"
Ranges = Mapping[str, Any]  # Any: JSON
RANGES = "how the robot may vary; what it is stands in the other files"
FACTORS = ("kp", "kd", "damping", "friction", "armature", "effort")
NO_NUMBERS = ("schema", "robot", "source")
"""Keys that draw nothing."""


class Dr(Reader):
    """All facts are words of the format (`dr:mass range`), of subjects like `range body trunk`."""

    isolated: ClassVar[bool] = False
    needs: ClassVar = ("ranges",)
    form: ClassVar[str] = FORM
    called: ClassVar[str] = "dr.yaml"
    behind: ClassVar[tuple[str, ...]] = ("dr.yaml",)
    lacks: ClassVar[Mapping[str, str]] = {kind: RANGES for kind, _ in VOCABULARY}
    asks: ClassVar[tuple[str, ...]] = ("randomize",)

    def file(self, root: Path, robot: str) -> Path | None:
        """At the top of a bundle; None where the recipe randomizes nothing."""
        path = root / "dr.yaml"
        return path if path.is_file() or self.options.get("randomize") else None

    def read(self, path: Path) -> Table:
        """What the file draws, and from what."""
        said, book = read_yaml(path), Writer()
        for kind, section in (("body", "links"), ("joint", "joints")):
            for name, row in said.pop(section, {}).items():
                _put(book, f"{kind} {name}", row)
        for number, row in enumerate(said.pop("payloads", ())):
            _put(book, f"payload {number}", row)
        _put(book, "contact", said.pop("contact", {}))
        _put(book, "", said)
        return book.plain_table()

    def expected(self, reference: Reference) -> Table:
        """From the section `randomize` of the recipe, and the numbers of the robot."""
        said, book, tree = reference.options.get("randomize"), Writer(), reference.tree
        if not said:
            return book.table()
        _put(book, "", {"seed": said["seed"]})
        for body in tree.bodies:
            matter = first_match(said["links"], body.name)
            if matter is not None and body.inertial is not None:
                _put(book, f"body {body.name}", _matter(body.inertial, matter))
        for number, payload in enumerate(said["payloads"]):
            carrier = {"link": payload["link"], "body": tree.placement(payload["link"])[0]}
            box = {word: payload[word] for word in ("mass", "size", "at")}
            _put(book, f"payload {number}", {**carrier, **box})
        for joint in tree.moving_joints:
            ranges = first_match(said["joints"], joint.name)
            if ranges is not None:
                row = reference.control.by_joint.get(joint.name)
                _put(book, f"joint {joint.name}", _joint(row, ranges))
        slide = reference.control.contact.friction[0]
        for word, nominal in (("friction", slide), ("restitution", 0.0)):
            if said[word] is not None:
                _put(book, "contact", {word: {"nominal": nominal, "range": said[word]}})
        return book.table()


def _put(book: Writer, subject: str, row: Mapping[str, Any]) -> None:  # Any: plain YAML
    facts = words(FORM, row)
    drawn = {word: value for word, value in facts.items() if not word.endswith(NO_NUMBERS)}
    seed = {word: str(value) for word, value in drawn.items() if word == f"{FORM}:seed"}
    book.put("range", subject, drawn | seed)  # every digit of a seed counts


def _matter(inertial: Inertial, matter: Ranges) -> dict[str, object]:
    """The facts of one body, whose pseudo-inertia becomes U J U', U = exp(alpha) [[A, t], [0, 1]].

    So the mass changes by exp(2 alpha): alpha is half the logarithm of the density's factor; A has
    exp(d) on its diagonal and s above it; t is the shift, m (Rucker and Wensing, 2022).
    """
    low, high = matter["density"]
    shifts, stretch, shear = per_axis(matter["com"]), matter["stretch"], matter["shear"]
    return {
        "mass": {"nominal": inertial.mass_kg, "range": [inertial.mass_kg * f for f in (low, high)]},
        "density": [low, high],
        "com": {"nominal": inertial.com_m, "shift": shifts},
        "log_cholesky": {
            "alpha": [0.5 * math.log(low), 0.5 * math.log(high)],
            "d": [-stretch, stretch],
            "s": [-shear, shear],
            "t": [[-shift, shift] for shift in shifts],
        },
    }


def _joint(row: Actuator | None, ranges: Ranges) -> dict[str, object]:
    """The facts of one joint; a factor of 1, or of a number it lacks, draws nothing."""
    bias = ranges["encoder_bias"]
    facts: dict[str, object] = {"delay": ranges["delay"], "encoder_bias": [-bias, bias]}
    for key in FACTORS:
        nominal, (low, high) = getattr(row, key, None), ranges[key]
        if nominal and not low == high == 1.0:
            facts[key] = {"nominal": nominal, "range": [nominal * low, nominal * high]}
    return facts
