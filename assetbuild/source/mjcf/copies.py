"""`<replicate>` and `<attach>` written out by MuJoCo's own specification, numbers as they stand.

MuJoCo reads the text and writes it again with every copy, its names and what refers to them. That
both mean the same is compiled and compared. An element with a name keeps its line: the names of
copies are made of it.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from assetbuild.errors import one_line
from assetbuild.facts.mjcf_grammar import Path
from assetbuild.simulators.mujoco import caught_warnings, mj
from assetbuild.source.mjcf.compiled import plain, without_meshes
from assetbuild.source.mjcf.text import AT, Element, error_at, path_of, plain_text, remove

STANDING_IN = {
    "obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    "png": base64.b64decode(
        "iVBORw0KGgoAAAANSUhEUgAAAAwAAAAMCAAAAABzHgM7AAAADElEQVR42mNgGLwAAACcAAEoPOGlAAAAAElFTkSuQmCC"
    ),
}
"""A tetrahedron and a grey picture: MuJoCo opens all files before it writes, and keeps none."""
DEEPEST = 4
"""Models that attach models that attach models."""
MOST = 100_000
"""Elements that are written out."""


def write_out(root: Element, load: Callable[[Element], Element], depth: int = 0) -> Element:
    """The same robot without `<replicate>` and `<attach>`. SourceError with file and line.

    load: a model that an element of `<asset>` names, files resolved.
    """
    first = next(root.iter("replicate", "attach"), None)
    elements = root.findall("asset/model")
    if first is None:
        for element in elements:  # attached nowhere
            remove(element)
        return root
    if depth > DEEPEST:
        raise error_at(first, f"models are attached more than {DEEPEST} deep")
    models: dict[str, Element] = {}
    for number, element in enumerate(elements):
        child = write_out(load(element), load, depth + 1)
        if not element.get("name"):
            element.set("name", str(child.get("model") or ""))
        element.set("file", f"{number}.xml")
        _rename_classes(child, number)
        models[f"{number}.xml"] = child
    _refuse_many(
        root,
        {str(e.get("name")): len(list(models[str(e.get("file"))].iter("*"))) for e in elements},
    )
    files = _stand_in([root, *models.values()])
    try:
        with caught_warnings():
            spec = _spec(root, models, files)
            if not hasattr(spec.compiler, "savecanonical"):
                hint = "build with MuJoCo 3.16 or newer, or write the copies out"
                raise error_at(first, f"this MuJoCo does not write <{first.tag}> out exactly", hint)
            spec.compiler.savecompiled = spec.compiler.savecanonical = False
            made = _with_lines(spec.to_xml(), [root, *models.values()])
            _compare(root, models, made, first)
    except ValueError as error:
        message = f"MuJoCo does not write <{first.tag}> out: {one_line(error, 1000)}"
        raise error_at(first, message) from None
    for element in made.iterfind("asset/*"):
        element.attrib.update({k: files[str(v)] for k, v in element.attrib.items() if v in files})
    return made


def _stand_in(roots: list[Element]) -> dict[str, str]:
    """Rename all files to such that stand in for them; their paths by the new names."""
    paths: dict[str, str] = {}
    for element in (e for root in roots for e in root.iterfind("asset/*")):
        for key in [str(k) for k in element.attrib if str(k).startswith("file")]:
            if element.tag != "model":
                name = f"{len(paths)}.{'obj' if element.tag == 'mesh' else 'png'}"
                paths[name] = str(element.get(key))
                element.set(key, name)
    return paths


def _rename_classes(model: Element, number: int) -> None:
    """Without a prefix MuJoCo would write the classes of two models under one name."""
    for element in model.iter("*"):
        for key in ("class", "childclass"):
            if element.get(key, "main") != "main":
                element.set(key, f"{element.get(key)}-of-{number}")


def _refuse_many(root: Element, sizes: Mapping[str, int]) -> None:
    """sizes: number of elements of each model by name."""
    total = 0
    for element in root.iter("*"):
        copies = sizes.get(element.get("model", ""), 1) if element.tag == "attach" else 1
        for around in element.iterancestors("replicate"):
            count = around.get("count", "").strip()
            copies *= int(count) if count.isdecimal() and len(count) < 9 else MOST + 1
        total += copies
        if total > MOST:
            raise error_at(element, f"more than {MOST} elements when all copies are written out")


def _with_lines(text: str, roots: list[Element]) -> Element:
    """MuJoCo's text, each element with the place of the one that it was made of.

    That is the one with the longest name that its own contains; else the place of what it is in.
    """
    from lxml import etree

    named: dict[tuple[Path, str], str] = {}
    for element in (e for root in roots for e in root.iter("*")):
        if name := element.get("name"):
            named.setdefault((path_of(element), name), str(element.get(AT)))
    made = etree.fromstring(text.encode())
    for element in made.iter("*"):
        path, name = path_of(element), element.get("name", "")
        known = (original for place, original in named if place == path and original in name)
        parent = element.getparent()
        above = str((roots[0] if parent is None else parent).get(AT))
        element.set(AT, named.get((path, max(known, key=len, default="")), above))
    return made


def _spec(root: Element, models: Mapping[str, Element], files: Iterable[str]) -> Any:  # Any: MjSpec
    """files: names of those that stand in."""
    texts = {name: plain_text(child).encode() for name, child in models.items()}
    assets = {name: STANDING_IN[name[-3:]] for name in files}
    return mj.MjSpec.from_string(plain_text(root), include=texts, assets=assets)


def _compare(root: Element, models: Mapping[str, Element], made: Element, first: Element) -> None:
    """SourceError where the text that MuJoCo wrote is another robot."""
    bare = {name: without_meshes(plain(child)) for name, child in models.items()}
    one = _spec(without_meshes(plain(root)), bare, ()).compile()
    two = _spec(without_meshes(plain(made)), {}, ()).compile()
    for name in dir(one):
        a, b = getattr(one, name), getattr(two, name)
        if isinstance(a, np.ndarray) and not _close(a, b):
            message = f"MuJoCo writes <{first.tag}> out as another robot: `{name}` differs"
            raise error_at(first, message, "write the copies out, or attach in MuJoCo")


def _close(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> bool:
    return a.shape == b.shape and (
        a.dtype.kind not in "fiu" or bool(np.allclose(a, b, rtol=1e-9, atol=1e-12, equal_nan=True))
    )
