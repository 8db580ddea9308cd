"""An MJCF and what it includes -> one XML without comments in which everything has a name."""

from __future__ import annotations

import json
import posixpath
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import SourceError, Where, did_you_mean
from assetbuild.findings import Finding
from assetbuild.source.mjcf.copies import write_out
from assetbuild.source.mjcf.names import name_all
from assetbuild.source.mjcf.scenery import cut_scenery
from assetbuild.source.mjcf.text import AT, bodies, error_at, parts, where_of
from assetbuild.source.urdf.xml import read_xml

if TYPE_CHECKING:
    from lxml.etree import _Element

REFUSED = {
    "composite": "a robot of this kind is not a tree of rigid bodies",
    "flexcomp": "a robot of this kind is not a tree of rigid bodies",
    "flex": "a robot of this kind is not a tree of rigid bodies",
    "plugin": "what a plug-in of MuJoCo does cannot be said of the robot",
}
"""Elements that make a robot this reader does not know, and what to do about them."""
MESHES = (".stl", ".obj")


class FlattenMjcf(Step):
    """Reads `tree/<path>`; only files below the source's root can be included.

    `source.xml` has the files' own paths from the root of the source and no `meshdir`;
    `lines.json` says where each of its elements stood, in document order. What only changes
    comments or the order of attributes' blanks changes `lines.json` and `source_map.json` alone.
    """

    outputs = ("source.xml", "lines.json", "meshes.json", "source_map.json")
    isolated = True
    limits = Limits(wall_s=120.0, memory_mb=2048)

    file: str
    """Path of the MJCF below the source root."""
    body: str | None = None
    """Name of the robot's body in the world; None = as the source tells, see `cut_scenery`."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises SourceError with file and line for what is no MJCF or cannot be read as one."""
        from lxml import etree

        root = write_out(_model(self.file, files.inputs / "tree"), _loader(files.inputs / "tree"))
        for tag, hint in REFUSED.items():
            found = next(root.iter(tag), None)
            if found is not None:
                raise error_at(found, f"<{tag}> is not read", hint)
        name_all(root)
        findings = list(cut_scenery(root, self.body))
        (files.outputs / "meshes.json").write_text(_json(_meshes(root)), encoding="ascii")
        lines = [str(element.get(AT)) for element in root.iter("*")]
        (files.outputs / "lines.json").write_text(_json(lines), encoding="ascii")
        source_map = {"file": self.file, "lines": _source_map(root, self.file)}
        (files.outputs / "source_map.json").write_text(_json(source_map), encoding="ascii")
        for element in root.iter("*"):
            element.attrib.pop(AT, "")
        (files.outputs / "source.xml").write_bytes(etree.tostring(root, method="c14n"))
        yield from findings


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True, indent=1) + "\n"


def _loader(tree: Path) -> Callable[[_Element], _Element]:
    """How an element of `<asset>` gets the model that it names."""

    def load(element: _Element) -> _Element:
        if element.get("content_type", "text/xml") != "text/xml":
            raise error_at(element, "a model of a format that is not read", "attach MJCF")
        path = _below(element, element.get("file", ""), posixpath.dirname(where_of(element).file))
        return _model(path, tree, element)

    return load


# --- includes -------------------------------------------------------------------------------


def _model(file: str, tree: Path, asked: _Element | None = None) -> _Element:
    """The <mujoco> element with every include in its place, files by their whole paths.

    asked: the element that names the file; None for the robot's own.
    """
    root = _expanded(file, tree, asked)
    if root.find("worldbody") is None:
        raise error_at(root, "an MJCF without <worldbody>", "is this the right file?")
    _resolve_files(root, posixpath.dirname(file))
    return root


def _expanded(file: str, tree: Path, asked: _Element | None) -> _Element:
    root = _parsed(file, tree, asked)
    if root.tag != "mujoco":
        hint = "this is URDF: use `source.urdf`" if root.tag == "robot" else "is this MJCF?"
        raise error_at(root, f"the root element is <{root.tag}>, not <mujoco>", hint)
    seen = {file}
    while (include := next(root.iter("include"), None)) is not None:
        # MuJoCo looks for includes from the folder of the main file.
        path = _below(include, include.get("file", ""), posixpath.dirname(file))
        if path in seen:
            raise error_at(include, f"`{path}` is included twice", "MuJoCo forbids it too")
        seen.add(path)
        parent, inside = include.getparent(), _parsed(path, tree, include)
        if parent is None:
            raise error_at(include, "nothing but an <include>")
        index = parent.index(include)
        parent[index : index + 1] = list(inside.iterchildren("*"))
    # A scene that includes a robot has a second <worldbody>: to MuJoCo all are one.
    worlds = list(root.iterchildren("worldbody"))
    for other in worlds[1:]:
        worlds[0].extend(list(other))
        root.remove(other)
    return root


