"""The files of an MJCF: what it includes, and the models that it attaches."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import SourceError, Where, did_you_mean
from assetbuild.findings import Finding, Rule
from assetbuild.source.mjcf.text import AT, Element, error_at, where_of
from assetbuild.source.urdf.xml import read_xml
from assetbuild.xml_text import FAULTS

OTHERWISE = {
    "robot": "this is URDF: use `source.urdf`",
    "mujocoinclude": "this is a part of a model: give the file that includes it",
}
"""What the file is, by its root element."""
NOT_XML = Rule(
    "mjcf.xml",
    "warning",
    "the text is not quite XML (`--` in a comment, no blank between two attributes, ...); MuJoCo "
    "overlooks it",
    "mend the line",
)


class ListIncludes(Step):
    """Reads `tree/<path>`, as far as it is known; lists the other XML files that it names.

    What cannot be read is not listed: `flatten_mjcf` refuses it.
    """

    outputs = ("includes.json",)
    isolated = True
    limits = Limits(wall_s=120.0, memory_mb=2048)

    file: str
    """Path of the MJCF below the source root."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes the sorted paths, from the source's root, that are not in `tree/`."""
        tree, wanted = files.inputs / "tree", set[str]()
        waiting, seen = [(self.file, self.file)], set[str]()
        while waiting:
            path, main = waiting.pop()
            if path in seen:
                continue
            seen.add(path)
            if not (tree / path).is_file():
                wanted.add(path)
                continue
            with suppress(SourceError):
                root = _parsed(path, tree, None)
                for element in [*root.iter("include"), *root.iterfind("asset/model")]:
                    places = _places(element, main) if element.get("file") else ()
                    attached = element.tag == "model"
                    waiting += [(place, place if attached else main) for place in places]
        files.write_json("includes.json", sorted(wanted))
        return iter(())


def expanded(file: str, tree: Path, asked: Element | None = None) -> Element:
    """The <mujoco> element with every include in its place.

    asked: the element that names the file; None for the robot's own.
    """
    root = _parsed(file, tree, asked)
    if root.tag != "mujoco":
        hint = OTHERWISE.get(str(root.tag), "is this MJCF?")
        raise error_at(root, f"the root element is <{root.tag}>, not <mujoco>", hint)
    seen = {file}
    while (include := next(root.iter("include"), None)) is not None:
        places = _places(include, file)
        path = next((place for place in places if (tree / place).is_file()), places[0])
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


def _places(element: Element, main: str) -> tuple[str, ...]:
    """Where MuJoCo looks for a file: in the folder of the main file, then beside the element's."""
    first = below(element, posixpath.dirname(main))
    with suppress(SourceError):  # it leads out of the source
        return first, below(element, folder_of(element))
    return (first,)


def _parsed(path: str, tree: Path, include: Element | None) -> Element:
    file = tree / path
    if not file.is_file():
        known = [p.relative_to(tree).as_posix() for p in sorted(tree.rglob("*.xml"))]
        where = where_of(include) if include is not None else Where(path)
        hint = did_you_mean(path, known)
        raise SourceError(f"no file `{path}` to include", where=where, hint=hint)
    root, _ = read_xml(file.read_bytes(), path, "MJCF")
    for element in root.iter("*"):
        if element.prefix or str(element.tag).startswith("{"):
            expand = "expand it first: `xacro FILE -o robot.xml`, and give `robot.xml`"
            hint = expand if "xacro" in str(element.tag) else "is this MJCF?"
            raise error_at(root, f"<{element.tag}>: MJCF has no namespaces", hint)
        element.set(AT, f"{path}:{element.sourceline or 0}")
        for key, name in element.items():
            if str(key).startswith("file") or str(key).endswith("dir"):  # on Windows, as in MuJoCo
                element.set(key, str(name).replace("\\", "/"))
        element.text = element.tail = None
    return root


def folder_of(element: Element) -> str:
    """The folder of the file that an element stands in."""
    return posixpath.dirname(where_of(element).file)


def below(element: Element, folder: str, name: str | None = None) -> str:
    """The path below the source's root that an element's `file`, or a name, stands for."""
    name = (element.get("file", "") if name is None else name).strip()
    if not name:
        raise error_at(element, f"<{element.tag}> without a file")
    if name.startswith("/") or ":" in name:
        hint = "use a path relative to the MJCF"
        raise error_at(element, f"file `{name}` cannot be followed", hint)
    path = posixpath.normpath(posixpath.join(folder, name))
    if path.startswith("../") or path == "..":
        hint = "choose a higher `source.root` in the recipe"
        raise error_at(element, f"file `{name}` leads out of the source", hint)
    return path


def overlooked(root: Element, tree: Path) -> Iterator[Finding]:
    """Report the faults of the text of each file that an element stands in."""
    for file in dict.fromkeys(where_of(element).file for element in root.iter("*")):
        for fault in read_xml((tree / file).read_bytes(), file, "MJCF")[1]:
            what, remedy = FAULTS[fault.kind]
            message = f"{what}: `{fault.text}` ({file}:{fault.line})"
            yield NOT_XML("robot", message, remedy, data={"fault": fault.kind, "line": fault.line})
