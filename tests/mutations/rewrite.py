"""The same files written differently: nothing of it may be found."""

from __future__ import annotations

import ast
import json
import random
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

import yaml
from lxml import etree

from tests.mutations.bundle import files_of, form_of, kept, refit
from tests.mutations.run import Bench

Rewriting = Callable[[Path], None]
DECIMAL = re.compile(r"(?<![\w.])(-?\d+\.\d+)(?![\w.])")


def rewritten(bundle: Path) -> Iterator[tuple[str, list[str]]]:
    """(file, what was said or differed once it was written in all other ways) of all files."""
    with tempfile.TemporaryDirectory(prefix="rewritten-") as name:
        bench = Bench(bundle, Path(name))
        yield "(untouched)", [f"{rule}: {subject}" for rule, subject, _ in bench.judge.alarms]
        for file in files_of(bench.bundle):
            changes = XML if form_of(file) == "mjcf" else XML[:-1]
            of_xml = tuple(partial(_each, change=change) for change in changes)
            with kept(bench.bundle, file):
                for way in WAYS.get(Path(file).suffix, of_xml):
                    way(bench.bundle / file)
                refit(bench.bundle, file)
                verdict = bench.judge.ask(file)
                yield file, [*verdict.said, *verdict.told]


def _each(path: Path, change: Callable[[etree._Element], None]) -> None:
    tree = etree.parse(str(path))
    for element in list(tree.getroot().iter()):
        if isinstance(element.tag, str):
            change(element)
    tree.write(str(path), encoding="utf-8")


def _comment(element: etree._Element) -> None:
    if element.tag != "include":  # MuJoCo takes nothing inside of one
        element.insert(0, etree.Comment(" mass 3 "))


def _reverse(element: etree._Element) -> None:
    items = list(element.attrib.items())
    element.attrib.clear()
    element.attrib.update(reversed(items))


def _spell(element: etree._Element) -> None:
    for name, value in element.attrib.items():
        words = str(value).split()
        if all(DECIMAL.fullmatch(word) or word.lstrip("-").isdigit() for word in words):
            element.set(str(name), "  ".join(f"{w}00" if "." in w else w for w in words))


def _flip(element: etree._Element) -> None:
    quat = element.get("quat")
    if quat:
        element.set("quat", " ".join(repr(-float(word)) for word in quat.split()))


XML = (_comment, _reverse, _spell, _flip)
"""The last one for MJCF alone."""


def _export(path: Path) -> None:
    from pxr import Sdf

    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    layer.comment = "exported again"
    copy = Sdf.Layer.CreateAnonymous(path.suffix)
    copy.ImportFromString(layer.ExportToString())
    copy.Export(str(path))


def _usd_signs(path: Path) -> None:
    from pxr import Sdf

    layer = Sdf.Layer.OpenAsAnonymous(str(path))

    def flip(at: Sdf.Path) -> None:
        spec = layer.GetObjectAtPath(at)
        if isinstance(spec, Sdf.AttributeSpec) and type(spec.default).__name__.startswith("Quat"):
            spec.default = -spec.default

    layer.Traverse(Sdf.Path.absoluteRootPath, flip)
    layer.Export(str(path))


def _unparse(path: Path) -> None:
    path.write_text(ast.unparse(ast.parse(path.read_text(encoding="utf-8"))), encoding="utf-8")


def _indent(path: Path) -> None:
    value = json.loads(path.read_bytes())
    items = list(value.items())
    random.Random(0).shuffle(items)
    path.write_text(json.dumps(dict(items), indent=3), encoding="utf-8")


def _dump(path: Path) -> None:
    value = yaml.safe_load(path.read_bytes())
    path.write_text(yaml.safe_dump(value, default_flow_style=False), encoding="utf-8")


def _obj_comments(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("# again\n" + "\n".join(lines) + "\n\n", encoding="utf-8")


def _compress(path: Path) -> None:
    from PIL import Image

    with Image.open(path) as opened:
        picture = opened.copy()
    picture.save(path, compress_level=1)


WAYS: Mapping[str, tuple[Rewriting, ...]] = {
    ".usda": (_export, _usd_signs),
    ".usdc": (_export,),
    ".py": (_unparse,),
    ".json": (_indent,),
    ".yaml": (_dump,),
    ".xrdf": (_dump,),
    ".obj": (_obj_comments,),
    ".mtl": (),
    ".png": (_compress,),
}
"""Ways to rewrite a file, by its suffix; for XML, they rewrite single elements."""
