"""Names of the robot as USD identifiers, and where each thing stands on the stage.

The composed stage, with `go1` as the robot's name:

    /go1                         default prim, variant set `Physics`
    /go1/<body>                  one Xform per body, flat, at its world pose for q = 0
    /go1/<body>/<frame>          links that fixed joints merged into the body
    /go1/<body>/<camera>         one in the world stands beside the bodies
    /go1/<body>/visuals/<shape>
    /go1/<body>/collisions/<shape>
    /go1/Joints/<joint>
    /go1/Loops/<loop>            joints outside of the articulation, which close loops
    /go1/Looks/<material>
    /go1/PhysicsMaterials/contact
    /go1/NamedPoses/<keyframe>
"""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Vec3
from assetbuild.robot.shapes import Shape, Shapes
from assetbuild.simulators.usd_names import (
    JOINTS,
    LOOKS,
    PHYSICS_MATERIALS,
    ROOT_JOINT,
    SHAPES,
    body_identifiers,
    frame_identifiers,
    joint_identifiers,
    usd_identifier,
    usd_identifiers,
)

VISUALS, COLLISIONS = SHAPES

RENAMED = Rule(
    "usd.renamed",
    "info",
    "USD does not allow a name",
    "use the new one; displayName keeps the old one",
)


def asset_names(shapes: Shapes) -> dict[str, str]:
    """Identifier of each mesh in the library, by its name."""
    return usd_identifiers(mesh.name for mesh in shapes.meshes)


class PrimPaths:
    """Identifiers of everything in one robot, and the prim paths made of them."""

    def __init__(self, robot: str, tree: Tree, shapes: Shapes) -> None:
        self.root, self.tree = usd_identifier(robot), tree
        self.bodies = body_identifiers(tree)
        self.frames = frame_identifiers(tree)
        self.joints = joint_identifiers(tree)
        self.shapes = usd_identifiers(s.name for s in shapes.shapes)
        self.materials = usd_identifiers(m.name for m in shapes.materials)
        self.assets = asset_names(shapes)

    def body(self, name: str) -> str:
        """Prim path of a body."""
        return f"/{self.root}/{self.bodies[name]}"

    def frame(self, name: str) -> str:
        """Prim path of a merged link, below its body."""
        body, _ = self.tree.placement(name)
        return f"{self.body(body)}/{self.frames[name]}"

    def joint(self, name: str) -> str:
        """Prim path of a joint."""
        return f"/{self.root}/{JOINTS}/{self.joints[name]}"

    def shape(self, shape: Shape) -> str:
        """Prim path of a visual or collision shape, below the body that carries its link."""
        body, _ = self.tree.placement(shape.link)
        group = VISUALS if shape.role == "visual" else COLLISIONS
        return f"{self.body(body)}/{group}/{self.shapes[shape.name]}"

    def material(self, name: str) -> str:
        """Prim path of a material for the eye."""
        return f"/{self.root}/{LOOKS}/{self.materials[name]}"

    def surface(self, friction: Vec3, common: Vec3) -> str:
        """Prim path of the physics material with this friction; `common` is most colliders'."""
        name = "contact"
        if friction != common:
            name += "_" + "_".join(usd_identifier(repr(float(value)))[1:] for value in friction)
        return f"/{self.root}/{PHYSICS_MATERIALS}/{name}"

    @property
    def root_joint(self) -> str:
        """Prim path of the joint between the world and a fixed base."""
        return f"/{self.root}/{JOINTS}/{ROOT_JOINT}"

    def findings(self, robot: str) -> Iterator[Finding]:
        """One `usd.renamed` for each name that a user will look for and not find."""
        for kind, table in (
            ("", {robot: self.root}),
            ("link ", self.bodies | self.frames),
            ("joint ", self.joints),
            ("", self.materials),
        ):
            for name, identifier in table.items():
                if name != identifier:
                    yield RENAMED(
                        f"{kind}{name}" if kind else "robot",
                        f"`{name}` is `{identifier}` in USD, which allows letters, digits and `_` "
                        "only",
                        hint="the prim's displayName keeps the old name",
                        data={"name": name, "identifier": identifier},
                    )
