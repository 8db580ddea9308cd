"""The files of a bundle by format, the change of one of them, and digests that fit again."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import random
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from tests.mutations import pictures, text
from tests.mutations.change import Mutation

FORMATS = ("mjcf", "urdf", "usd", "python", "dr", "xrdf", "policy", "robot")


def form_of(file: str) -> str:
    """The format that a file of a bundle belongs to; "" for reports and licences."""
    if file == "report/robot.json":
        return "robot"
    if file == "dr.yaml":
        return "dr"
    top = file.split("/", maxsplit=1)[0]
    return top if top in FORMATS and "/" in file else ""


def tool_of(file: str) -> ModuleType:
    """What walks and changes a file, by its ending."""
    return pictures if file.endswith(".png") else text


def files_of(bundle: Path, forms: tuple[str, ...] = FORMATS) -> list[str]:
    """The files of some formats, sorted."""
    found = (str(path.relative_to(bundle)) for path in bundle.rglob("*") if path.is_file())
    return sorted(file for file in found if form_of(file) in forms)


def mutations(bundle: Path, forms: tuple[str, ...], seed: int) -> list[Mutation]:
    """Every mutation of every file of some formats, the same ones for the same seed."""
    found: list[Mutation] = []
    for file in files_of(bundle, forms):
        found += tool_of(file).walk(bundle / file, file, random.Random(f"{seed} {file}"))
    return found


@contextmanager
def planted(bundle: Path, mutation: Mutation) -> Iterator[None]:
    """The bundle with one change, and a manifest and a provenance that fit it; then as before."""
    with kept(bundle, mutation.file):
        tool_of(mutation.file).apply(bundle / mutation.file, mutation.key)
        _aged(bundle / mutation.file)
        refit(bundle, mutation.file)
        yield


@contextmanager
def kept(bundle: Path, file: str) -> Iterator[None]:
    """Whatever happens to a file, afterwards it and what tells its digest are as before."""
    paths = [bundle / name for name in (file, "manifest.json", "provenance.json")]
    before = [path.read_bytes() for path in paths]
    try:
        yield
    finally:
        for path, data in zip(paths, before, strict=True):
            path.write_bytes(data)
        _aged(paths[0])


_AGES = itertools.count(1)


def _aged(path: Path) -> None:
    """Gives a file a time of its own: MuJoCo keeps meshes by name and whole seconds."""
    os.utime(path, (0, 10 * next(_AGES)))


def refit(bundle: Path, file: str) -> None:
    """Writes digest and size of a changed file where the bundle tells them."""
    data = (bundle / file).read_bytes()
    own, manifest = bundle / "provenance.json", bundle / "manifest.json"
    listed = json.loads(manifest.read_bytes())
    for row in listed["files"]:
        if row["path"] == file:
            row["sha256"], row["size"] = hashlib.sha256(data).hexdigest(), len(data)
    manifest.write_text(f"{json.dumps(listed, indent=2, sort_keys=True)}\n", encoding="utf-8")
    statement = json.loads(own.read_bytes())
    for subject in statement["subject"]:
        if subject["name"] in (file, "manifest.json"):
            named = (bundle / str(subject["name"])).read_bytes()
            subject["digest"] = {"sha256": hashlib.sha256(named).hexdigest()}
    own.write_text(f"{json.dumps(statement, indent=2, sort_keys=True)}\n", encoding="utf-8")
