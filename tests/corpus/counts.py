"""Shapes, textures and mass of a robot, counted in its source and in what we built of it."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

from defusedxml.ElementTree import parse


def counts_in(source: Path, root: Path) -> dict[str, object]:
    """What the source states, read by another library than ours; a xacro's is its expansion."""
    return in_mjcf(source) if source.suffix == ".xml" else in_urdf(source, root)


def in_mjcf(file: Path) -> dict[str, object]:
    """As MuJoCo compiles it; scenery is no part of a robot."""
    import mujoco

    return of_model(mujoco.MjModel.from_xml_path(str(file)), "in", by_group=False)


def in_urdf(urdf: Path, root: Path) -> dict[str, object]:
    """Elements of the description, and the pictures that its visual meshes name."""
    try:
        robot = parse(urdf).getroot()
    except ParseError:
        return {}
    masses = [float(m.get("value") or 0) for m in robot.iterfind("link/inertial/mass")]
    return {
        **{
            key: len(robot.findall(f"link/{path}"))
            for role in ("visual", "collision")
            for key, path in ((f"{role}_in", role), (f"{role}_meshes_in", f"{role}/geometry/mesh"))
        },
        "mass_source": sum(masses),
        "textures_in": len(pictures_of(robot, urdf, root)),
    }


def pictures_of(robot: Element, urdf: Path, root: Path) -> set[Path]:
    """Pictures of what is seen: the files that the visual meshes name, as far as they exist."""
    found: set[Path] = set()
    for mesh in robot.iterfind("link/visual/geometry/mesh"):
        uri = mesh.get("filename", "")
        inside = re.sub(r"^package:/+[^/]+/", "", uri)
        path = urdf.parent / uri if inside == uri else root / inside
        if path.is_file():
            found |= {picture.resolve() for picture in named_by(path) if picture.is_file()}
    return found


def named_by(mesh: Path) -> list[Path]:
    """Pictures that a COLLADA file or an OBJ's material library names."""
    if mesh.suffix.lower() == ".dae":
        images = [e for e in parse(mesh).getroot().iter() if e.tag.endswith("}image")]
        names = [e.text for image in images for e in image.iter() if e.tag.endswith("}init_from")]
        return [mesh.parent / name.strip() for name in names if name]
    if mesh.suffix.lower() == ".obj":
        text = mesh.read_text(errors="replace")
        libraries = [mesh.parent / n for n in re.findall(r"(?m)^mtllib (.+?)\s*$", text)]
        return [
            library.parent / name
            for library in libraries
            if library.is_file()
            for name in re.findall(r"(?m)^\s*map_Kd (.+?)\s*$", library.read_text())
        ]
    return []


def counts_out(bundle: Path) -> dict[str, object]:
    """Shapes and mass of the MJCF, as MuJoCo compiles it."""
    import mujoco

    (path,) = [p for p in (bundle / "mjcf").glob("*.xml") if p.name != "scene.xml"]
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        return {"note": f"MuJoCo: {error}"[:200]}
    return of_model(model, "out", by_group=not _from_mjcf(bundle))


def _from_mjcf(bundle: Path) -> bool:
    return "mjcf_source" in json.loads((bundle / "report/report.json").read_text())["checks"]


def of_model(model: Any, side: str, *, by_group: bool) -> dict[str, object]:
    """Counts of a compiled model (mujoco has no types).

    by_group: visuals and collision are groups 2 and 3, as we write them; else what touches is
    collision, which holds for any MJCF.
    """
    import mujoco

    kinds = Counter()
    for group, kind, *touches in zip(
        model.geom_group, model.geom_type, model.geom_contype, model.geom_conaffinity, strict=True
    ):
        solid = group == 3 if by_group else any(touches)
        if solid or not by_group or group == 2:
            role = "collision" if solid else "visual"
            kinds[role] += 1
            kinds[f"{role}_meshes"] += kind == mujoco.mjtGeom.mjGEOM_MESH
    roles = ("visual", "visual_meshes", "collision", "collision_meshes")
    pictures = sum(kind == mujoco.mjtTexture.mjTEXTURE_2D for kind in model.tex_type)
    mass = "mass_source" if side == "in" else "mass_mjcf"
    return {
        **{f"{role}_{side}": kinds[role] for role in roles},
        f"actuators_{side}": int(model.nu),
        f"joints_{side}": int(sum(kind != mujoco.mjtJoint.mjJNT_FREE for kind in model.jnt_type)),
        f"textures_{side}": int(pictures),
        mass: float(model.body_mass.sum()),
    }
