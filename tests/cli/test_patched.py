"""A patch of the source's text is part of what a build depends on, and of nothing more."""

from __future__ import annotations

from .conftest import Legs
from .test_world import settled

MASS = 'mass value="6"'
DIFF = """--- a/four_legs.urdf
+++ b/four_legs.urdf
@@ -2,2 +2,2 @@
-<!-- A dog: knees that cannot be straight, feet of their own, an IMU and a camera on the trunk. -->
+<!-- A dog -->
 <robot name="four_legs">
"""


def patch(legs: Legs, *rows: str) -> None:
    legs.edit("urdf: four_legs.urdf", f"urdf: four_legs.urdf, patches: [{', '.join(rows)}]")


def ran(legs: Legs) -> set[str]:
    assert legs.build().returncode == 0
    return {label for label, status in legs.steps().items() if status == "ran"}


def test_a_changed_patch_runs_again_what_it_touches(warm_legs: Legs):
    row = "{file: four_legs.urdf, find: 'A dog:', replace: 'A cat:', because: it purrs}"
    patch(warm_legs, row)
    touched = {"patch 1 four_legs.urdf", "read_urdf", "lint_export"}
    assert ran(warm_legs) == touched
    warm_legs.edit("it purrs", "it climbs")
    assert ran(warm_legs) == {"patch 1 four_legs.urdf"}  # the same text comes of it
    warm_legs.edit("A cat:", "A lion:")
    assert ran(warm_legs) == touched


def test_an_edited_diff_is_built(warm_legs: Legs):
    (warm_legs.folder / "fix.diff").write_text(DIFF)
    patch(warm_legs, "{diff: fix.diff, because: brevity}")
    is_null = settled(warm_legs)
    (warm_legs.folder / "fix.diff").write_text(DIFF.replace("+<!-- A dog -->", "+<!-- A cat -->"))
    assert not is_null()
    assert is_null()


def test_the_bundle_is_of_the_patched_robot(warm_legs: Legs):
    row = f"{{file: four_legs.urdf, find: '{MASS}', replace: '{MASS.replace('6', '7')}', "
    patch(warm_legs, row + "because: it was weighed}")
    assert warm_legs.build().returncode == 0
    assert 'mass value="7' in (warm_legs.bundle / "urdf/legs.urdf").read_text()
    assert "it was weighed" in (warm_legs.bundle / "report/report.json").read_text()
