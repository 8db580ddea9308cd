"""The robot among several bodies of a world: what is no part of it is cut from the text.

A scene has obstacles, objects to grasp, markers moved by a program (mocap). Where one of the bodies
in the world floats, only one can be the robot: the one that actuators move. The recipe may name it
(`source.body`). With a body goes whatever refers to it; keyframes keep the rest of their numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from assetbuild.errors import SourceError, did_you_mean, quoted
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.robot.contact import Contact
from assetbuild.source.mjcf.text import (
    Classes,
    Element,
    bodies,
    dropped,
    error_at,
    named_bodies,
    of_bodies,
    own_attributes,
    parts,
    remove,
    where_of,
    world_of,
)

SCENERY = Rule(
    "mjcf.scenery",
    "warning",
    "a body of the source's world is no part of the robot and was left out",
    "name the robot's body by `source.body`; make one body of what belongs together",
)
ON_FLOOR = Rule(
    "mjcf.no_floor",
    ("info", "warning"),
    "a shape touches the source's floor by a <pair> or by masks that no other floor has: in the "
    "bundle it touches any floor (a warning where it then touches other shapes, too)",
    "give the geom `contype` and `conaffinity` by `patches` where it shall touch others",
)
OF_PAIR = ("condim", "solref", "solimp", "margin", "gap")
MASKS = ("contype", "conaffinity")
ANY_FLOOR = Contact()
OBJECTS = ("joint", "freejoint", "geom", "site", "camera", "light")
NAMES: Mapping[str, str] = {
    **{f"{kind}{n}": kind for kind in ("body", "joint", "geom", "site") for n in ("", "1", "2")},
    **dict.fromkeys(("refsite", "sidesite", "cranksite", "slidersite"), "site"),
    **{key: key for key in ("camera", "actuator")},
    **dict.fromkeys(("tendon", "tendon1", "tendon2"), "tendon"),
    **{"jointinparent": "joint", "target": "body", "subtree1": "body", "subtree2": "body"},
}
"""Attribute -> kind of what it names."""
SECTIONS = ("tendon", "actuator", "equality", "contact", "sensor")
"""In this order each names only what stands before it."""
WIDTHS = {"free": (7, 6), "ball": (4, 3)}
"""Numbers of a joint in `qpos` and `qvel`; of others one each."""
JOINTS = ("joint", "freejoint")
GROUNDS = ("plane", "hfield")
"""Kinds of geoms that robots stand on."""
_Name = tuple[str, str]
"""Kind and name."""
_Names = set[_Name]


class SeveralRobotsError(SourceError):
    """The file holds several robots. names: of their bodies in the world, in file order; of what
    only floats, that of most parts first.
    """

    def __init__(self, at: Element, message: str, names: tuple[str, ...]) -> None:
        hint = f"choose one in the recipe, `source: {{body: ...}}`: {', '.join(names[:8])}"
        super().__init__(message, where=where_of(at), hint=hint)
        self.names = names


def cut_scenery(root: Element, chosen: str | None) -> Iterator[Finding]:
    """Leave one robot in a world whose elements all have names. chosen: its body, by name.

    Raises SeveralRobotsError where the source does not tell which body is the robot.
    """
    world, classes = world_of(root), Classes(root)
    tops = {str(top.get("name")): top for top in parts(world, "body")}
    kept = _robot(root, tops, chosen, classes)
    gone = [top for name, top in tops.items() if name not in kept]
    lost = set[_Name]().union(*map(_inside, gone))
    if not hangs(root, [tops[name] for name in kept], classes):
        lost |= set(_objects(world, "site", "geom"))
    for compiler in root.iterchildren("compiler") if gone else ():
        if float(compiler.get("settotalmass", "-1")) > 0.0:
            hint = "give the file of the robot alone, or state the masses"
            raise error_at(compiler, "`settotalmass` spreads one mass over a whole scene", hint)
    grounds = [g for g in parts(world, "geom") if classes.attributes(g).get("type") in GROUNDS]
    floors = {
        str(g.get("name")): _masks(g, classes) for g in grounds if ("geom", g.get("name")) in lost
    }
    standing: dict[str, Element] = {}
    for element, missing, severity in _cut(root, gone, lost, classes):
        ends = [str(element.get(f"geom{side}")) for side in (1, 2)]
        what = f"<{element.tag}> `{element.get('name') or ' and '.join(ends)}`"
        if element.tag == "pair" and missing in floors:
            standing, severity = standing | dict.fromkeys(ends, element), "info"
        message = f"{what} was left out ({where_of(element)}): `{missing}` is not part of the robot"
        yield dropped(str(element.tag), "robot", message, severity=severity)
    yield from _on_any_floor(standing, tuple(floors.values()), root, classes)
    for top in gone:
        mocap = top.get("mocap") == "true"
        yield SCENERY(
            f"link {top.get('name')}",
            f"the {'mocap ' if mocap else ''}body `{top.get('name')}` of the world was left out "
            f"({where_of(top)}): it is no part of the robot",
            f"`source: {{body: {top.get('name')}}}` in the recipe would build it instead",
            data={"mocap": mocap, "kept": tuple(kept)},
        )


def _on_any_floor(
    pairs: Mapping[str, Element], floors: Iterable[Contact], root: Element, classes: Classes
) -> Iterator[Finding]:
    """Let the geoms that met the source's floor, and would meet no other, touch any floor.

    pairs: with the floor, by the geom's name; floors: the masks of the source's. A bit is added to
    the mask that meets no other geom by it; `priority` makes the numbers of a pair count.
    """
    geoms = {str(geom.get("name")): geom for geom in of_bodies(root, "geom")}
    masks = {name: _masks(geom, classes) for name, geom in geoms.items()}
    names, others = list[str](), set[str]()
    for name, geom in geoms.items():
        now, said = masks[name], dict[str, str]()
        pair = None if now.contype or now.conaffinity else pairs.get(name)
        if now.meets(ANY_FLOOR) or (pair is None and not any(map(now.meets, floors))):
            continue
        if pair is not None:
            stated = classes.attributes(pair)
            said = {key: stated[key] for key in OF_PAIR if key in stated}
            if "friction" in stated:
                said["friction"] = " ".join(stated["friction"].split()[::2])  # slide, spin, roll
            said |= {"priority": "1"} if said else {}
        wider = [now.model_copy(update={key: getattr(now, key) | 1}) for key in reversed(MASKS)]
        apart = {n: o for n, o in masks.items() if geoms[n].getparent() is not geom.getparent()}
        met = [{n for n, o in apart.items() if new.meets(o) > now.meets(o)} for new in wider]
        masks[name], more = min(zip(wider, met, strict=True), key=lambda choice: len(choice[1]))
        for key, value in (said | {key: str(getattr(masks[name], key)) for key in MASKS}).items():
            geom.set(key, value)
        names.append(name)
        others |= more
    if names:
        message = f"{quoted(names, 8)} touched the source's floor by <pair>s, or by masks that no "
        message += "other floor has: in the bundle they touch any floor"
        message += f", and in the MJCF {quoted(sorted(others), 8)}, too" if others else ""
        severity: Severity = "warning" if others else "info"
        yield ON_FLOOR("robot", message, severity=severity, data={"shapes": tuple(names)})


def _masks(geom: Element, classes: Classes) -> Contact:
    """Masks of a geom; MuJoCo refuses later what is no number."""
    words = {key: classes.attributes(geom).get(key, "1").strip() for key in MASKS}
    return Contact().model_copy(update={k: int(w) for k, w in words.items() if w.isdecimal()})


def _is_held(root: Element) -> bool:
    """Whether a tendon, actuator or equality ties the robot to a site or geom of the world."""
    of_world = set(_objects(world_of(root), "site", "geom"))
    elements = (e for section in ("tendon", "actuator", "equality") for e in _of(root, section))
    return any(of_world & {*_named(e), *(n for c in e for n in _named(c))} for e in elements)


def hangs(root: Element, robot: list[Element], classes: Classes) -> bool:
    """Return whether joints, tendons or several bodies make the world the robot's root."""
    on_top = [_kind(one, classes) for one in parts(robot[0], *JOINTS)] if robot else []
    return len(robot) > 1 or ("free" not in on_top and (bool(on_top) or _is_held(root)))


