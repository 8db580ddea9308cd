"""One robot of several: parts under their prefixes, each on a fixed joint."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from assetbuild.compose.composed_control import MountedPart, PartControl, joined, names_of, under
from assetbuild.compose.composed_masks import meeting_masks
from assetbuild.engine.step import Files, Step
from assetbuild.errors import RecipeError, did_you_mean
from assetbuild.findings import Finding, Rule
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles, SourceControl
from assetbuild.robot.model import Body, Joint, Tree
from assetbuild.robot.pose import IDENTITY, Pose, quat_of_rpy
from assetbuild.robot.randomize import homogeneous_box
from assetbuild.robot.sections import Mount
from assetbuild.robot.shapes import Box, MeshFile, SourceShape, SourceShapes
from assetbuild.robot.tree import depth_first

PLATE = "mount_plate"
"""The link that holds a part, by its name without the prefix."""
LEFT_OUT = Rule(
    "compose.left_out",
    "info",
    "a part states something about a whole model (`visual`, `usd`, `simulation`, the `<option>` "
    "of its MJCF, keyframes that the base lacks), and the base's recipe overrides it",
    "state in the base's recipe what the whole robot needs",
)
PART = Rule(
    "compose.part",
    "info",
    "another robot was mounted: its links, mass and mount, whether it floats alone, and where "
    "its root is in its own MJCF",
    "nothing",
)
SCENERY = Rule(
    "compose.scenery",
    "info",
    "cameras and lights in the world of a part's MJCF are attached to its root now, as MuJoCo "
    "attaches them",
    "take them out of the part's MJCF if they belong to a scene",
)


class ComposeParts(Step):
    """`base/` and `<part>/`, each links, shapes and source map -> the same of the whole.

    Of sides that are MJCFs also `source_control.json`.
    """

    outputs = ("links.json", "shapes.json", "source_map.json", "source_control.json")

    parts: tuple[MountedPart, ...]
    keeps: bool = False
    """Whether the bodies of the base's MJCF stay as they are."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises RecipeError for a link that the base has not, and for names that clash."""
        robot = RobotFiles(files.inputs / "base")
        tree, shapes, base = robot.links, robot.source_shapes, robot.source_control
        source_map = _source_map(files.inputs / "base")
        if base is not None and not self.keeps:
            base = replace(base, bodies=())
        sources = [("", base)] if base is not None else []
        for part in self.parts:
            part_robot = RobotFiles(files.inputs / part.prefix)
            own_tree, source_control = part_robot.links, part_robot.source_control
            tree = _mounted(tree, prefixed_tree(own_tree, part.prefix), part)
            named = prefixed_shapes(part_robot.source_shapes, part.prefix)
            plate = _plate_shapes(part.prefix + PLATE, part.mount) if part.mount else ()
            shapes = SourceShapes(
                (*shapes.shapes, *named.shapes, *plate), shapes.materials + named.materials
            )
            source_map["lines"] |= _prefixed_lines(files.inputs / part.prefix, part.prefix)
            place, left_out, scenery = IDENTITY, part.left_out, list[str]()
            if source_control is not None:
                control = PartControl(part, own_tree, source_control)
                sources.append((part.prefix, control.prefixed()))
                place = control.pose_in_root.inverse()
                left_out += control.left_out(base)
                scenery = control.scenery()
            yield from _mount_findings(part, own_tree, place, left_out, scenery)
        met, findings = meeting_masks(sources)
        changed = dict(zip((prefix for prefix, _ in sources), met, strict=True))
        whole = joined(changed.pop("", None), changed)
        _refuse_clashes(tree, shapes, whole)
        yield from findings
        (files.outputs / "links.json").write_bytes(encode(tree))
        (files.outputs / "shapes.json").write_bytes(encode(shapes))
        (files.outputs / "source_control.json").write_bytes(encode(whole))
        files.write_json("source_map.json", source_map)


def prefixed_tree(tree: Tree, prefix: str) -> Tree:
    """The same tree with a prefix on every name."""
    named = (under(prefix, joint, "name", "parent", "child") for joint in tree.joints)
    return replace(
        tree,
        bodies=tuple(under(prefix, body, "name") for body in tree.bodies),
        joints=tuple(replace(j, mimic=j.mimic and under(prefix, j.mimic, "joint")) for j in named),
        frames=tuple(under(prefix, frame, "name", "body") for frame in tree.frames),
    )


def prefixed_shapes(shapes: SourceShapes, prefix: str) -> SourceShapes:
    """The same shapes with a prefix on names, links, materials and paths of meshes."""

    def shape_of(shape: SourceShape) -> SourceShape:
        geometry = shape.geometry
        if isinstance(geometry, MeshFile):
            geometry = replace(geometry, path=part_path(prefix, geometry.path))
        return replace(under(prefix, shape, "name", "link", "material"), geometry=geometry)

    return SourceShapes(
        tuple(map(shape_of, shapes.shapes)),
        tuple(under(f"{prefix}/", under(prefix, m, "name"), "texture") for m in shapes.materials),
    )


