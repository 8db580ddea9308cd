"""YAML means what it looks like, and hostile YAML is refused quickly and in little memory."""

from __future__ import annotations

import math
import subprocess
import sys
import textwrap
import time

import pytest

from assetbuild.errors import RecipeError
from assetbuild.recipe.yaml_tree import MAX_COST, parse, plain


def read(text: str | bytes) -> object:
    data = text.encode() if isinstance(text, str) else text
    return plain(parse(data, "r.yaml", RecipeError))


def refused(text: str | bytes) -> RecipeError:
    with pytest.raises(RecipeError) as caught:
        read(text)
    return caught.value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12:30:45", "12:30:45"),
        ("no", "no"),
        ("off", "off"),
        ("Yes", "Yes"),
        ("True", "True"),
        ("true", True),
        ("false", False),
        ("0123", "0123"),
        ("0x1F", "0x1F"),
        ("0o17", "0o17"),
        ("1_000", "1_000"),
        ("2024-01-02", "2024-01-02"),
        ("1e-3", 0.001),
        ("1e3", 1000),
        (".5", 0.5),
        ("-1.5E+2", -150),
        ("8O", "8O"),
        ("+3", 3),
        ("1.", 1),
        ("'1'", "1"),
        ('"true"', "true"),
        ("!!str 12", "12"),
        ("!!float 12", 12),
        ("~", None),
        ("null", None),
        ("", None),
        ("inf", "inf"),
    ],
)
def test_values_mean_what_they_look_like(text, value):
    found = read(f"key: {text}")["key"]
    assert found == value
    assert type(found) is type(value)


def test_infinity_and_nan_are_numbers_that_the_models_refuse():
    assert read("[.inf, -.inf]") == (math.inf, -math.inf)
    assert math.isnan(read("[.nan]")[0])


def test_an_alias_shares_its_anchor():
    assert read("a: &x {k: [1, 2]}\nb: *x\n") == {"a": {"k": (1, 2)}, "b": {"k": (1, 2)}}


@pytest.mark.parametrize(
    ("text", "place", "said", "hint"),
    [
        ("", "", "empty", ""),
        ("# only a comment\n", "", "empty", ""),
        (b"a: 1\nbc: \xff\n", "2:5", "UTF-8", ""),
        ("a: 1\n---\nb: 2\n", "", "second document", ""),
        ("a: [1, 2\nb: 3\n", "", "not YAML", ""),
        ("a: 1\nb: 'c\n\n", "", "a quoted scalar that begins on line 2", ""),
        ("a: b: c\n", "1:5", "not YAML", "quote"),
        ("a: \x07\n", "", "not YAML", ""),
        ("a:\n  b: 1\n c: 2\n", "3:2", "not YAML", "indent"),
        ("a: 1\nbase:fixed\nc: 2\n", "", "begins on line 2", "a space after each colon"),
        ('a: "wrist_\\d"\n', "1:11", "not YAML", "in single quotes"),
        ("a: *wrist\n", "1:4", "not YAML", "quote text that begins with `*`"),
        ("\tkey: 1\n", "1:1", "not YAML", "no tabs"),
        ("@x: 1", "", "not YAML", ""),
        ("? [a, b]\n: 1\n", "", "key must be plain text", ""),
        ("{? : 1}", "", "a key is missing", ""),
        ("a: 1\nb: 2\n'a': 3\n", "3:1", "duplicate key `a`", "line 1"),
        ("a: !!python/object/apply:os.system [x]\n", "1:4", "tag", ""),
        ("a: !!binary aGk=\n", "1:4", "tag", ""),
        ("a: !x 1\n", "1:4", "tag", ""),
        ("a: !!int hello", "", "not what its tag says", ""),
        ("a: &x [1, *x]", "", "inside what it names", ""),
        ("a: 1\nb: *nope\n", "2:4", "", ""),
        ("a: &x {k: 1}\nb:\n  <<: *x\n", "3:3", "merge keys", ""),
    ],
)
def test_text_that_is_no_recipe_is_one_clear_error(text, place, said, hint):
    error = refused(text)
    assert error.where.file == "r.yaml"
    assert str(error.where).endswith(place)
    assert said in error.message and hint in error.hint


def test_aliases_cannot_nest_deeper_than_text_can():
    chain = "".join(f"k{i}: &a{i} [*a{i - 1}]\n" for i in range(1, 80))
    assert "deeper than 64" in refused("k0: &a0 [1]\n" + chain).message


def nine_laughs() -> str:
    rows = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    rows += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 10)]
    return "\n".join(rows)


HOSTILE = {
    "alias bomb": nine_laughs(),
    "deep list": "[" * 500_000,
    "deep map": "{a: " * 500_000,
    "deep block": "".join(f"{' ' * i}k:\n" for i in range(2000)),
    "wide list": "[" + "1," * 1_500_000 + "1]",
    "wide map": "".join(f"k{i}: 1\n" for i in range(300_000)),
    "repeated long text": f"a: &a {'x' * 2_000_000}\nb: [{', '.join(['*a'] * 1000)}]",
    "too long": "a: " + "x" * (4 << 20),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_text_is_refused_in_seconds(name):
    text = HOSTILE[name]
    start = time.process_time()
    refused(text)
    assert time.process_time() - start < 4.0  # about 1 on a quiet machine


def test_a_long_text_is_no_bomb():
    assert read(f"a: {'x' * 1_000_000}") == {"a": "x" * 1_000_000}
    assert MAX_COST > 1_000_000 // 100


def test_a_bomb_takes_less_than_200_megabytes():
    program = textwrap.dedent(
        """
        import resource, sys
        from assetbuild.errors import RecipeError
        from assetbuild.recipe.yaml_tree import parse
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for data in (b"[" * 4_000_000, b"[" + b"1," * 2_000_000, b"{a: " * 1_000_000):
            try:
                parse(data, "r", RecipeError)
            except RecipeError:
                pass
        unit = 1024 if sys.platform == "darwin" else 1
        print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // unit // 1024)
        """
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 200
