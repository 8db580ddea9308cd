"""The steps of a build in words, and how long one usually takes on one core."""

from __future__ import annotations

STEPS: dict[str, tuple[str, float]] = {
    "fetch": ("downloading the source", 10.0),
    "list_archive": ("listing the archive", 0.2),
    "unpack": ("unpacking", 0.2),
    "list_includes": ("looking for included files", 0.1),
    "expand_xacro": ("expanding the xacro", 0.2),
    "patch": ("patching the source", 0.1),
    "read_urdf": ("reading the URDF", 0.1),
    "flatten_mjcf": ("reading the MJCF's files", 0.2),
    "read_mjcf": ("reading the MJCF", 0.4),
    "lint_export": ("looking for slips of exporters", 0.1),
    "lint_links": ("checking masses and inertias of links", 0.1),
    "lint_bodies": ("checking masses and inertias of bodies", 0.1),
    "lint_density": ("checking densities", 0.1),
    "lint_meshes": ("checking meshes", 0.1),
    "match_shapes": ("matching shapes", 0.5),
    "edit": ("applying edit", 0.1),
    "compose_parts": ("mounting the parts", 0.1),
    "merge_fixed_joints": ("merging links at fixed joints", 0.1),
    "mesh_companions": ("looking for textures of", 0.05),
    "convert_mesh": ("converting mesh", 0.3),
    "convert_texture": ("converting texture", 0.2),
    "decimate_mesh": ("simplifying mesh", 0.3),
    "auto": ("fitting collision of", 2.0),
    "coacd": ("cutting into convex pieces", 8.0),
    "vhacd": ("cutting into convex pieces", 3.0),
    "primitive": ("fitting a primitive to", 2.0),
    "hull": ("computing the hull of", 0.4),
    "assemble": ("putting shapes together", 0.1),
    "control": ("computing drives and poses", 0.1),
    "read_log": ("reading log", 1.0),
    "keep_prior": ("collecting priors of logs", 0.1),
    "fit_logs": ("fitting logs", 30.0),
    "use_fits": ("putting in what was measured", 0.1),
    "ratings": ("collecting ratings of motors", 0.1),
    "pose": ("computing the home pose", 0.1),
    "measure_assets": ("measuring meshes", 0.5),
    "measure_bodies": ("measuring bodies", 0.1),
    "state_ranges": ("writing the ranges of randomization", 0.1),
    "light meshes": ("simplifying meshes for the 3D view", 5.0),
    "viewer": ("making the 3D view", 0.3),
    "picture model": ("preparing the pictures", 0.1),
    "pictures": ("drawing the pictures", 5.0),
    "urdf": ("writing the URDF", 0.1),
    "mjcf": ("writing the MJCF", 0.1),
    "mjx": ("writing the MJX model", 0.2),
    "usd": ("writing the USD", 1.0),
    "mjlab": ("writing the module for mjlab", 0.1),
    "isaaclab": ("writing the module for Isaac Lab", 0.1),
}
"""First words of a step's label -> (what it does, to be followed by its subject; usual seconds)."""
CHECKS: dict[str, tuple[str, float]] = {
    "alignment": ("comparing motions in PhysX and MuJoCo", 60.0),
    "coverage": ("measuring how well collision covers the robot", 3.0),
    "free_fall": ("letting it fall freely", 0.1),
    "gains": ("checking gains", 0.1),
    "mass": ("comparing masses with volumes", 0.5),
    "mirror": ("comparing left with right", 0.1),
    "mjcf_compiles": ("compiling the MJCF", 0.6),
    "oracle": ("comparing dynamics with pinocchio", 0.4),
    "stand": ("letting it hold its pose", 0.3),
    "trials": ("letting it fall and settle", 0.6),
}
"""Name of a check -> the same. Other checks get their words from their names."""
USUAL_S = 0.3
SLOW_CHECK_S = 30.0
"""A check that starts PhysX or a trainer."""
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
}
"""What a check compares with the robot, by its name before `_equal`."""


def step_words(label: str) -> str:
    """`auto trunk` -> `fitting collision of trunk`; the label itself where no words are known.

    Of several robots, the robot's name stays in front: `go1: fitting collision of trunk`.
    """
    robot, colon, own = label.rpartition(":")
    return f"{robot}{colon} {_words(own)}".lstrip()


def usual_seconds(label: str) -> float:
    """How long such a step took on one core of 2024, about, when nothing else is known."""
    own = label.rpartition(":")[2]
    if own.startswith("check "):
        name = own.removeprefix("check ")
        slow = name.startswith(("physx", "smoke"))
        return CHECKS.get(name, ("", SLOW_CHECK_S if slow else USUAL_S))[1]
    known = _known(own)
    return USUAL_S if known is None else STEPS[known[0]][1]


def _words(label: str) -> str:
    if label.startswith("check "):
        return _check_words(label.removeprefix("check "))
    known = _known(label)
    if known is None:
        return label
    step, subject = known
    return f"{STEPS[step][0]} {subject}".rstrip()


def _check_words(name: str) -> str:
    if name in CHECKS:
        return CHECKS[name][0]
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
