"""A patch of the source's text is part of what a build depends on, and of nothing more."""

from __future__ import annotations

from .conftest import Legs


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