def part_path(prefix: str, path: str) -> str:
    """Path of a part's file in the whole."""
    return f"{prefix}/{path}"


def prefixed_subject(subject: str, prefix: str) -> str:
    """`joint calf` of a part as `joint arm_calf`; a mesh by its path."""
    kind, _, name = subject.partition(" ")
    return f"{kind} {part_path(prefix, name) if kind == 'mesh' else prefix + name}"


def _mounted(tree: Tree, part: Tree, on: MountedPart) -> Tree:
    link, plate = on.at.link, on.prefix + PLATE
    if link not in tree.by_body:
        hint = did_you_mean(link, tree.by_body)
        raise RecipeError(f"no link `{link}` to mount `{on.prefix}` on", hint=hint)
    X_link_root = Pose(on.at.xyz, quat_of_rpy(*on.at.rpy))
    bodies = [*tree.bodies, *part.bodies]
    joints = [*tree.joints, *part.joints]
    joints.append(Joint(f"{on.prefix}mount", "fixed", link, part.root, X_link_root))
    if (box := on.mount) is not None:
        bodies.append(Body(plate, homogeneous_box(box.mass, box.size, box.at)))
        joints.append(Joint(f"{plate}_joint", "fixed", link, plate, X_link_root))
    names, ordered = depth_first(tree.root, joints)
    by_name = {body.name: body for body in bodies}
    frames = (*tree.frames, *part.frames)
    return replace(
        tree, bodies=tuple(by_name[name] for name in names), joints=ordered, frames=frames
    )


def _plate_shapes(link: str, mount: Mount) -> tuple[SourceShape, SourceShape]:
    box, at = Box(mount.size), Pose(mount.at)
    return (
        SourceShape(f"{link}_visual", link, "visual", box, at),
        SourceShape(f"{link}_collision", link, "collision", box, at),
    )


def _refuse_clashes(tree: Tree, shapes: SourceShapes, source_control: SourceControl) -> None:
    named = [("link", body.name) for body in tree.bodies]
    named += [("link", frame.name) for frame in tree.frames]
    named += [("joint", joint.name) for joint in tree.joints]
    named += [("shape", shape.name) for shape in shapes.shapes]
    for (kind, name), count in Counter((*named, *names_of(source_control))).items():
        if count > 1:
            hint = "give the part another prefix, `as:`"
            raise RecipeError(f"two parts have a {kind} `{name}`", hint=hint)


def _mount_findings(
    part: MountedPart,
    tree: Tree,
    X_world_root: Pose,
    left_out: tuple[str, ...],
    scenery: Sequence[str],
) -> Iterator[Finding]:
    """X_world_root: in the part's own world, which `at` takes the place of.

    scenery: names of cameras and lights in that world.
    """
    if scenery:
        listed = ", ".join(f"`{part.prefix}{name}`" for name in scenery)
        yield SCENERY(
            "recipe compose",
            f"cameras and lights in the world of the part `{part.prefix}` stand on its "
            f"root now, and move with it: {listed}",
            data={"count": len(scenery)},
        )
    mass = sum(body.inertial.mass_kg for body in tree.bodies if body.inertial)
    mount_kg = part.mount.mass if part.mount else 0.0
    plate = f", and {mount_kg:g} kg of mount" if mount_kg else ""
    held = "; alone it floats, here its root is held" if tree.base == "floating" else ""
    hint = ""
    if X_world_root != IDENTITY:
        where = ", ".join(f"{v:g}" for v in X_world_root.xyz)
        turn = ", ".join(f"{v:.4g}" for v in X_world_root.quat)
        held += f"; in its own world its root stands at ({where}) m, turned by ({turn}) wxyz"
        hint = "`at` places the root itself: add that pose to it to place the part's world"
    yield PART(
        f"link {part.prefix}{tree.root}",
        f"{len(tree.bodies)} links with {mass:g} kg stand on `{part.at.link}`{plate}{held}",
        hint=hint,
        data={"links": len(tree.bodies), "mass_kg": mass, "mount_kg": mount_kg},
    )
    if left_out:
        listed = ", ".join(f"`{key}`" for key in left_out)
        yield LEFT_OUT(
            "recipe compose",
            f"{listed} of the part `{part.prefix}` are ignored: the base's apply",
            data={"keys": left_out},
        )


def _prefixed_lines(folder: Path, prefix: str) -> dict[str, int | str]:
    own = _source_map(folder)
    file = own["file"]
    return {
        prefixed_subject(subject, prefix): line if isinstance(line, str) else f"{file}:{line}"
        for subject, line in own["lines"].items()
        if " " in subject  # the whole is not the part
    }


def _source_map(folder: Path) -> Any:  # Any: JSON
    return json.loads((folder / "source_map.json").read_bytes())
