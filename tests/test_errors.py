"""`did you mean` names what was meant, and nothing else."""

from __future__ import annotations

from assetbuild.cli import VERBS
from assetbuild.errors import did_you_mean, meant_pattern, nearest

TARGETS = ("isaaclab", "mjcf", "mjlab", "mjx", "urdf", "usd", "xrdf")
KEYS = ("actuators", "base", "collision", "contact", "edits", "feet", "imu", "kd", "keyframes",
        "kp", "motors", "rules", "source", "targets", "validate", "variants", "visual")  # fmt: skip
JOINTS = ("FL_calf_joint", "FL_hip_joint", "FR_calf_joint", "FR_hip_joint")
FILES = ("meshes/collision/calf.stl", "meshes/visual/trunk.stl", "urdf/go1.urdf")

CASES = [
    ("buid", VERBS, "build"),
    ("biuld", VERBS, "build"),
    ("validte", VERBS, "validate"),
    ("valid", VERBS, "validate"),
    ("sdf", VERBS, None),
    ("test", VERBS, None),
    ("run", VERBS, None),
    ("sdf", TARGETS, None),
    ("obj", TARGETS, None),
    ("gltf", TARGETS, None),
    ("mcjf", TARGETS, "mjcf"),
    ("USD", TARGETS, "usd"),
    ("udf", TARGETS, "urdf"),
    ("usda", TARGETS, "usd"),
    ("isaac_lab", TARGETS, "isaaclab"),
    ("isaac", TARGETS, "isaaclab"),
    ("acutators", KEYS, "actuators"),
    ("colision", KEYS, "collision"),
    ("keyframe", KEYS, "keyframes"),
    ("force", KEYS, None),
    ("ki", KEYS, None),
    ("pk", KEYS, None),
    ("kpp", ("kd", "kp"), "kp"),
    ("inertia", KEYS, None),
    ("FR_hip_jiont", JOINTS, "FR_hip_joint"),
    ("FR_knee_joint", JOINTS, None),
    ("meshes/calf.stl", FILES, "meshes/collision/calf.stl"),
    ("go1.urdf", FILES, "urdf/go1.urdf"),
    ("meshes/visual/body.stl", FILES, None),
    ("meshes/visal/trunc.stl", FILES, "meshes/visual/trunk.stl"),
    ("", KEYS, None),
    ("anything", (), None),
]


def test_what_is_offered_for_a_word():
    found = [(wrong, known, nearest(wrong, known)) for wrong, known, _ in CASES]
    assert found == CASES


def test_a_slip_of_the_finger_in_a_longer_name_is_understood():
    known = {*VERBS, *TARGETS}
    for name in (name for name in known if len(name) >= 5):
        for place in range(len(name) - 1):
            assert nearest(name[:place] + name[place + 1 :], known) == name
            assert nearest(name[:place] + name[place] + name[place:], known) == name


PATTERNS = [
    ("FL_hip_jiont", "FL_hip_joint"),
    ("FL", "FL.*"),
    ("calf_joint", ".*calf_joint"),
    ("hip", ".*hip.*"),
    ("hip|calf", ".*(hip|calf).*"),
    ("FL_*", "FL_.*"),
]


def test_a_part_of_a_name_and_a_wildcard_of_a_shell_are_understood_as_patterns():
    hints = [meant_pattern(pattern, JOINTS).partition("?")[0] for pattern, _ in PATTERNS]
    assert hints == [f"did you mean `{meant}`" for _, meant in PATTERNS]
    for pattern in ("knee", r"\w*_knee", "(?i)fl", r"(F)\1|knee", "(a*)*x", "_*" * 20):
        assert meant_pattern(pattern, JOINTS) == did_you_mean(pattern, JOINTS)
