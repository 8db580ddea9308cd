"""An MJCF and what it includes -> one XML without comments in which everything has a name.

Meshes whose points stand in the MJCF itself, or that MuJoCo makes, become OBJ files.
"""

from __future__ import annotations

import math
import posixpath
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import AssetBuildError, one_line
from assetbuild.facts.mjcf_grammar import NEWEST, OLDEST, UNWRITTEN, newer_words
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.hull import convex_hull
from assetbuild.robot.pose import Array, normalised_quat, rotation_of
from assetbuild.simulators.mujoco import mj
from assetbuild.source.mjcf.copies import write_out
from assetbuild.source.mjcf.includes import below, expanded, folder_of, overlooked
from assetbuild.source.mjcf.scenery import JOINTS, cut_scenery
from assetbuild.source.mjcf.text import (
    AT,
    WORLD,
    Classes,
    Element,
    bodies,
    dropped,
    error_at,
    named_bodies,
    own_attributes,
    parts,
    remove,
    where_of,
    world_of,
)
from assetbuild.xml_text import free_name

REFUSED = {
    "composite": "MuJoCo 4 has none; MuJoCo 3 writes its bodies out (`mj_saveLastXML`): build that",
    "flexcomp": "a robot of this kind is not a tree of rigid bodies",
    "flex": "a robot of this kind is not a tree of rigid bodies",
    "plugin": "the robot model has no place for MuJoCo plug-ins",
}
"""Elements that make a robot this reader does not know, and what to do about them."""
MESHES = (".stl", ".obj", ".msh")
TURNS = frozenset(("quat", "axisangle", "xyaxes", "zaxis", "euler"))
WITHOUT_FORCE = frozenset(("type", "axis", "ref", "pos", "limited", "range", "margin", "group"))
"""Attributes of a joint that let it move freely, if it has no limits."""

FREE_BASE = Rule(
    "mjcf.free_base",
    "info",
    "three slides and a ball joint let the robot's root move as a free joint does: they were read "
    "as one, with the same positions and velocities",
    "nothing",
)


class FlattenMjcf(Step):
    """Reads `tree/<path>`; only files below the source's root can be included.

    `source.xml` has the files' own paths from the root of the source and no `meshdir`;
    `lines.json` says where each of its elements stood, in document order. What only changes
    comments or the order of attributes' blanks changes `lines.json` and `source_map.json` alone.
    """

    outputs = ("source.xml", "lines.json", "meshes.json", "source_map.json", "inline/")
    isolated = True
    limits = Limits(wall_s=120.0, memory_mb=2048)

    file: str
    """Path of the MJCF below the source root."""
    body: str | None = None
    """Name of the robot's body in the world; None = as the source tells, see `cut_scenery`."""
    grammar: float = 3.11
    """Version of MuJoCo whose words it may have."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises SourceError with file and line for what is no MJCF or cannot be read as one."""
        from lxml import etree

        tree = files.inputs / "tree"
        root = write_out(_resolved(expanded(self.file, tree)), lambda asked: _attached(asked, tree))
        findings = [*overlooked(root, tree), *_without_sensors_of_plugins(root)]
        _check_words(root, self.grammar)
        for tag, hint in REFUSED.items():
            refused = next(root.iter(tag), None)
            if refused is not None:
                raise error_at(refused, f"<{tag}> is not read", hint)
        for size in root.iter("size"):
            if len(size.get("nkey", "").strip()) > len("100000"):  # MuJoCo makes them all
                raise error_at(size, f"<size> asks for {size.get('nkey')} keyframes", "remove it")
        findings += write_free_joints(root)
        name_all(root)
        findings += cut_scenery(root, self.body)
        findings += write_inline(root, files.outputs / "inline")
        files.write_json("meshes.json", _meshes(root))
        files.write_json("lines.json", [str(element.get(AT)) for element in root.iter("*")])
        lines = _source_map(root, self.file)
        files.write_json("source_map.json", {"file": self.file, "lines": lines})
        for element in root.iter("*"):
            element.attrib.pop(AT, "")
        # Not `method="c14n"`: libxml2's refuses a relative namespace.
        (files.outputs / "source.xml").write_bytes(str(etree.canonicalize(root)).encode())
        yield from findings