def _robot(
    root: Element, tops: Mapping[str, Element], chosen: str | None, classes: Classes
) -> tuple[str, ...]:
    """Names of the bodies in the world that are the robot."""
    if chosen is not None:
        if chosen not in tops:
            hint = did_you_mean(chosen, list(tops))
            raise error_at(world_of(root), f"`source.body`: no body `{chosen}` in the world", hint)
        return (chosen,)
    solid = {name: top for name, top in tops.items() if top.get("mocap") != "true"}
    joints = {
        name: {_kind(one, classes) for body in _whole(top) for one in parts(body, *JOINTS)}
        for name, top in solid.items()
    }
    floating = [name for name, kinds in joints.items() if "free" in kinds]
    if len(solid) < 2 or not floating:
        return tuple(solid)
    driven = _driven(root, solid)
    moving = tuple(name for name, kinds in joints.items() if kinds - {"free"})
    loose = sorted(floating, key=lambda name: -len(_whole(solid[name])))
    robots = driven or moving or tuple(loose)
    if len(robots) == 1 or not set(robots) & set(floating):
        return robots
    what = "robots" if driven or moving else "bodies, none of them driven,"
    message = f"{len(robots)} {what} in the world, and a recipe builds one"
    raise SeveralRobotsError(solid[robots[-1]], message, robots)


