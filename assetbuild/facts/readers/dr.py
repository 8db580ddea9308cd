"""`dr.yaml`: how far the real robot may be from its description."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.facts.draws import FACTORS, SHEARS, drawn, put_draw, varied
from assetbuild.facts.plain_yaml import read_yaml
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Key, Table, Writer
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.robot.model import Actuator

PAYLOAD = ("link", "mass", "size", "at")
CONTACT = {"friction": "surface friction", "restitution": "restitution"}
Row = Mapping[str, Any]
"""A table of the file. Any: YAML."""


class Dr(Reader):
    """Ranges as what every format draws, with the nominal values that the file states."""

    isolated: ClassVar[bool] = False
    needs: ClassVar = ("ranges",)
    form: ClassVar[str] = "dr"
    called: ClassVar[str] = "dr.yaml"
    behind: ClassVar[tuple[str, ...]] = ("dr.yaml",)
    lacks: ClassVar[Mapping[str, str]] = {
        kind: "how the robot may vary; what it is stands in the other files"
        for kind, _ in VOCABULARY
    }
    asks: ClassVar[tuple[str, ...]] = ("randomize",)

    def file(self, root: Path, robot: str) -> Path | None:
        """At the top of a bundle; None where the recipe randomizes nothing."""
        path = root / "dr.yaml"
        return path if path.is_file() or self.options.get("randomize") else None

    def read(self, path: Path) -> Table:
        """What the file draws, and from what."""
        said, book = read_yaml(path), Writer()
        for name, row in said.get("links", {}).items():
            facts = {"dr:mass": _with_nominal(row["mass"]), "dr:com": row["com"]["nominal"]}
            book.put("body", name, facts)
            for word, pair in _matter(row):
                put_draw(book, "body", name, word, pair)
        for name, row in said.get("joints", {}).items():
            book.put("joint", name, {"dr:delay": row["delay"]})
            put_draw(book, "joint", name, "encoder bias", row["encoder_bias"])
            for word in FACTORS:
                put_draw(book, "joint", name, word, _with_nominal(row.get(word)))
        for number, row in enumerate(said.get("payloads", ())):
            facts = {f"dr:{word}": row.get(word) for word in (*PAYLOAD, "body")}
            book.put("payload", str(number), facts)
        for word, row in said.get("contact", {}).items():
            put_draw(book, "robot", "", CONTACT[word], _with_nominal(row))
        book.put("robot", "", {"dr:seed": str(said.get("seed"))})  # every digit counts
        return book.plain_table()

    def expected(self, reference: Reference) -> Table:
        """From the section `randomize` of the recipe, and the numbers of the robot."""
        said, book = reference.options.get("randomize"), Writer()
        if not said:
            return book.table()

        def draws(row: Actuator | None, word: str) -> bool:
            return bool(getattr(row, word, None))  # a number that the joint has

        for key, pair in drawn(reference, draws, ("payload mass", "payload box")).facts.items():
            book.facts[key] = _stated(key, pair, reference)  # type: ignore[arg-type] # two numbers
        for body in reference.tree.bodies:
            matter = varied(reference, "links", body.name)
            if matter is not None and body.inertial is not None:
                mass = body.inertial.mass_kg
                mass_range = (mass, *(mass * factor for factor in matter["density"]))
                book.put("body", body.name, {"dr:mass": mass_range, "dr:com": body.inertial.com_m})
        for joint in reference.tree.moving_joints:
            if (row := varied(reference, "joints", joint.name)) is not None:
                book.put("joint", joint.name, {"dr:delay": row["delay"]})
        for number, payload in enumerate(said["payloads"]):
            facts = {word: payload[word] for word in PAYLOAD}
            facts["body"] = reference.tree.placement(payload["link"])[0]
            book.put("payload", str(number), {f"dr:{word}": fact for word, fact in facts.items()})
        book.put("robot", "", {"dr:seed": str(said["seed"])})
        return book.plain_table()


def _stated(key: Key, pair: tuple[float, ...], reference: Reference) -> tuple[float, ...]:
    """How the file states a range: with the nominal value, or in two ways."""
    word = key.quantity.removeprefix("drawn:")
    if key.kind == "robot":
        return (0.0 if word == "restitution" else reference.control.contact.friction[0], *pair)
    if key.kind == "joint" and word in FACTORS:
        nominal = getattr(reference.control.by_joint[key.name], word)
        return (nominal, *(nominal * factor for factor in pair))
    return (*pair, *pair) if word.startswith(("density", "com")) else pair


def _with_nominal(row: Row | None) -> list[float]:
    return [row["nominal"], *row["range"]] if row else []


def _matter(row: Row) -> Iterator[tuple[str, object]]:
    """Ranges of one body, whose pseudo-inertia becomes U J U', U = exp(alpha) [[A, t], [0, 1]].

    So the mass changes by exp(2 alpha): alpha is half the logarithm of the density's factor; A has
    exp(d) on its diagonal and s above it; t is the shift, m (Rucker and Wensing, 2022).
    """
    drawn = row["log_cholesky"]
    yield "density", (row["density"], [math.exp(2.0 * alpha) for alpha in drawn["alpha"]])
    for axis, most, pair in zip("xyz", row["com"]["shift"], drawn["t"], strict=True):
        yield f"com {axis}", ((-most, most), pair)
    yield "stretch", drawn["d"]
    for shear in SHEARS:
        yield shear, drawn["s"]
