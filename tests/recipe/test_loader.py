"""A recipe's mistakes are named with file, line, column, key and the next move."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from assetbuild.engine.world import files_in
from assetbuild.errors import RecipeError, Where
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.recipe.loader import LoadedRecipe

GOOD = """\
schema: assetbuild/v1
robot: tiny
source:
  path: tiny
  urdf: tiny.urdf
collision:
  default: {method: hull}
  links:
    ".*_foot": {method: primitive, shape: sphere}
motors:
  m: {rotor_inertia: 1e-4, gear: 6, effort: 20}
actuators:
  - {joints: ".*_hip", motor: m, kp: 80, kd: 4}
  - joints: ".*_knee"
    model: passive
keyframes:
  home: {base: on_ground, joints: {".*_hip": 0.5}}
"""


def test_a_good_recipe_loads_with_its_numbers(load):
    recipe = load(GOOD).recipe
    assert recipe.motors["m"].rotor_inertia == 1e-4
    assert recipe.actuators[0].kp == 80.0
    assert isinstance(recipe.actuators[0].kp, float)
    assert recipe.collision.links[".*_foot"].shape == "sphere"


def test_the_plan_can_ask_where_a_key_stands(load):
    loaded = load(GOOD)
    lines = GOOD.splitlines()
    at = loaded.where(("collision", "links", ".*_foot", "method"))
    assert lines[at.line - 1][at.column - 1 :].startswith("method:")
    assert str(at) == "recipes/r.yaml:9:17"
    row = loaded.where(("actuators", 1))
    assert lines[row.line - 1][row.column - 1 :].startswith("joints")


def test_an_absent_key_is_placed_at_what_holds_it(load):
    loaded = load(GOOD)
    assert loaded.where(("actuators", 1, "kp")) == loaded.where(("actuators", 1))
    assert loaded.where(("simulation",)) == Where("recipes/r.yaml", 1, 1)


def test_an_error_of_the_plan_reads_like_one_of_ours(load):
    error = load(GOOD).error(("collision", "links", ".*_foot", "method"), "no method `x`", "hm")
    assert str(error) == (
        'recipes/r.yaml:9:17: collision.links[".*_foot"].method: no method `x`\nhint: hm'
    )


@pytest.mark.parametrize(
    ("old", "new", "place", "said", "hint"),
    [
        ("  default:", "  defualt:", "7:3", "collision.defualt: unknown key", "`default`"),
        ("hull}", "hull, form: visual}", "7:27", "`hull` has no key `form`", "`from`?"),
        ("kp: 80", "kv: 80", "13:34", "unknown key", "did you mean `kd`?"),
        ("kp: 80", "forcerange: 80", "13:34", "unknown key", "did you mean `effort`?"),
        ("kp: 80", "stiffness: 80", "13:34", "unknown key",
         "did you mean `kp`? `damping` is the joint's own, the drive's is `kd`"),
        ("shape: sphere", "shape: spere", "9:43", "expected `box`, `sphere`", "`sphere`"),
        ("kp: 80", "kp: 8O", "13:38", "expected a number, found the text `8O`", "N m/rad"),
        ("kp: 80", "kp: yes", "13:38", "expected a number, found the text `yes`", ""),
        ("kp: 80", "kp: true", "13:38", "expected a number, found `true`", ""),
        ("kp: 80", "kp: '80'", "13:38", "expected a number", ""),
        ("kp: 80", "kp: -1", "13:38", "must be at least 0, found `-1`", ""),
        ("kp: 80", "kp: .inf", "13:38", "must be finite", ""),
        ("kp: 80", "kp: 1.0e+308", "13:38", "check its power of ten", ""),
        ("hull}", "hull, max_outside: 5}", "7:40", "must be at most 1", "`5 mm` or m"),
        ("motors:", "simulation: {timestep: 200}\nmotors:", "10:24", "at most 1", "step, s"),
        ("motors:", "cameras: {c: {rpy: [0, 0, 90]}}\nmotors:", "10:27", "are 1.571", ""),
        ("gear: 6", "gear: 0", "11:34", "must be greater than 0", ""),
        ("robot: tiny", "robot: 12", "2:8", "expected text, found `12`", 'quotes: "12"'),
        ("robot: tiny", "robot: ../x", "2:8", "does not fit", "name of the robot"),
        ("robot: tiny\n", "", "1:1", "missing key `robot`", "name of the robot"),
        ("urdf: tiny.urdf", "urdf: ../x.urdf", "5:9", "inside the source", ""),
        ("urdf: tiny.urdf", "urdf: /etc/passwd", "5:9", "inside the source", ""),
        ("  urdf: tiny.urdf\n", "", "3:1", "give exactly one of `urdf`", ""),
        ("  path: tiny\n", "", "3:1", "exactly one of `path`, `url`, `git`, `pypi`", ""),
        ("path: tiny", "pypi: '-r==1'", "4:9", "does not fit", "name==version"),
        ("on_ground", "on_grund", "17:16", "`on_ground` or a list", "`on_ground`"),
        ("on_ground", "[0, 0]", "17:10", "missing entry 3", ""),
        ("collision:", "identify: [{logs: []}]\ncollision:", "6:13", "1 or more items", ""),
        ("robot: tiny", "robot: tiny\nabout: {vendor: ''}", "3:17", "1 or more characters", ""),
        ("collision:", "identify: [{logs: [a.csv]}]\ncollision:", "6:20", "expected a map", ""),
        ("on_ground", "[0, 0, x]", "17:23", "expected a number", ""),
        ('".*_hip": 0.5', '"[": 0.5', "17:36", "not a regular expression", ""),
        ("  default: {method: hull}", "  default:", "7:3", "expected a map, found nothing", ""),
        ("  default: {method: hull}", "  default: [hull]", "7:3", "a map, found a list", ""),
        ("assetbuild/v1", "assetbuild/v2", "1:9", "`assetbuild/v1`", "`assetbuild/v1`"),
        ("  home:", "  ho me:", "17:3", "not a valid name", ""),
        ("collision:", "targets: [urdf, mjcf, urdf]\ncollision:", "6:1", "named twice: urdf", ""),
        ("collision:", "mjcf: {grammar: 5}\ncollision:", "6:17", "of MuJoCo 3.11 and 4.0", ""),
    ],
)  # fmt: skip
def test_each_mistake_has_its_place_and_its_words(refused, old, new, place, said, hint):
    assert old in GOOD
    error = refused(GOOD.replace(old, new, 1))
    assert str(error.where) == f"recipes/r.yaml:{place}"
    assert said in error.message
    assert hint in error.hint
    assert error.exit_code == 2


def test_every_mistake_is_told_in_the_order_of_the_file(refused):
    text = GOOD.replace("kp: 80", "kp: x").replace("gear: 6", "gaer: 6")
    error = refused(text.replace("hull}", "hull, b: 1}"))
    assert [str(each).splitlines()[0] for each in error.each()] == [
        "recipes/r.yaml:7:27: collision.default.b: `hull` has no key `b`",
        "recipes/r.yaml:11:28: motors.m.gaer: unknown key",
        "recipes/r.yaml:13:38: actuators[0].kp: expected a number, found the text `x`",
    ]


def test_plug_ins_that_there_are_not_are_told_with_all_other_mistakes(refused):
    text = GOOD.replace("method: hull", "method: hul").replace("kp: 80", "kp: x")
    text += "targets: [mjcf, mcjf]\nedits:\n  - {set_mas: {}}\nvariants: {v: {colision: {}}}\n"
    errors = refused(text).each()
    assert [error.message.partition(": expected ")[0] for error in errors] == [
        "collision.default.method", "actuators[0].kp", "targets[1]",
        "edits[0].set_mas: unknown key", "colision: unknown key",
    ]  # fmt: skip
    hints = ("`hull`", "", "`mjcf`", "`set_mass`", "`collision`")
    assert all(hint in error.hint for hint, error in zip(hints, errors, strict=True))


def test_a_misspelt_key_is_not_missing_as_well(refused):
    error = refused(GOOD.replace("robot:", "robto:"))
    assert (error.message, error.also) == ("robto: unknown key", ())


def test_keys_of_a_misspelt_method_are_no_mistakes_of_their_own(refused):
    error = refused(GOOD.replace("{method: primitive,", "{method: primitiv,"))
    assert (error.hint, error.also) == ("did you mean `primitive`?", ())


@pytest.mark.parametrize("text", ["- a\n- b\n", "just text\n", "12\n"])
def test_a_recipe_is_a_map(refused, text):
    assert "expected a map at the top" in refused(text).message


def test_a_file_outside_the_working_folder_is_named_as_it_was_given(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    path = tmp_path / "r.yaml"
    path.write_text("- 1\n")
    with pytest.raises(RecipeError) as caught:
        load_recipe(path)
    assert caught.value.where.file == str(path)
    with pytest.raises(RecipeError) as caught:
        load_recipe("../r.yaml")
    assert caught.value.where.file == "../r.yaml"


def test_what_is_no_readable_file_is_refused_without_waiting(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.yaml")
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    for name in ("pipe.yaml", "folder.yaml", "loop.yaml", "missing.yaml"):
        with pytest.raises(RecipeError) as caught:
            load_recipe(name)
        assert caught.value.where.file == name


def test_the_files_read_are_listed_for_the_stat_record(load, tmp_path):
    loaded = load(GOOD)
    assert list(files_in(loaded.world.record)) == [str(tmp_path / "recipes/r.yaml")]
    assert loaded.path == tmp_path / "recipes/r.yaml"


@pytest.mark.slow
def test_fifty_thousand_mistakes_cost_little_time_and_memory(tmp_path):
    (tmp_path / "r.yaml").write_text("".join(f"k{i}: 1\n" for i in range(49_000)))
    program = (
        "import resource, sys, time\n"
        "from assetbuild.errors import RecipeError\n"
        "from assetbuild.pipeline.recipes import load_recipe\n"
        "memory = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "start, before = time.process_time(), memory()\n"
        "try: load_recipe(sys.argv[1])\n"
        "except RecipeError as error: text = f'{error.message}|{error.uncounted}'\n"
        "unit = 1024 if sys.platform == 'darwin' else 1\n"
        "print(time.process_time() - start, (memory() - before) // unit // 1024, text, sep='|')\n"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "r.yaml")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    seconds, megabytes, text, uncounted = done.stdout.split("|")
    assert "missing key" in text or "unknown key" in text
    assert int(uncounted) > 48_000
    assert float(seconds) < 4.0  # about 1 on a quiet machine
    assert int(megabytes) < 200


@pytest.fixture
def with_motors(load, tmp_path):
    """A recipe that names a file of motors, which holds this text."""

    def load_both(motors: str | None, own: str = "") -> LoadedRecipe:
        if motors is not None:
            (tmp_path / "motors.yaml").write_text(motors)
        head = "schema: assetbuild/v1\nrobot: r\nsource: {path: p, urdf: r.urdf}\n"
        return load(f"{head}motor_file: ../motors.yaml\n{own}")

    return load_both


def test_the_recipe_s_own_motors_come_on_top(with_motors, tmp_path):
    own = "motors: {knee: {extends: hip, gear: 9}, hip: {effort: 2}}\n"
    loaded = with_motors("hip: {gear: 6, effort: 1}\nwheel: {effort: 3}\n", own)
    motors = loaded.recipe.motors
    assert set(motors) == {"hip", "wheel", "knee"}
    assert (motors["hip"].effort, motors["hip"].gear) == (2, None)
    assert str(tmp_path / "motors.yaml") in files_in(loaded.world.record)


@pytest.mark.parametrize(
    ("motors", "place"),
    [(None, ""), ("- 1\n", ""), ("hip: [\n", ""), ("hip:\n  gear: 6\n  torque: 3\n", ":3:3")],
)
def test_an_error_in_the_file_of_motors_names_its_line(with_motors, motors, place):
    with pytest.raises(RecipeError, match=rf"motors\.yaml{place}"):
        with_motors(motors)