def _kind(joint: Element, classes: Classes) -> str:
    return "free" if joint.tag == "freejoint" else classes.attributes(joint).get("type", "hinge")


def _driven(root: Element, tops: Mapping[str, Element]) -> tuple[str, ...]:
    """Those that an actuator acts on, if only through a tendon."""
    tendons = {str(t.get("name")): {n for c in t for n in _named(c)} for t in _of(root, "tendon")}
    pulled: _Names = set()
    for actuator in _of(root, "actuator"):
        for kind, name in _named(actuator):
            pulled |= tendons.get(name, set()) if kind == "tendon" else {(kind, name)}
    return tuple(name for name, top in tops.items() if pulled & _inside(top))


def _whole(top: Element) -> list[Element]:
    return [top, *(body for body, _ in bodies(top))]


def _inside(top: Element) -> _Names:
    """(kind, name) of a body and of all on it and below it."""
    names = {("body", str(body.get("name"))) for body in _whole(top)}
    return names.union(*(_objects(body, *OBJECTS) for body in _whole(top)))


def _objects(body: Element, *tags: str) -> Iterator[_Name]:
    """(kind, name) of what stands on a body."""
    for one in parts(body, *tags):
        yield "joint" if one.tag == "freejoint" else str(one.tag), str(one.get("name"))


def _of(root: Element, section: str) -> list[Element]:
    return list(root.iterfind(f"{section}/*"))


def _named(element: Element) -> Iterator[tuple[str, str]]:
    """(kind, name) of all that an element names."""
    stated = own_attributes(element)
    yield from ((kind, name) for key, name in stated.items() if (kind := kind_of(key, stated)))


def kind_of(key: str, stated: Mapping[str, str]) -> str:
    """Kind of what an attribute names, or ""."""
    if key in ("objname", "refname"):
        return stated.get(key.replace("name", "type"), "").removeprefix("x")
    return NAMES.get(key, "")


# --- cutting --------------------------------------------------------------------------------


def _cut(
    root: Element, gone: Iterable[Element], lost: _Names, classes: Classes
) -> Iterator[tuple[Element, str, Severity]]:
    """Yield each element that refers to what is lost, with the name of that.

    One that refers to nothing else is no loss of the robot's, and no warning.
    """
    owners, of_others = _owners(root, classes), set(lost)
    for top in gone:
        remove(top)
    for section in SECTIONS:
        for element in _of(root, section):
            named = [name for e in (element, *element) for name in _named(e)]
            missing = [name for name in named if name in lost]
            if missing:
                of_other = of_others.issuperset(named)
                for names in (lost, of_others) if of_other else (lost,):
                    names.add((section, str(element.get("name"))))
                remove(element)
                yield element, missing[0][1], "info" if of_other else "warning"
    for watching in of_bodies(root, "camera", "light"):
        if ("body", watching.get("target", "")) in lost:
            remove(watching)
            yield watching, str(watching.get("target")), "warning"
    for key in root.iterfind("keyframe/key"):
        _slice(key, owners, lost)


def _owners(root: Element, classes: Classes) -> dict[str, list[_Name]]:
    """Return whose the numbers of a keyframe are, by attribute, in MuJoCo's order."""
    actuators = [("actuator", str(actuator.get("name"))) for actuator in _of(root, "actuator")]
    owners: dict[str, list[_Name]] = {"qpos": [], "qvel": [], "ctrl": actuators}
    for one in [one for body, _ in named_bodies(root) for one in parts(body, *JOINTS)]:
        widths = WIDTHS.get(_kind(one, classes), (1, 1))
        for word, width in zip(("qpos", "qvel"), widths, strict=True):
            owners[word] += [("joint", str(one.get("name")))] * width
    return owners


def _slice(key: Element, owners: Mapping[str, list[_Name]], lost: _Names) -> None:
    """Keep the numbers of a keyframe that belong to what stays; MuJoCo refuses a wrong count."""
    for word, row in owners.items():
        numbers = key.get(word, "").split()
        if len(numbers) == len(row):
            kept = [n for n, owner in zip(numbers, row, strict=True) if owner not in lost]
            key.set(word, " ".join(kept))
            if not kept:
                key.attrib.pop(word)
    if any(kind == "actuator" for kind, _ in lost):
        key.attrib.pop("act", "")  # as many numbers as states; a keyframe of a robot has none
    for word in ("mpos", "mquat"):
        key.attrib.pop(word, "")
