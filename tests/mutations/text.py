"""Mutations of text in any format: every value, every item, every line and what hangs on it.

Nothing here knows elements, prims or keys. Indentation shows what a line holds, and the format's
own library says later whether a change is refused or means nothing.
"""

from __future__ import annotations

import json
import random
import re
from collections.abc import Iterator
from pathlib import Path

import yaml

from tests.mutations.change import WORDS, Mutation, numbers_in, other_text, vector_changes

NUMBER = r"(?<![\w.#])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w./])"
PATH = r"(?:(?<== )|(?<=@)|(?=</[^>\n]*>,))</[\w/.:]+>"
BARE = rf'\b(?:{"|".join(word for row in WORDS for word in row)})\b(?= [\w"])'
WORD = r"\b(?:[Tt]rue|[Ff]alse|None|null)\b"
VALUE = rf'"[^"\n]*"|@[^@\n]*@|{PATH}|\d+(?:/\d*)+|{NUMBER}|{WORD}'
RUN = re.compile(rf"{BARE}|(?:{VALUE})(?:,? +(?:{VALUE}))*")
"""Values that stand beside one another: a vector, a list, the corners of a face."""
QUOTED = re.compile(rf'"{NUMBER}(?:\s+{NUMBER})*"')
ITEM = re.compile(r'\s[\w:]+="[^"\n]*",?')
"""An attribute of an element."""
NAME = re.compile(r"([A-Za-z_][\w:.]*)\"?\s*[=:]")
COMMENT = re.compile(r'"""(?s:.*?)"""|#[^\n]*|<!--(?s:.*?)-->|<\?[^\n]*')
"""Docstrings too, which mean nothing."""
CLOSING = (")", "]", "}", "{", "</")
REPEATED = re.compile(r'\s*(?:<\w|def |[\[({"\d-])(?![^"\n]*":)')
"""Lines of which there may be one more: elements, prims and items, not keys."""
OWN_NAME = re.compile(r'((?:\bname=|def \w+ )")([^"]+)')
FLIPPED = {"true": "false", "false": "true", "True": "False", "False": "True",
           "None": "1.0", "null": "1.0"}  # fmt: skip
SEVERAL = {"visual", "collision", "transmission", "sensor", "gazebo"}
"""Elements of which a URDF may have one more; of an MJCF MuJoCo decides."""
DRAWN = 3
"""So many lines of each keyword of a mesh, and runs of values of any line, are drawn."""
Splice = tuple[int, int, str]
"""Begin and end in the text, and what comes in between."""


def load(path: Path) -> object:
    """The value of a JSON or YAML file."""
    text = path.read_text(encoding="utf-8")
    return json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)


def text_of(path: Path) -> str:
    """The file's text with an item a line; lists of plain values stay in one."""
    if path.suffix.startswith(".usd"):
        from pxr import Sdf

        return str(Sdf.Layer.OpenAsAnonymous(str(path)).ExportToString())
    if path.suffix in (".json", ".yaml", ".xrdf"):
        text = json.dumps(load(path), indent=1)
        return re.sub(r"\[[^\[\]{}]*\]", lambda found: re.sub(r"\n\s*", " ", found[0]), text)
    return path.read_text(encoding="utf-8")


def write(path: Path, text: str) -> None:
    """The other way. ValueError or RuntimeError: the text is none of the format."""
    if path.suffix.startswith(".usd"):
        from pxr import Sdf

        layer = Sdf.Layer.CreateAnonymous(path.suffix)
        if not layer.ImportFromString(text):
            raise ValueError("no layer")
        layer.Export(str(path))
        there = Sdf.Layer.Find(str(path))
        if there:
            there.Reload(True)
    elif path.suffix in (".json", ".yaml", ".xrdf"):
        value = json.loads(re.sub(r",(\s*[\]}])", r"\1", text))
        plain = path.suffix == ".json"
        path.write_text(json.dumps(value) if plain else yaml.safe_dump(value, sort_keys=False))
    else:
        path.write_text(text, encoding="utf-8")


def apply(path: Path, key: tuple[object, ...]) -> None:
    """Makes the splices of a mutation's key, last first."""
    text = text_of(path)
    for start, end, new in sorted(key, reverse=True):  # type: ignore[misc] # splices
        text = text[:start] + new + text[end:]
    write(path, text)


