"""The reader of facts of `xrdf/<robot>.xrdf`: what a planner knows beyond the URDF.

Links are those of the URDF, unmerged. Spheres that cover other collision geometry are found again:
from the robot's shapes and the meshes of the URDF beside, by the collision method `spheres`.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from assetbuild.collision.spheres import covering_spheres
from assetbuild.errors import UsageError, Where
from assetbuild.facts.reader import Proof, Reader
from assetbuild.facts.reference import Reference, filtered_pairs
from assetbuild.facts.table import Table, Value, Writer, pair_name
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.mesh.cover import Reference as Inside
from assetbuild.mesh.cover import union_of
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.shapes import Mesh, Shape, Sphere

if TYPE_CHECKING:
    from yaml import Node

IN_URDF = "stands in the URDF beside"
Ball = tuple[tuple[float, ...], float]
"""Centre and radius, m."""
DEFAULTS: Mapping[str, Any] = {  # Any: plain JSON, here and below
    "joints": ".*", "acceleration": None, "jerk": None, "tool_frames": [], "max_spheres": 32,
    "margin": 0.02,
}  # fmt: skip
"""Defaults of the recipe's `xrdf`, for a bundle that does not state them."""
MESHES = "xrdf meshes"
"""Among the options of a reference: the folder of the URDF's meshes."""
LISTS = {"acceleration_limits": "acceleration", "jerk_limits": "jerk"}
WORLD, SELF = "collision", "self_collision"


class Xrdf(Reader):
    """All facts are words of the format (`xrdf:acceleration`), of joints, links, spheres, pairs."""

    needs: ClassVar = ("xrdf", "urdf")
    form: ClassVar[str] = "xrdf"
    called: ClassVar[str] = "the XRDF"
    folder: ClassVar[str] = "xrdf"
    behind: ClassVar[tuple[str, ...]] = ("xrdf/{robot}.xrdf",)
    lacks: ClassVar[Mapping[str, str]] = {kind: IN_URDF for kind, _ in VOCABULARY}
    asks: ClassVar[tuple[str, ...]] = ("xrdf",)

    def file(self, root: Path, robot: str) -> Path | None:
        """`<robot>.xrdf`."""
        return root / f"{robot}.xrdf"

    def prove(self, reference: Reference, path: Path) -> Proof:
        """Compare the file; the URDF's meshes are needed to fit the spheres again."""
        meshes = str(path.parent.parent / "urdf/meshes")
        return super().prove(
            replace(reference, options={**reference.options, MESHES: meshes}), path
        )

    def read(self, path: Path) -> Table:
        """Every leaf of the YAML; UsageError where it is none."""
        return _File(path).table()

    def expected(self, reference: Reference) -> Table:
        """From the section `xrdf` of the recipe, and the robot."""
        said = {**DEFAULTS, **(reference.options.get("xrdf") or {})}
        book = Writer()
        head: dict[str, Value] = {"format": "xrdf", "format_version": 1.0}
        if said["tool_frames"]:
            head["tool_frames"] = tuple(said["tool_frames"])
        spheres = dict(_spheres(reference, said))
        if spheres:
            head |= {f"{name} geometry": "collision_spheres" for name in (WORLD, SELF)}
        _put(book, "planner", "", head)
        _joints(reference, said, book)
        for link, own in spheres.items():
            for number, (centre, radius) in enumerate(own):
                _put(book, "sphere", f"{link}/{number}", {"centre": centre, "radius": radius})
        for one, other in _unmet(reference, list(spheres)):
            _put(book, "pair", pair_name(one, other), {"ignored": True})
        return book.table()


def _put(book: Writer, kind: str, name: str, facts: Mapping[str, Value]) -> None:
    book.put(kind, name, {f"xrdf:{word}": value for word, value in facts.items()})


# --- what the file must say -----------------------------------------------------------------


def _joints(reference: Reference, said: Mapping[str, Any], book: Writer) -> None:
    """Places in the cspace, limits, default positions; a joint that follows another has none."""
    leading = [joint for joint in reference.tree.moving_joints if joint.mimic is None]
    pose = dict(initial_pose(reference.tree, reference.control).joints)
    driven = {row.joint for row in reference.control.actuators if row.model != "passive"}
    planned = [j.name for j in leading if j.name in driven and re.fullmatch(said["joints"], j.name)]
    for joint in leading:
        _put(book, "joint", joint.name, {"default": pose[joint.name]})
    for place, name in enumerate(planned):
        _put(book, "joint", name, {"place": float(place)})
    for word in LISTS.values():
        limits = {name: _limit(said[word], name) for name in planned}
        for name, limit in limits.items():
            if None not in limits.values():
                _put(book, "joint", name, {word: limit})


