"""Words that MuJoCo 3.11 does not know are refused, or kept where the recipe says so."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest
from mjcfs import read, write
from tiny import run_step

from assetbuild.checks.mjcf_source import MjcfSource
from assetbuild.cli import main
from assetbuild.errors import SourceError
from assetbuild.facts.mjcf_grammar import newer_words_of


def arm(joint: str = "", drive: str = "", geom: str = "", head: str = "") -> str:
    return f"""<mujoco>
<compiler angle="radian"/>{head}
<worldbody><body name="base"><geom size=".1"/><body name="a" pos="0 0 .3">
<joint name="j" axis="0 1 0" range="-1 1" {joint}/>
<geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" {geom}/></body></body></worldbody>
<actuator>{drive}</actuator></mujoco>"""


NEWER = {
    "`springyield`": arm(joint='stiffness="3" springyield="1"'),
    "`castshadow`": arm(geom='castshadow="false"'),
    "`pid`": arm(drive='<pid name="m" joint="j" kp="3" ki="1"/>'),
    '`integrator="discrete"`': arm(head='<option integrator="discrete"/>'),
    "`inheritrange`": arm(drive='<general name="m" joint="j" inheritrange="1" biastype="affine" '
                                'gainprm="2" biasprm="0 -2"/>'),
}  # fmt: skip
KNOWN = [
    '<motor name="m" joint="j" delay=".01" nsample="3"/>',
    '<motor name="m" joint="j" damping="1" armature=".1" gear="2"/>',
    '<dcmotor name="m" joint="j" motorconst=".1" resistance="1"/>',
]
"""Actuators that 3.11 knows and no law of a joint can be."""


@pytest.mark.parametrize("word", NEWER)
def test_a_newer_word_is_refused_with_its_place_and_the_key_that_keeps_it(
    word: str, tmp_path: Path
):
    with pytest.raises(SourceError) as caught:
        read(NEWER[word], tmp_path)
    assert word in caught.value.message
    assert caught.value.where is not None
    assert caught.value.where.line > 1
    assert "mjcf: {grammar: 4.0}" in caught.value.hint


def same_motion(one: mujoco.MjModel, other: mujoco.MjModel) -> None:
    a, b = mujoco.MjData(one), mujoco.MjData(other)
    for step in range(200):
        a.ctrl[:] = b.ctrl[:] = (step % 7) / 3.0 - 1.0
        mujoco.mj_step(one, a)
        mujoco.mj_step(other, b)
    assert abs(a.qpos).max() > 1e-3
    assert b.qpos == pytest.approx(a.qpos, rel=1e-9)


@pytest.mark.parametrize(
    "text", [*NEWER.values(), *(arm(drive=drive) for drive in KNOWN)], ids=[*NEWER, *"123"]
)
def test_what_is_kept_moves_as_in_the_source(text: str, tmp_path: Path):
    done = write(read(text, tmp_path / "read", grammar=4.0), tmp_path / "out")
    assert run_step(MjcfSource(robot="robot"), done.inputs, tmp_path / "check") == []
    source, ours = mujoco.MjModel.from_xml_string(text), mujoco.MjModel.from_xml_path(str(done.xml))
    ours.opt.timestep = source.opt.timestep
    same_motion(source, ours)


@pytest.mark.parametrize("drive", KNOWN)
def test_what_3_11_knows_needs_no_key(drive: str, tmp_path: Path):
    assert newer_words_of(arm(drive=drive)) == ()
    done = write(read(arm(drive=drive), tmp_path / "read"), tmp_path / "out")
    assert "mjcf.motion" in {finding.rule for finding in done.findings}


def test_init_writes_the_key_where_it_is_needed(tmp_path: Path):
    file, recipe = tmp_path / "arm.xml", tmp_path / "arm.yaml"
    file.write_text(NEWER["`castshadow`"])
    assert main(["init", str(file), "-o", str(recipe)]) == 0
    assert "\nmjcf: {grammar: 4.0}" in recipe.read_text()
    recipe.unlink()
    file.write_text(arm())
    assert main(["init", str(file), "-o", str(recipe)]) == 0
    assert "grammar" not in recipe.read_text()


def test_a_grammar_that_is_none_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file, recipe = tmp_path / "arm.xml", tmp_path / "arm.yaml"
    file.write_text(arm())
    main(["init", str(file), "-o", str(recipe)])
    recipe.write_text(recipe.read_text() + "\nmjcf: {grammar: 3.5}\n")
    assert main(["check", str(recipe)]) == 2
    assert "3.11 and 4.0" in capsys.readouterr().err