def walk(path: Path, file: str, random_: random.Random) -> Iterator[Mutation]:
    """All mutations of one file; of a mesh those of some lines of each keyword."""
    text = COMMENT.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text_of(path))
    rows = list(re.finditer(r"[^\n]*\n?", text))[:-1]
    line_of = {row.start(): number for number, row in enumerate(rows, 1)}
    if path.suffix in (".obj", ".mtl"):
        rows = _drawn(rows, random_)
    texts: dict[str, list[str]] = {}
    for row in rows:
        for run in RUN.finditer(text, row.start(), row.end()):
            if found := [v[1] for v in re.finditer(r'"([^"]*)"', run[0])]:
                texts.setdefault(_label(row, run.start()), []).extend(found)
    for number, row in enumerate(rows):
        line = f"line {line_of[row.start()]}"
        runs = list(RUN.finditer(text, row.start(), row.end()))
        for run in random_.sample(runs, min(DRAWN, len(runs))) if len(runs) > 20 else runs:
            label = _label(row, run.start())
            for what, splices in _of_run(run, texts.get(label, []), random_):
                yield _mutation(text, file, f"{line}: {label}", what, splices)
        for item in ITEM.finditer(text, row.start(), row.end()):
            splices, where = [(item.start(), item.end(), "")], f"{line}: {_label(row, item.end())}"
            yield _mutation(text, file, where, "item deleted", splices)
        for what, splices in _of_block(rows, number, file):
            yield _mutation(text, file, f"{line}: {_label(row, row.end())}", what, splices)


def _drawn(rows: list[re.Match[str]], random_: random.Random) -> list[re.Match[str]]:
    of: dict[str, list[re.Match[str]]] = {}
    for row in rows:
        of.setdefault(row[0].partition(" ")[0], []).append(row)
    return [row for some in of.values() for row in random_.sample(some, min(DRAWN, len(some)))]


def _label(row: re.Match[str], at: int) -> str:
    """The last name before a place of a line that has a value, else the line's first word."""
    names = NAME.findall(row.string, row.start(), at) if row.string else []
    words = re.findall(r"[A-Za-z_][\w:]*", row[0])
    return str(names[-1] if names else words[0] if words else "")


def _mutation(text: str, file: str, where: str, what: str, splices: list[Splice]) -> Mutation:
    start, end, _ = splices[0]
    after = " ".join(new for _, _, new in splices)
    return Mutation(file, where, what, text[start:end].strip(), after, tuple(splices))


def _of_run(
    run: re.Match[str], pool: list[str], random_: random.Random
) -> Iterator[tuple[str, list[Splice]]]:
    """Changes of values that stand beside one another: of a number, a text, a truth, the order."""
    pattern = NUMBER if QUOTED.fullmatch(run[0]) else rf"{BARE}|{VALUE}"
    tokens = [(run.start() + t.start(), t[0]) for t in re.finditer(pattern, run[0])]
    numbers = [numbers_in(token) for _, token in tokens]
    if all(numbers):
        old = [value for found in numbers if found for value in found]
        for what, new in vector_changes(old, random_):
            changed = [(token, n) for token, o, n in zip(tokens, old, new, strict=True) if o != n]
            if changed:  # one more of a huge number is the same
                yield what, [_spliced(token, _spelled(n)) for token, n in changed]
    else:
        token = random_.choice(tokens)
        yield "another value", [_spliced(token, _other(token[1], pool, random_))]
        first, second = random_.sample(tokens, 2) if len(tokens) > 1 else (token, token)
        if first[1] != second[1]:
            yield "swapped", [_spliced(first, second[1]), _spliced(second, first[1])]
    if len(tokens) > 1:
        (before, text), (last, _) = tokens[-2:]
        end = last + len(tokens[-1][1])
        yield "last dropped", [(before + len(text), end, "")]


def _spliced(token: tuple[int, str], new: str) -> Splice:
    return token[0], token[0] + len(token[1]), new


def _spelled(number: float) -> str:
    return repr(int(number) if float(number).is_integer() else number)


def _other(token: str, pool: list[str], random_: random.Random) -> str:
    if token in FLIPPED:
        return FLIPPED[token]
    if token[0] not in '"@<':
        return other_text(token, [], random_) if token[0].isalpha() else f"{token}0"
    text = token.strip('"@<>')
    new = FLIPPED[text] if text in ("true", "false") else other_text(text, pool, random_)
    return f"{token[0]}{new}{token[-1]}"


def _of_block(
    rows: list[re.Match[str]], number: int, file: str
) -> Iterator[tuple[str, list[Splice]]]:
    """A line with all that is indented below it: deleted, and where there may be several, twice."""
    first = rows[number][0]
    body = first.lstrip()
    if not body or body.startswith(CLOSING):
        return
    depth, end = len(first) - len(body), rows[number].end()
    for row in rows[number + 1 :]:
        inner = row[0].lstrip()
        if inner and len(row[0]) - len(inner) <= depth and not (
            len(row[0]) - len(inner) == depth and inner.startswith(CLOSING)
        ):  # fmt: skip
            break
        end = row.end()
    start = rows[number].start()
    yield "deleted", [(start, end, "")]
    tag = re.sub(r"\W.*", "", body[1:].rstrip())
    if REPEATED.match(first) and (not file.endswith(".urdf") or tag in SEVERAL):
        copy = OWN_NAME.sub(r"\1\2_copy", rows[number].string[start:end])
        yield "duplicated", [(end, end, copy)]