def _parsed(path: str, tree: Path, include: _Element | None) -> _Element:
    file = tree / path
    if not file.is_file():
        known = [p.relative_to(tree).as_posix() for p in sorted(tree.rglob("*.xml"))]
        where = where_of(include) if include is not None else Where(path)
        hint = did_you_mean(path, known) + "; includes are read from the folder of the MJCF down"
        raise SourceError(f"no file `{path}` to include", where=where, hint=hint)
    root = read_xml(file.read_bytes(), path, "MJCF").element
    for element in root.iter("*"):
        if element.prefix or str(element.tag).startswith("{"):
            raise error_at(root, f"<{element.tag}>: MJCF has no namespaces", "is this MJCF?")
        element.set(AT, f"{path}:{element.sourceline or 0}")
        element.text = element.tail = None
    return root


def _below(element: _Element, name: str, folder: str) -> str:
    """The path below the source's root that a file name stands for."""
    name = name.strip()
    if not name:
        raise error_at(element, f"<{element.tag}> without a file")
    if "\\" in name or name.startswith("/") or ":" in name:
        hint = "use `/` and a path relative to the MJCF"
        raise error_at(element, f"file `{name}` cannot be followed", hint)
    path = posixpath.normpath(posixpath.join(folder, name))
    if path.startswith("../") or path == "..":
        hint = "choose a higher `source.root` in the recipe"
        raise error_at(element, f"file `{name}` leads out of the source", hint)
    return path


# --- files ----------------------------------------------------------------------------------


def _resolve_files(root: _Element, folder: str) -> None:
    """Each `file` becomes a path below the source's root; the compiler's folders go."""
    said: dict[str, str] = {}
    for compiler in root.iterchildren("compiler"):
        for key in ("assetdir", "meshdir", "texturedir", "strippath"):
            if key in compiler.attrib:
                said[key] = str(compiler.attrib.pop(key))
    shared = said.get("assetdir", "")
    folders = {
        "mesh": said.get("meshdir", shared),
        "hfield": said.get("meshdir", shared),
        "texture": said.get("texturedir", shared),
    }
    for asset in root.iterchildren("asset"):
        for element in asset.iterchildren(*folders):
            for key in [str(k) for k in element.attrib if str(k).startswith("file")]:
                name = str(element.get(key))
                if said.get("strippath") == "true":
                    name = posixpath.basename(name)
                if not element.get("name"):
                    element.set("name", posixpath.splitext(posixpath.basename(name))[0])
                inside = posixpath.join(folder, folders[str(element.tag)])
                element.set(key, _below(element, name, inside))
        for mesh in asset.iterchildren("mesh"):
            _check_mesh(mesh)


def _check_mesh(mesh: _Element) -> None:
    file = mesh.get("file")
    if file is None:
        hint = "store its points in an OBJ file"
        raise error_at(mesh, f"mesh `{mesh.get('name')}` has no file", hint)
    if not file.lower().endswith(MESHES):
        raise error_at(mesh, f"mesh `{file}` is neither STL nor OBJ", "convert it to OBJ")


def _meshes(root: _Element) -> list[dict[str, object]]:
    """As `read_urdf` lists them: the first use of each mesh file, by path."""
    found: dict[str, dict[str, object]] = {}
    for mesh in root.iterfind("asset/mesh"):
        path, where = str(mesh.get("file")), where_of(mesh)
        entry = {"path": path, "uri": path, "subject": f"mesh {mesh.get('name')}"}
        found.setdefault(path, {**entry, "line": where.line, "file": where.file})
    return [found[path] for path in sorted(found)]


def _source_map(root: _Element, main: str) -> dict[str, object]:
    """Line by subject; `file:line` where an included file says it."""
    lines: dict[str, object] = {}

    def note(subject: str, element: _Element) -> None:
        where = where_of(element)
        lines.setdefault(subject, where.line if where.file == main else str(where))

    note("robot", root)
    world = root.find("worldbody")
    assert world is not None  # noqa: S101 # `run` has looked
    for body, _ in bodies(world):
        note(f"link {body.get('name')}", body)
    for body in [world, *(body for body, _ in bodies(world))]:
        for part in parts(body, *_SUBJECTS):
            note(f"{_SUBJECTS[str(part.tag)]} {part.get('name')}", part)
    for mesh in root.iterfind("asset/mesh"):
        note(f"mesh {mesh.get('file')}", mesh)
    for material in root.iterfind("asset/material"):
        note(f"material {material.get('name')}", material)
    for section in ("actuator", "sensor", "equality", "tendon"):
        for element in root.iterfind(f"{section}/*"):
            target = element.get("joint") if section == "actuator" else None
            note(f"{section} {target or element.get('name')}", element)
    for key in root.iterfind("keyframe/key"):
        note(f"keyframe {key.get('name')}", key)
    return lines


_SUBJECTS = {
    "joint": "joint",
    "freejoint": "joint",
    "geom": "shape",
    "site": "link",
    "camera": "camera",
    "light": "light",
}