def _check_words(root: Element, grammar: float) -> None:
    """SourceError for a word that MuJoCo 3.11 does not know, unless the recipe keeps such words."""
    for element in root.iter("*") if grammar < float(NEWEST) else ():
        words = newer_words(str(element.tag), own_attributes(element))
        if words and element.tag not in UNWRITTEN:
            listed = ", ".join(f"`{word}`" for word in words)
            message = f"<{element.tag}>: {listed}: MuJoCo {OLDEST} (mjlab) does not know this"
            hint = f"write `mjcf: {{grammar: {NEWEST}}}` to keep it, or say it in older words"
            raise error_at(element, message, hint)


def _without_sensors_of_plugins(root: Element) -> Iterator[Finding]:
    """They measure and move nothing; nor does a plug-in that nothing else uses."""
    for sensor in list(root.iterfind("sensor/plugin")):
        name = sensor.get("name", "")
        message = f"sensor `{name}` of the plug-in `{sensor.get('plugin', '')}` was left out "
        message += f"({where_of(sensor)})"
        hint = "read what it reports from the source's own MJCF"
        yield dropped("sensor plugin", f"sensor {name}", message, hint, "warning")
        remove(sensor)
    declared = root.findall("extension/plugin")
    if len(declared) == len(list(root.iter("plugin"))):
        for plugin in declared:
            remove(plugin)


# --- the base -------------------------------------------------------------------------------


def write_free_joints(root: Element) -> Iterator[Finding]:
    """Write a free joint for three slides and a ball joint between the world and a body."""
    classes, sections = Classes(root), (*SECTIONS, "custom")
    named = {v for part in sections for e in root.iterfind(f"{part}//*") for v in e.attrib.values()}
    for body in world_of(root).iterchildren("body"):
        joints = list(parts(body, *JOINTS))
        is_named = any(joint.get("name") in named for joint in joints)
        if not is_named and _moves_freely(body, [classes.attributes(one) for one in joints]):
            message = f"three slides and a ball joint were read as one ({where_of(joints[0])})"
            yield FREE_BASE(f"link {body.get('name', 'body')}", message)
            joints[0].tag = "freejoint"
            for key in {*joints[0].attrib} - {AT, "name"}:
                del joints[0].attrib[key]
            for joint in joints[1:]:
                remove(joint)


def _moves_freely(body: Element, joints: Sequence[Mapping[str, str]]) -> bool:
    """Whether they are slides along the world's axes, then a ball, without limits and forces.

    Each slide counts from the world's origin, as the position of a free joint does.
    joints: all attributes of the joints of a body in the world.
    """
    if body.find("frame//joint") is not None:  # a frame may turn it
        return False
    if [joint.get("type") for joint in joints] != ["slide", "slide", "slide", "ball"]:
        return False
    for joint in joints:
        limited = joint.get("limited", "auto")
        forces = (_floats(joint[key]) for key in joint.keys() - WITHOUT_FORCE)
        if limited == "true" or (limited == "auto" and "range" in joint) or any(map(any, forces)):
            return False
    axes = [_floats(joint.get("axis", "0 0 1")) for joint in joints[:3]]
    refs = [value for joint in joints[:3] for value in _floats(joint.get("ref", "0"))]
    at_origin = refs == _floats(body.get("pos", "0 0 0")) and not TURNS & {*body.attrib}
    return at_origin and axes == np.eye(3).tolist() and not any(_floats(joints[3].get("pos", "0")))


def _floats(text: str) -> list[float]:
    """The numbers of an attribute; NaN, which equals nothing, where it has other words."""
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return [math.nan]


# --- files ----------------------------------------------------------------------------------


def _attached(asked: Element, tree: Path) -> Element:
    """The model that an element of `<asset>` names."""
    if asked.get("content_type", "text/xml") != "text/xml":
        raise error_at(asked, "a model of a format that is not read", "attach MJCF")
    return _resolved(expanded(below(asked, folder_of(asked)), tree, asked))


