"""Which names of a composite a pattern speaks of: those that its author can have meant."""

from __future__ import annotations

import re

import pytest
from composites import Named, members
from hypothesis import assume, given
from hypothesis import strategies as st
from pydantic import ValidationError

from assetbuild.compose.merging import composed
from assetbuild.compose.names import spoken_of
from assetbuild.errors import RecipeError
from assetbuild.recipe_types import listed
from assetbuild.robot.actuator_table import ActuatorRow
from assetbuild.robot.ranges import first_match

KEY = ("actuators", 0, "joints")


def spoken(pattern: str, *base: str, **parts: tuple[str, ...]) -> set[str]:
    """Joints that a pattern of the base speaks of."""
    made = {prefix: Named(joints, _links(joints)) for prefix, joints in parts.items()}
    member = members(Named(base, _links(base)), **made)[0]
    return set(spoken_of(member, KEY, pattern, "joints"))


def _links(joints: tuple[str, ...]) -> list[str]:
    return ["root", *(f"link_{name}" for name in joints)]


@pytest.mark.parametrize(
    "pattern", [".*", ".*_ja", ".+ja|wheel", "[a-z]+_ja", r"wheel|\w+", "(?!leg_).*"]
)
def test_a_pattern_that_fits_any_part_speaks_of_the_base_alone(pattern):
    assert spoken(pattern, "wheel", "tail_ja", arm_=("ja", "jb")) <= {"wheel", "tail_ja"}


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("arm_ja", {"arm_ja"}),
        ("arm_.*", {"arm_ja", "arm_jb"}),
        ("wheel|arm_ja", {"wheel", "arm_ja"}),
        ("(?i)ARM_JA", {"arm_ja"}),
        ("(wheel|arm_j[ab])", {"wheel", "arm_ja", "arm_jb"}),
        ("(tail|arm)_ja", {"tail_ja", "arm_ja"}),
        (".*_ja|arm_jb", {"tail_ja", "arm_jb"}),
        ("(?!arm_jb)(arm_.*)", {"arm_ja"}),
    ],
)
def test_a_pattern_that_writes_the_prefix_out_speaks_of_the_part(pattern, names):
    assert spoken(pattern, "wheel", "tail_ja", arm_=("ja", "jb")) == names


def test_parts_are_told_apart_by_their_prefixes():
    one = spoken("l_ja", "wheel", l_=("ja",), r_=("ja",))
    both = spoken("[lr]_ja", "wheel", l_=("ja",), r_=("ja",))
    assert (one, both) == ({"l_ja"}, {"l_ja", "r_ja"})
    assert spoken("(j|q)_ja", "wheel", j_=("ja",), q_=("ja",)) == {"j_ja", "q_ja"}


def test_what_may_mean_a_part_or_not_is_an_error():
    with pytest.raises(RecipeError, match="would match `jjj_ja`") as error:
        spoken("[a-r]+_ja", "tail_ja", arm_=("ja",))
    assert "write the prefix `arm_` out" in error.value.hint


@pytest.mark.parametrize(
    ("pattern", "message", "hint"),
    [
        ("whel", "matches no moving joint", "did you mean `wheel`"),
        ("arm_jx", "matches no moving joint", "did you mean `arm_ja`"),
        (".*_ja", "matches no moving joint", "write the prefix of a part out"),
        ("plate_fixed", "matches only joints that do not move", ""),
    ],
)
def test_a_pattern_that_speaks_of_nothing_is_an_error(pattern, message, hint):
    base = Named(("wheel",), ("root", "link_wheel", "plate"))
    member = members(base, arm_=Named(("ja",), ("root", "link_ja")))[0]
    with pytest.raises(RecipeError, match=message) as error:
        spoken_of(member, KEY, pattern, "joints")
    assert hint in error.value.hint


def test_a_part_speaks_of_itself_whatever_its_patterns():
    member = members(
        Named(("wheel",), ("root", "a")), arm_=Named(("ja", "arm_ja"), ("root", "a", "b"))
    )[1]
    assert spoken_of(member, KEY, "(?i)J.*", "joints") == ("arm_ja",)
    assert spoken_of(member, KEY, "arm_ja|jb", "joints") == ("arm_arm_ja",)
    with pytest.raises(RecipeError):
        spoken_of(member, KEY, "wheel", "joints")


names = st.lists(
    st.from_regex(r"(wheel|hip|lift|[a-d])(_joint|_arm|[0-9]|)", fullmatch=True),
    min_size=1,
    max_size=5,
    unique=True,
)
wide = st.sampled_from(
    [".*", r"\w+", ".*_joint", "(?i)[a-z].*", "(hip|lift).*", "[^_]*", ".*[0-9]"]
)


@st.composite
def robots(draw: st.DrawFn) -> tuple[list[str], dict[str, float]]:
    """Names of joints, and a table by patterns each of which matches one of them."""
    joints = draw(names)
    patterns = draw(
        st.lists(
            st.one_of(
                wide,
                st.sampled_from(joints),
                st.lists(st.sampled_from(joints), min_size=2).map("|".join),
            ),
            max_size=4,
            unique=True,
        )
    )
    fitting = [p for p in patterns if any(re.fullmatch(p, name) for name in joints)]
    return joints, {pattern: 0.1 * (n + 1) for n, pattern in enumerate(fitting)}


@given(robots(), robots(), robots(), st.data())
def test_the_whole_is_what_each_robot_says_alone_but_where_the_base_names_a_part(
    base, left, right, data
):
    """Who is meant is known here by how the pattern was made."""
    parts = {"left_": left, "right_": right}
    assume(not any(name.startswith(tuple(parts)) for name in base[0]))
    words, meant = dict(base[1]), {}
    for number in range(data.draw(st.integers(0, 2))):
        prefix = data.draw(st.sampled_from(list(parts)))
        name = data.draw(st.sampled_from(parts[prefix][0]))
        before = data.draw(st.sampled_from(["", f"{base[0][0]}|"]))
        if (pattern := f"{before}{prefix}{name}") not in words:
            words[pattern] = -1.0 - number
            meant.setdefault(prefix + name, words[pattern])

    def robot(joints, table):
        ranges = {"links": {}, "joints": {p: {"encoder_bias": abs(v)} for p, v in table.items()}}
        keyed = {"randomize": ranges} if table else {}
        return Named(joints, _links(tuple(joints)), keyed)

    made = composed(
        members(robot(base[0], words), **{p: robot(*part) for p, part in parts.items()})
    ).recipe.randomize
    expected = {name: first_match(words, name) for name in base[0]}
    for prefix, (joints, table) in parts.items():
        for name in joints:
            expected[prefix + name] = meant.get(prefix + name, first_match(table, name))
    for name, value in expected.items():
        found = first_match(made.joints, name) if made else None
        assert (found.encoder_bias if found else None) == (abs(value) if value else None), name


@given(st.lists(st.text(min_size=1, max_size=12), min_size=1, unique=True), st.text(max_size=12))
def test_listed_names_are_matched_and_nothing_else_is(names, other):
    pattern = listed(names)
    assert all(re.fullmatch(pattern, name) for name in names)
    assert (re.fullmatch(pattern, other) is not None) == (other in names)


def test_a_list_of_names_may_be_longer_than_a_pattern_that_somebody_writes():
    names = [f"a-rather-long.name_of_a_joint_{number}" for number in range(40)]
    row = ActuatorRow(joints=listed(names), kp=1)
    assert ActuatorRow.model_validate(row.model_dump()) == row
    with pytest.raises(ValidationError, match="at most 500 characters"):
        ActuatorRow(joints="(" + listed(names) + ")", kp=1)
