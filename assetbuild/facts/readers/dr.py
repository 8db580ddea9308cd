"""The reader of facts of `dr.yaml`: how far the real robot may be from its description."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from assetbuild.errors import UsageError, Where
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Table, Value, Writer
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.robot.model import Actuator, Inertial

if TYPE_CHECKING:
    from yaml import Node

RANGES = "how the robot may vary; what it is stands in the other files"
FACTORS = ("kp", "kd", "damping", "friction", "armature", "effort")
_DRAWN = frozenset({"nominal", "range"})
KNOWN: Mapping[str, frozenset[str]] = {
    "": frozenset({
        "schema", "robot", "seed",
        "section links", "section joints", "section payloads", "section contact",
    }),
    "body": frozenset({
        "mass nominal", "mass range", "density", "com nominal", "com shift", "log_cholesky alpha",
        "log_cholesky d", "log_cholesky s", "log_cholesky t", "source",
    }),
    "payload": frozenset({"link", "body", "mass", "size", "at", "source"}),
    "joint": frozenset({
        "delay", "encoder_bias", "source",
        *(f"{key} {what}" for key in FACTORS for what in _DRAWN),
    }),
    "contact": frozenset({
        "friction nominal", "friction range", "friction source",
        "restitution nominal", "restitution range",
    }),
}  # fmt: skip
"""What `dr.yaml` may say of each kind of subject; keys within keys are joined by a space."""
SECTIONS = {"links": "body", "joints": "joint", "payloads": "payload"}
SECTION = "section"
"""Each section stands there, however empty."""


class Dr(Reader):
    """`dr.yaml` says the recipe's `randomize` in this robot's numbers.

    All facts are words of the format (`dr:mass range`) of subjects such as `range body trunk`.
    """

    isolated: ClassVar[bool] = False
    needs: ClassVar = ("ranges",)
    form: ClassVar[str] = "dr"
    called: ClassVar[str] = "dr.yaml"
    behind: ClassVar[tuple[str, ...]] = ("dr.yaml",)
    lacks: ClassVar[Mapping[str, str]] = {kind: RANGES for kind, _ in VOCABULARY}
    asks: ClassVar[tuple[str, ...]] = ("randomize",)

    def file(self, root: Path, robot: str) -> Path | None:
        """At the top of a bundle; None where the recipe randomizes nothing."""
        path = root / "dr.yaml"
        return path if path.is_file() or self.options.get("randomize") else None

    def read(self, path: Path) -> Table:
        """Every leaf of the YAML; UsageError where it is none."""
        book = Writer()
        for where, keys, value in _leaves(path):
            kind, name, rest = _subject(keys)
            word = " ".join(rest)
            found = _value(value, word)
            if word not in KNOWN[kind] or found is None:
                book.skip(where, f"`{'.'.join(keys)}`", value)
                continue
            subject = f"{kind} {name}".strip()
            book.put("range", subject, {f"dr:{word}": found})
            book.place("range", subject, where)
        return book.table()

    def expected(self, reference: Reference) -> Table:
        """From the section `randomize` of the recipe, and the numbers of the robot."""
        said, book = reference.options.get("randomize"), Writer()
        if not said:
            return book.table()
        _put(book, "", {f"{SECTION} {name}": True for name in (*SECTIONS, "contact")})
        head = {"schema": "assetbuild/dr/v1", "robot": self.robot, "seed": str(said.get("seed", 0))}
        _put(book, "", head)
        for body in reference.tree.bodies:
            matter = _first(said.get("links", {}), body.name)
            if matter is not None and body.inertial is not None:
                _put(book, f"body {body.name}", _matter(body.inertial, matter))
        for number, payload in enumerate(said.get("payloads", ())):
            facts = {key: payload[key] for key in ("link", "mass", "size", "at")}
            facts["body"] = reference.tree.placement(payload["link"])[0]
            _put(book, f"payload {number}", {**facts, "source": _source(payload["source"])})
        for joint in reference.tree.moving_joints:
            ranges = _first(said.get("joints", {}), joint.name)
            if ranges is not None:
                row = reference.control.by_joint.get(joint.name)
                _put(book, f"joint {joint.name}", _joint(row, ranges))
        _put(book, "contact", _contact(reference.control.contact.friction[0], said))
        return book.table()


def _put(book: Writer, subject: str, facts: Mapping[str, Any]) -> None:  # Any: plain JSON
    words = {f"dr:{word}": _value(value, word) for word, value in facts.items()}
    book.put("range", subject, words)


# --- what the file must say -----------------------------------------------------------------


def _first(table: Mapping[str, Any], name: str) -> Any | None:  # Any: plain JSON, here and below
    """The row of the first pattern that matches the whole name."""
    return next((row for pattern, row in table.items() if re.fullmatch(pattern, name)), None)


def _source(text: str) -> str:
    return text or "not stated"


def _matter(inertial: Inertial, matter: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts of one body.

    Its pseudo-inertia becomes U J U', U = exp(alpha) [[A, t], [0, 1]].

    So the mass changes by exp(2 alpha): alpha is half the logarithm of the density's factor; A has
    exp(d) on its diagonal and s above it; t is the shift, m (Rucker and Wensing, 2022).
    """
    low, high = matter["density"]
    com = matter["com"]
    shifts = com if isinstance(com, Sequence) else [com] * 3
    return {
        "mass nominal": inertial.mass_kg,
        "mass range": [inertial.mass_kg * low, inertial.mass_kg * high],
        "density": [low, high],
        "com nominal": inertial.com_m,
        "com shift": shifts,
        "log_cholesky alpha": [0.5 * math.log(low), 0.5 * math.log(high)],
        "log_cholesky d": [-matter["stretch"], matter["stretch"]],
        "log_cholesky s": [-matter["shear"], matter["shear"]],
        "log_cholesky t": [[-shift, shift] for shift in shifts],
        "source": _source(matter["source"]),
    }