def _resolved(root: Element) -> Element:
    """Each `file` becomes a path below the source's root; the compiler's folders go."""
    if root.find("worldbody") is None:
        raise error_at(root, "an MJCF without <worldbody>", "is this the right file?")
    folder = folder_of(root)
    settings: dict[str, str] = {}
    for compiler in root.iterchildren("compiler"):
        for key in ("assetdir", "meshdir", "texturedir", "strippath"):
            if key in compiler.attrib:
                settings[key] = str(compiler.attrib.pop(key))
        for key in ("discardvisual", "fusestatic"):  # nothing is dropped or merged here
            compiler.attrib.pop(key, "")
    shared = settings.get("assetdir", "")
    folders = {
        "mesh": settings.get("meshdir", shared),
        "hfield": settings.get("meshdir", shared),
        "texture": settings.get("texturedir", shared),
    }
    for asset in root.iterchildren("asset"):
        for element in asset.iterchildren(*folders):
            for key in [str(k) for k in element.attrib if str(k).startswith("file")]:
                name = str(element.get(key))
                if settings.get("strippath") == "true":
                    name = posixpath.basename(name)
                if not element.get("name"):
                    element.set("name", posixpath.splitext(posixpath.basename(name))[0])
                inside = posixpath.join(folder, folders[str(element.tag)])
                element.set(key, below(element, inside, name))
        for mesh in asset.iterchildren("mesh"):
            file = mesh.get("file", "")
            if file and not file.lower().endswith(MESHES):
                raise error_at(mesh, f"mesh `{file}` is no STL, OBJ or MSH", "convert it to OBJ")
    return root


def _meshes(root: Element) -> list[dict[str, object]]:
    """List them as `read_urdf` does: the first use of each mesh file, by path."""
    entries: dict[str, dict[str, object]] = {}
    for mesh in root.iterfind("asset/mesh"):
        path, where = str(mesh.get("file")), where_of(mesh)
        entry = {"path": path, "uri": path, "subject": f"mesh {mesh.get('name')}"}
        entries.setdefault(path, {**entry, "line": where.line, "file": where.file})
    return [entries[path] for path in sorted(entries)]


def _source_map(root: Element, main: str) -> dict[str, object]:
    """Line by subject; `file:line` where an included file says it."""
    around = named_bodies(root)
    elements = [("robot", root), *((f"link {name}", body) for body, name in around[1:])]
    on_bodies = (part for body, _ in around for part in parts(body, *_SUBJECTS))
    elements += [(f"{_SUBJECTS[str(part.tag)]} {part.get('name')}", part) for part in on_bodies]
    elements += [(f"mesh {mesh.get('file')}", mesh) for mesh in root.iterfind("asset/mesh")]
    elements += [(f"material {m.get('name')}", m) for m in root.iterfind("asset/material")]
    for section in SECTIONS:
        for element in root.iterfind(f"{section}/*"):
            target = element.get("joint") if section == "actuator" else None
            elements.append((f"{section} {target or element.get('name')}", element))
    lines: dict[str, object] = {}
    for subject, element in elements:
        where = where_of(element)
        lines.setdefault(subject, where.line if where.file == main else str(where))
    return lines


_SUBJECTS = {
    "joint": "joint",
    "freejoint": "joint",
    "geom": "shape",
    "site": "link",
    "camera": "camera",
    "light": "light",
}


SECTIONS = ("actuator", "sensor", "equality", "tendon", "keyframe")


def name_all(root: Element) -> None:
    """Name every body, joint, geom, site, camera, light, mesh and element of a section."""
    taken = {name for _, name in named_bodies(root)}
    for body, parent in bodies(world_of(root)):  # named before those on it are looked at
        if not body.get("name"):
            body.set("name", free_name("body" if parent == WORLD else f"{parent}_body", taken))
    classes, around = Classes(root), named_bodies(root)
    for tags in (JOINTS, ("geom",), ("site",), ("camera",), ("light",)):
        on_bodies = {part: name for body, name in around for part in parts(body, *tags)}
        _name({part: f"{name}_{_role(part, classes)}" for part, name in on_bodies.items()})
    for asset in root.iterchildren("asset"):
        for tag in ("mesh", "material", "texture", "hfield"):
            elements = asset.iterchildren(tag)
            _name({e: PurePosixPath(e.get("file", "")).stem or tag for e in elements})
    for section in SECTIONS:
        for node in root.iterchildren(section):
            _name({e: _acting_name(e, section) for e in node.iterchildren("*")})


def _role(part: Element, classes: Classes) -> str:
    """Return the last word of a part's name; for a geom, whether it can touch anything."""
    if part.tag != "geom":
        return "joint" if part.tag in JOINTS else str(part.tag)
    attributes = classes.attributes(part)
    masks = [attributes.get(key, "1").strip() for key in ("contype", "conaffinity")]
    return "visual" if all(mask in ("0", "+0") for mask in masks) else "collision"


def _name(wanted: Mapping[Element, str]) -> None:
    """Name the elements without a name as wanted, or with a number behind it."""
    taken = {str(element.get("name")) for element in wanted if element.get("name")}
    for element, name in wanted.items():
        if not element.get("name"):
            element.set("name", free_name(name, taken))


