"""A small arm with what the legs lack: meshes, a texture, prismatic and mimic joints."""

from __future__ import annotations

from pathlib import Path

from PIL import Image
from tiny import box_obj
from urdfs import box, inertial, joint, link, mesh, robot, shape

PAINTED = """\
mtllib painted.mtl
v -0.1 -0.1 0
v 0.1 -0.1 0
v 0.1 0.1 0
v -0.1 0.1 0
v 0 0 0.15
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vt 0.5 0.4
usemtl painted
f 1/1 3/3 2/2
f 1/1 4/4 3/3
f 1/1 2/2 5/5
f 2/2 3/3 5/5
f 3/3 4/4 5/5
f 4/4 1/1 5/5
"""


def write_arm(folder: Path) -> None:
    """`arm.urdf`, two meshes and a picture: lift, turn, two fingers of which one leads, a tool."""
    folder.mkdir(parents=True)
    (folder / "painted.obj").write_text(PAINTED)
    (folder / "painted.mtl").write_text("newmtl painted\nKd 0.8 0.8 0.8\nmap_Kd painted.png\n")
    (folder / "block.obj").write_bytes(box_obj((0.1, 0.08, 0.2)))
    picture = Image.new("RGB", (8, 8))
    picture.putdata([(30 * x, 30 * y, 90) for y in range(8) for x in range(8)])
    picture.save(folder / "painted.png")
    near, slide = "0.05 0.01 0.02", '<limit lower="0" upper="0.3" effort="30" velocity="1"/>'
    lead = '<mimic joint="grip" multiplier="-0.5" offset="0.01"/>'
    block, painted = mesh("block.obj"), mesh("painted.obj")
    text = robot(
        link("base", inertial(3.0), shape("visual", painted), shape("collision", painted)),
        joint("lift", "base", "mast", "prismatic", slide, axis="0 0 1"),
        link("mast", inertial(1.5, xyz=near), shape("visual", block), shape("collision", block)),
        joint("turn", "mast", "hand", xyz="0.1 0 0.2"),
        link("hand", inertial(0.7), shape("collision", box(0.06), near)),
        joint("grip", "hand", "left", "prismatic", slide, axis="0 1 0"),
        link("left", inertial(0.2), shape("collision", block, near)),
        joint("follow", "hand", "right", "prismatic", slide + lead, axis="0 1 0"),
        link("right", inertial(0.3), shape("collision", box(0.03))),
        joint("hold", "hand", "tool", "fixed", "", axis=None),
        link("tool", inertial(0.4, xyz=near), shape("visual", box(0.05))),
        name="arm",
    )
    (folder / "arm.urdf").write_text(text)