def _limit(stated: Any, joint: str) -> float | None:
    if not isinstance(stated, Mapping):
        return None if stated is None else float(stated)
    rows = (float(value) for pattern, value in stated.items() if re.fullmatch(pattern, joint))
    return next(rows, None)


def _spheres(reference: Reference, said: Mapping[str, Any]) -> Iterator[tuple[str, list[Ball]]]:
    """(link, its spheres): those of its collision, or those that cover it."""
    by_link: dict[str, list[Shape]] = {}
    for shape in reference.shapes.of("collision"):
        by_link.setdefault(shape.link, []).append(shape)
    known: dict[object, list[Ball]] = {}
    for link in (body.name for body in reference.links.bodies if body.name in by_link):
        same = tuple((shape.geometry, shape.X_link_shape) for shape in by_link[link])
        if same not in known:
            own: list[Ball] = [(p.xyz, g.radius) for g, p in same if isinstance(g, Sphere)]
            known[same] = own if len(own) == len(same) else _cover(by_link[link], reference, said)
        yield link, known[same]


def _cover(shapes: list[Shape], reference: Reference, said: Mapping[str, Any]) -> list[Ball]:
    files = {mesh.name: mesh.file for mesh in reference.shapes.meshes}
    pieces = []
    for shape in shapes:
        solid = shape.geometry
        if isinstance(solid, Mesh):
            file = Path(str(reference.options.get(MESHES, ""))) / files[solid.mesh]
            try:
                corners = read_triangles(file.read_bytes(), file.name).vertices
            except OSError as error:
                message = f"cannot read `meshes/{file.name}` of the URDF: {error.strerror}"
                raise UsageError(message) from None
            pieces.append(ConvexPiece(convex_hull(shape.X_link_shape.apply(corners))))
        else:
            pieces.append(ConvexPiece(solid, shape.X_link_shape))
    inside = Inside(union_of(pieces)[1])
    found = covering_spheres(inside, said["max_spheres"], said["margin"] * inside.diagonal)
    return [(p.X_frame_piece.xyz, p.solid.radius) for p in found if isinstance(p.solid, Sphere)]


def _unmet(reference: Reference, links: list[str]) -> Iterator[tuple[str, str]]:
    """Links that never meet: their bodies are one, are filtered, or only these two's masks are."""
    tree, shapes, control = reference.tree, reference.shapes, reference.control
    filtered = {frozenset(pair) for pair in filtered_pairs(tree, shapes, control)}
    own = dict(control.contacts)
    for one, other in itertools.combinations(links, 2):
        bodies = frozenset(tree.placement(link)[0] for link in (one, other))
        sides = [
            [own.get(s.name, control.contact) for s in shapes.of("collision") if s.link == link]
            for link in (one, other)
        ]
        masked = not any(
            a.mask & b.partners or b.mask & a.partners for a, b in itertools.product(*sides)
        )
        if len(bodies) == 1 or bodies in filtered or masked:
            yield one, other


# --- what it says ---------------------------------------------------------------------------