def _acting_name(element: Element, section: str) -> str:
    """Call it after what it acts on or looks at: `FR_hip_joint`, `imu_gyro`."""
    for key in ("joint", "tendon", "site", "objname", "body", "joint1", "body1"):
        if element.get(key):
            owner = str(element.get(key))
            return owner if section == "actuator" else f"{owner}_{element.tag}"
    return str(element.tag)


FOLDER = "(inline)/"
"""Where such files lie for those who read the source: no folder of its own is called that."""
WRITTEN = ("vertex", "face", "builtin", "params")
LOST = ("normal", "texcoord", "facenormal", "facetexcoord")


def write_inline(root: Element, folder: Path) -> Iterator[Finding]:
    """Write each mesh without a file to a folder, and name that file instead of its points."""
    folder.mkdir()
    meshes = [mesh for mesh in root.iterfind("asset/mesh") if not mesh.get("file")]
    for number, mesh in enumerate(meshes):
        name = str(mesh.get("name"))
        if mesh.get("vertex"):
            points, faces = _stated(mesh, name)
        elif mesh.get("builtin"):
            points, faces = _made(mesh, name)
        else:
            raise error_at(mesh, f"mesh `{name}` has neither a file nor points")
        lines = [f"v {' '.join(map(repr, point))}" for point in points]
        lines += [f"f {' '.join(str(corner + 1) for corner in face)}" for face in faces]
        (folder / f"{number}.obj").write_text("\n".join(lines) + "\n", encoding="ascii")
        lost = tuple(word for word in LOST if word in mesh.attrib)
        for word in (*WRITTEN, *LOST):
            mesh.attrib.pop(word, "")
        mesh.set("file", f"{FOLDER}{number}.obj")
        if lost:
            message = f"{', '.join(f'`{a}`' for a in lost)} of mesh `{name}` was left out "
            hint = "store the mesh in an OBJ file"
            whole = f"{message}({where_of(mesh)})"
            yield dropped("mesh", f"mesh {name}", whole, hint, attributes=lost)


_Triangles = tuple[Sequence[Sequence[float]], Sequence[Sequence[int]]]


def _stated(mesh: Element, name: str) -> _Triangles:
    """Points, m, and triangles; without triangles the hull of the points, as MuJoCo has it."""
    try:
        points = np.array([float(word) for word in mesh.get("vertex", "").split()])
        faces = np.array([int(word) for word in mesh.get("face", "").split()], dtype=np.int64)
        points, faces = points.reshape(-1, 3), faces.reshape(-1, 3)
    except ValueError:
        message = f"mesh `{name}`: `vertex` and `face` are rows of three numbers"
        raise error_at(mesh, message) from None
    outside = (faces < 0) | (faces >= len(points))
    if not np.isfinite(points).all() or outside.any():
        raise error_at(mesh, f"mesh `{name}`: a point is not finite, or a corner is none of them")
    if not faces.size:
        try:
            hull = convex_hull(points, subject=f"mesh `{name}`")
        except AssetBuildError as error:
            raise error_at(mesh, error.message, error.hint) from None
        points, faces = hull.vertices, hull.faces
    return points.tolist(), faces.tolist()


def _made(mesh: Element, name: str) -> _Triangles:
    """What MuJoCo makes of `builtin`, moved back from the principal axes where it keeps it."""
    from lxml import etree

    attributes = {key: value for key, value in own_attributes(mesh).items() if key in WRITTEN}
    alone = etree.tostring(etree.Element("mesh", {"name": "m", **attributes}), encoding="unicode")
    text = f"""<mujoco><asset>{alone}</asset>
      <worldbody><geom type="mesh" mesh="m" contype="0" conaffinity="0"/></worldbody></mujoco>"""
    try:
        model = mj.MjModel.from_xml_string(text)
    except (ValueError, RuntimeError) as error:  # the latter where it finds no memory
        message = f"mesh `{name}`: MuJoCo does not make it: {one_line(error, 1000)}"
        raise error_at(mesh, message) from None
    turn = normalised_quat(tuple(float(v) for v in model.mesh_quat[0]))  # type: ignore[arg-type] # four numbers
    points: Array = np.asarray(model.mesh_vert, dtype=np.float64) @ rotation_of(turn).T
    return (points + model.mesh_pos[0]).tolist(), np.asarray(model.mesh_face).tolist()
