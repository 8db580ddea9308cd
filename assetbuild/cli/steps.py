"""The steps of a build in words."""

from __future__ import annotations

STEPS = {
    "fetch": "downloading the source",
    "list_archive": "listing the archive",
    "unpack": "unpacking",
    "list_includes": "looking for included files",
    "expand_xacro": "expanding the xacro",
    "patch": "patching the source",
    "read_urdf": "reading the URDF",
    "flatten_mjcf": "reading the MJCF's files",
    "read_mjcf": "reading the MJCF",
    "lint_export": "looking for slips of exporters",
    "lint_links": "checking masses and inertias of links",
    "lint_bodies": "checking masses and inertias of bodies",
    "lint_density": "checking densities",
    "lint_meshes": "checking meshes",
    "match_shapes": "matching shapes",
    "edit": "applying edit",
    "compose_parts": "mounting the parts",
    "merge_fixed_joints": "merging links at fixed joints",
    "mesh_companions": "looking for textures of",
    "convert_mesh": "converting mesh",
    "convert_texture": "converting texture",
    "decimate_mesh": "simplifying mesh",
    "auto": "fitting collision of",
    "coacd": "cutting into convex pieces",
    "vhacd": "cutting into convex pieces",
    "primitive": "fitting a primitive to",
    "hull": "computing the hull of",
    "spheres": "filling with spheres",
    "explicit": "taking the given collision shapes of",
    "assemble": "putting shapes together",
    "control": "computing drives and poses",
    "read_log": "reading log",
    "keep_prior": "collecting priors of logs",
    "fit_logs": "fitting logs",
    "excite": "looking for commands that show the parameters",
    "use_fits": "putting in what was measured",
    "ratings": "collecting ratings of motors",
    "pose": "computing the home pose",
    "measure_assets": "measuring meshes",
    "measure_bodies": "measuring bodies",
    "state_ranges": "writing the ranges of randomization",
    "light meshes": "simplifying meshes for the 3D view",
    "viewer": "making the 3D view",
    "picture model": "preparing the pictures",
    "pictures": "drawing the pictures",
    "urdf": "writing the URDF",
    "mjcf": "writing the MJCF",
    "mjx": "writing the MJX model",
    "usd": "writing the USD",
    "mjlab": "writing the module for mjlab",
    "isaaclab": "writing the module for Isaac Lab",
    "xrdf": "fitting spheres and writing the XRDF",
}
"""First words of a step's label -> what it does, to be followed by its subject."""
CHECKS = {
    "alignment": "comparing motions in PhysX and MuJoCo",
    "counts": "looking for what the source had and the files lack",
    "coverage": "measuring how well collision covers the robot",
    "free_fall": "letting it fall freely in MuJoCo",
    "full_effort": "pushing joints with full effort",
    "gains": "checking gains",
    "grip": "gripping objects in MuJoCo",
    "mass": "comparing masses with volumes",
    "mirror": "comparing left with right",
    "loops": "swinging the drives of its loops in MuJoCo",
    "mjcf_compiles": "compiling the MJCF",
    "mjcf_doctor": "asking mjcf-doctor about the scene",
    "mjcf_source": "comparing the MJCF with its source",
    "mjlab_contract": "checking what mjlab asks of a robot",
    "mjx_pairs": "looking at pairs of geoms for MJX",
    "newton_alignment": "comparing motions in Newton and MuJoCo",
    "newton_grip": "gripping objects in Newton",
    "newton_slope": "standing on a slope in Newton",
    "newton_loops": "swinging the drives of its loops in Newton",
    "oracle": "comparing dynamics with pinocchio",
    "physx_free_fall": "letting it fall freely in PhysX",
    "physx_grip": "gripping objects in PhysX",
    "physx_loops": "swinging the drives of its loops in PhysX",
    "physx_slope": "standing on a slope in PhysX",
    "physx_readback": "reading it back from PhysX",
    "asset_validator": "asking NVIDIA's asset validator about the USD",
    "simready": "asking SimReady's validator about the USD",
    "simcheck": "asking simcheck about the MJCF",
    "smoke_isaaclab": "trying it in Isaac Lab",
    "smoke_mjlab": "trying it in mjlab",
    "smoke_newton": "reading it back from Newton",
    "slope": "standing on a slope",
    "stand": "letting it hold its pose",
    "trials": "letting it fall and settle",
    "urdf_kinematics": "comparing poses of the URDF with yourdfpy",
    "urdf_loads": "reading the URDF with urdfdom",
    "usd_valid": "validating the USD",
}
"""Name of a check -> what it does. Other checks get their words from their names."""
NAMES = {
    "bare": "the bare MJCF",
    "dr": "the ranges",
    "isaaclab": "Isaac Lab's module",
    "mjcf": "the MJCF",
    "mjlab": "mjlab's module",
    "mjx": "the MJX model",
    "scene": "the scene",
    "scene_mjx": "the MJX scene",
    "urdf": "the URDF",
    "usd": "the USD",
    "usd_scene": "the USD scene",
    "xrdf": "the XRDF",
}
"""What a check compares with the robot, by its name before `_equal`."""


def step_words(label: str) -> str:
    """`auto trunk` -> `fitting collision of trunk`; the label itself where no words are known.

    Of several robots, the robot's name stays in front: `go1: fitting collision of trunk`.
    """
    robot, colon, own = label.rpartition(":")
    return f"{robot}{colon} {_words(own)}".lstrip()


def _words(label: str) -> str:
    if label.startswith("check "):
        return _check_words(label.removeprefix("check "))
    known = _known(label)
    if known is None:
        return label
    step, subject = known
    return f"{STEPS[step]} {subject}".rstrip()


def _check_words(name: str) -> str:
    if name in CHECKS:
        return CHECKS[name]
    what, equal, _ = name.partition("_equal")
    shown = what.replace("_", " ")
    return f"comparing {NAMES.get(what, shown)} with the robot" if equal else f"checking {shown}"


def _known(label: str) -> tuple[str, str] | None:
    """(the step, its subject); the prefix of a part of a composite, before it, goes to the end."""
    first, _, rest = label.partition(" ")
    if label in STEPS:
        return label, ""
    if first in STEPS:
        return first, rest
    second, _, subject = rest.partition(" ")
    if rest in STEPS or second in STEPS:
        step, subject = (rest, "") if rest in STEPS else (second, subject)
        return step, f"{subject} ({first})".strip()
    return None