def _joint(row: Actuator | None, ranges: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts of one joint; a factor of 1, or of a number it lacks, draws nothing."""
    bias = ranges["encoder_bias"]
    facts = {"delay": ranges["delay"], "encoder_bias": [-bias, bias]}
    for key in FACTORS:
        nominal = getattr(row, key) if row else None
        low, high = ranges[key]
        if nominal and not low == high == 1.0:
            facts |= {f"{key} nominal": nominal, f"{key} range": [nominal * low, nominal * high]}
    return facts | {"source": _source(ranges["source"])}


def _contact(friction: float, said: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts of all surfaces; they do not bounce unless the recipe says so."""
    facts: dict[str, Any] = {}
    if said.get("friction") is not None:
        facts = {"friction nominal": friction, "friction range": said["friction"]}
        facts["friction source"] = _source(said["friction_source"])
    if said.get("restitution") is not None:
        facts |= {"restitution nominal": 0.0, "restitution range": said["restitution"]}
    return facts


# --- what it says ---------------------------------------------------------------------------


def _subject(keys: tuple[str, ...]) -> tuple[str, str, tuple[str, ...]]:
    """(kind, name, the rest) of the keys that lead to a leaf."""
    if keys[1:] == (SECTION,):
        return "", "", (f"{SECTION} {keys[0]}",)
    if len(keys) > 1 and keys[0] in SECTIONS:
        return SECTIONS[keys[0]], keys[1], keys[2:]
    if len(keys) > 1 and keys[0] == "contact":
        return "contact", "", keys[1:]
    return "", "", keys


def _value(value: Any, word: str) -> Value:  # Any: of YAML or JSON
    """Numbers flat in a tuple; a seed as text, of which every digit counts. None: of no form."""
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | float):
        return str(value) if word == "seed" else float(value)
    if isinstance(value, Sequence):
        flat = [_value(part, word) for part in value]
        tuples = [part if isinstance(part, tuple) else (part,) for part in flat]
        if all(isinstance(n, float) for part in tuples for n in part):
            return tuple(float(n) for part in tuples for n in part)  # type: ignore[arg-type] # floats
    return None


def _leaves(path: Path) -> Iterator[tuple[str, tuple[str, ...], Any]]:  # Any: YAML's scalars
    """(file:line, keys, value) of everything that is no mapping; a list of them counts from 0."""
    import yaml

    try:
        loader = yaml.SafeLoader(path.read_text(encoding="utf-8"))
        node = loader.get_single_node()
        if node is None:
            return
        tops = node.value if isinstance(node, yaml.MappingNode) else ()
        for key, _ in tops:
            if key.value in (*SECTIONS, "contact"):
                yield f"{path.name}:{key.start_mark.line + 1}", (key.value, SECTION), True
        found = list(_below(node, ()))
        for keys, leaf in found:
            line = leaf.start_mark.line + 1
            yield f"{path.name}:{line}", keys, loader.construct_object(leaf, deep=True)
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = Where(path.name, mark.line + 1 if mark else 0)
        problem = getattr(error, "problem", None) or "no UTF-8 text"
        raise UsageError(f"not readable as YAML: {problem}", where=where) from None
    except OSError as error:
        raise UsageError(f"cannot read `{path}`: {error.strerror}") from None


def _below(node: Node, keys: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Node]]:
    """A key that stands twice has `(again)` behind its name, which nothing knows."""
    import yaml

    if isinstance(node, yaml.MappingNode):
        seen: set[str] = set()
        for key, value in node.value:
            name = str(key.value)
            while name in seen:
                name += " (again)"
            seen.add(name)
            yield from _below(value, (*keys, name))
        if not node.value and keys not in {(section,) for section in (*SECTIONS, "contact")}:
            yield keys, node
        return
    rows = node.value if isinstance(node, yaml.SequenceNode) else ()
    if rows and all(isinstance(row, yaml.MappingNode) for row in rows):
        for number, row in enumerate(rows):
            yield from _below(row, (*keys, str(number)))
    elif keys != ("payloads",) or rows:
        yield keys, node