class _File:
    """The YAML of one file, taken apart key by key; what is not known is noted as unread."""

    def __init__(self, path: Path) -> None:
        self._name, self._book = path.name, Writer()
        root = _root(path)
        self._joints: list[str] = []
        self._groups: dict[str, str] = {}
        for key, node in self._entries(root, "planner", ""):
            self._section(key, node)

    def table(self) -> Table:
        """All that was read."""
        return self._book.table()

    def _section(self, key: str, node: Node) -> None:
        match key:
            case "format" | "format_version":
                self._fact(node, "planner", "", key)
            case "tool_frames":
                names = [_plain(each) for each in _items(node)]
                if names and all(isinstance(name, str) for name in names):
                    _put(self._book, "planner", "", {key: tuple(map(str, names))})
                else:
                    self._skip(node, key)
            case "default_joint_positions":
                for name, value in self._entries(node, "joint", key):
                    self._fact(value, "joint", name, "default")
            case "cspace":
                self._cspace(node)
            case "collision" | "self_collision":
                self._collision(key, node)
            case "geometry":
                self._geometry(node)
            case _:
                self._skip(node, key)

    def _cspace(self, node: Node) -> None:
        rows = dict(self._entries(node, "planner", "cspace"))
        names = [str(_plain(each)) for each in _items(rows.pop("joint_names", None))]
        for place, name in enumerate(names):
            twice = name in names[:place]
            _put(self._book, "joint", name, {"place again" if twice else "place": float(place)})
        for key, listed in rows.items():
            values = _items(listed)
            if key not in LISTS or len(values) != len(names):
                self._skip(listed, f"cspace.{key}")
                continue
            for name, value in zip(names, values, strict=True):
                self._fact(value, "joint", name, LISTS[key])

    def _collision(self, section: str, node: Node) -> None:
        """Which geometry, how much larger, which pairs never."""
        for key, value in self._entries(node, "planner", section):
            if key == "geometry":
                self._fact(value, "planner", "", f"{section} geometry")
            elif key == "buffer_distance":
                for link, distance in self._entries(value, "planner", f"{section}.{key}"):
                    self._fact(distance, "link", link, f"{section} buffer")
            elif key == "ignore" and section == SELF:
                for one, others in self._entries(value, "planner", f"{section}.{key}"):
                    self._pairs(one, others)
            else:
                self._skip(value, f"{section}.{key}")

    def _pairs(self, one: str, others: Node) -> None:
        if not _items(others):
            self._skip(others, f"{SELF}.ignore.{one}")
        for other in _items(others):
            name = pair_name(one, str(_plain(other)))
            known = self._book.facts
            again = any((key.kind, key.name) == ("pair", name) for key in known)
            self._fact_of(other, "pair", name, "ignored again" if again else "ignored", True)

    def _geometry(self, node: Node) -> None:
        """The spheres of the one group that both sections name."""
        for group, kinds in self._entries(node, "planner", "geometry"):
            for kind, links in self._entries(kinds, "planner", f"geometry.{group}"):
                if kind != "spheres" or group != "collision_spheres":
                    self._skip(links, f"geometry.{group}.{kind}")
                    continue
                for link, spheres in self._entries(links, "planner", f"geometry.{group}.spheres"):
                    for number, sphere in enumerate(_items(spheres)):
                        self._sphere(f"{link}/{number}", sphere)
                    if not _items(spheres):
                        self._skip(spheres, f"geometry.{group}.spheres.{link}")

    def _sphere(self, name: str, node: Node) -> None:
        for key, value in self._entries(node, "sphere", name):
            if key == "center":
                self._fact(value, "sphere", name, "centre")
            elif key == "radius":
                self._fact(value, "sphere", name, "radius")
            else:
                self._skip(value, f"sphere {name}.{key}")

    def _entries(self, node: Node, kind: str, name: str) -> Iterator[tuple[str, Node]]:
        """(key, value) of a mapping; a key that stands twice is unread, as what is no mapping."""
        import yaml

        if not isinstance(node, yaml.MappingNode):
            self._skip(node, f"{kind} {name}".strip())
            return
        seen: set[str] = set()
        for key, value in node.value:
            word = str(key.value)
            if word in seen or not isinstance(key, yaml.ScalarNode):
                self._skip(value, f"{kind} {name}: {word} (again)")
                continue
            seen.add(word)
            yield word, value

    def _fact(self, node: Node, kind: str, name: str, word: str) -> None:
        value = _value(node)
        if value is None:
            self._skip(node, f"{kind} {name}: {word}")
        else:
            self._fact_of(node, kind, name, word, value)

    def _fact_of(self, node: Node, kind: str, name: str, word: str, value: Value) -> None:
        _put(self._book, kind, name, {word: value})
        self._book.place(kind, name, self._where(node))

    def _skip(self, node: Node, attribute: str) -> None:
        self._book.skip(self._where(node), f"`{attribute}`", _plain(node))

    def _where(self, node: Node) -> str:
        return f"{self._name}:{node.start_mark.line + 1}"


def _root(path: Path) -> Node:
    import yaml

    try:
        node = yaml.SafeLoader(path.read_text(encoding="utf-8")).get_single_node()
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = Where(path.name, mark.line + 1 if mark else 0)
        problem = getattr(error, "problem", None) or "no UTF-8 text"
        raise UsageError(f"not readable as YAML: {problem}", where=where) from None
    except OSError as error:
        raise UsageError(f"cannot read `{path}`: {error.strerror}") from None
    if node is None:
        raise UsageError("the file is empty", where=Where(path.name, 1))
    return node


def _items(node: Node | None) -> list[Node]:
    import yaml

    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _plain(node: Node) -> Any:  # Any: YAML's plain data
    import yaml

    return yaml.SafeLoader("").construct_object(node, deep=True)


def _value(node: Node) -> Value:
    """Numbers and texts; a list of numbers; None of anything else."""
    plain = _plain(node)
    if isinstance(plain, str):
        return plain
    numbers = plain if isinstance(plain, list) else [plain]
    if not numbers or not all(
        isinstance(n, int | float) and not isinstance(n, bool) and math.isfinite(n) for n in numbers
    ):
        return None
    return tuple(map(float, numbers)) if isinstance(plain, list) else float(plain)
