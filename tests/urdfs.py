"""URDF texts: a robot of links and joints in as few words as a test needs."""

from __future__ import annotations

LIMIT = '<limit lower="-1" upper="1" effort="9" velocity="5"/>'


def tensor(xx: float, yy: float, zz: float) -> str:
    """Moments of inertia along the link's axes, kg m²."""
    return f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/>'


SOUND = tensor(0.01, 0.01, 0.01)


def inertial(mass: float = 1.0, inertia: str = SOUND, xyz: str = "0 0 0") -> str:
    """mass: kg. xyz: the centre of mass, m."""
    return f'<inertial><origin xyz="{xyz}"/><mass value="{mass}"/>{inertia}</inertial>'


def shape(role: str, geometry: str, xyz: str = "0 0 0") -> str:
    """role: `visual` or `collision`. xyz: m."""
    return f'<{role}><origin xyz="{xyz}"/><geometry>{geometry}</geometry></{role}>'


def box(edge: float = 0.1) -> str:
    """edge: m."""
    return f'<box size="{edge} {edge} {edge}"/>'


def mesh(filename: str) -> str:
    return f'<mesh filename="{filename}"/>'


def link(name: str, *content: str) -> str:
    """A link; a sound inertia unless it says what it holds."""
    return f'<link name="{name}">{"".join(content or (inertial(),))}</link>\n'


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    content: str = LIMIT,
    *,
    xyz: str = "0 0 0.4",
    axis: str | None = "0 1 0",
) -> str:
    """xyz: the child's place in its parent, m. axis: None leaves it out."""
    turns = f'<axis xyz="{axis}"/>' if axis else ""
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}"/><parent link="{parent}"/>'
        f'<child link="{child}"/>{turns}{content}</joint>\n'
    )


def robot(*parts: str, name: str = "r") -> str:
    return f'<robot name="{name}">\n{"".join(parts)}</robot>\n'
