"""Mimic joints follow their leaders."""

from __future__ import annotations

import pytest

from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Body, Joint, Mimic, Tree


def gripper(*mimics: tuple[str, Mimic | None]) -> Tree:
    joints = tuple(
        Joint(name, "revolute", "palm", f"{name}_link", mimic=mimic) for name, mimic in mimics
    )
    return Tree("gripper", "fixed", (Body("palm"), *(Body(j.child) for j in joints)), joints)


def test_a_chain_of_mimics_follows_to_its_end():
    tree = gripper(("c", Mimic("b", 2.0, 0.5)), ("b", Mimic("a", -1.0)), ("a", None))
    assert with_mimics(tree, {"a": 0.25}) == {"c": 0.0, "b": -0.25, "a": 0.25}


def test_what_is_not_named_is_zero_and_an_offset_still_counts():
    tree = gripper(("a", None), ("b", Mimic("a", 3.0, 0.1)))
    assert with_mimics(tree, {"b": 9.0}) == {"a": 0.0, "b": 0.1}


def test_a_circle_is_refused():
    with pytest.raises(ValueError, match="a -> b -> a"):
        with_mimics(gripper(("a", Mimic("b")), ("b", Mimic("a"))), {})
