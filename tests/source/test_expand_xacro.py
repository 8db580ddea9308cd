"""A xacro file becomes URDF, and whatever else it wants it does not get."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path

import pytest
from lxml import etree
from robot_files import run_step

from assetbuild.engine.confine import confine
from assetbuild.errors import SourceError
from assetbuild.source.urdf import expand_xacro
from assetbuild.source.urdf.expand_xacro import ExpandXacro

CANARY = "canary-5f1c"
ESCAPE = (
    "[*([*(c()._module.__builtins__ for c in ().__class__.__base__.__subclasses__() "
    "if c.__name__ == 'catch_warnings')][0] for _ in [0])][0]"
)
"""Python's builtins, past xacro's own check, which does not look inside a generator."""


def robot(body: str) -> str:
    return f'<robot name="r" xmlns:xacro="http://wiki.ros.org/xacro">{body}</robot>'


def expand(folder: Path, files: dict[str, str], **fields):
    """(URDF, files used, findings) of `tree/pkg/r.xacro`."""
    for name, text in files.items():
        path = folder / "in/tree" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode("utf-8", "surrogateescape"))
    (folder / "out").mkdir(exist_ok=True)
    step = ExpandXacro(**{"file": "pkg/r.xacro", "packages": {"pkg": "pkg"}} | fields)
    findings = run_step(step, folder / "in", folder / "out")
    urdf = (folder / "out/robot.urdf").read_text()
    return urdf, json.loads((folder / "out/used.json").read_text()), findings


def refusal(folder: Path, body: str, files: Mapping[str, str] = {}, **fields: object) -> str:
    """The error of a xacro; whatever it wanted must not be in it."""
    with pytest.raises(SourceError) as caught:
        expand(folder, {"pkg/r.xacro": robot(body), **files}, **fields)
    text = str(caught.value)
    assert CANARY not in text
    assert not list((folder / "out").iterdir())
    return text


OF_PKG = '<xacro:include filename="$(find pkg)/m.xacro"/>'
MOVED = "hint: does the package `pkg` lie in `pkg`? correct `source.packages`"
# What the xacro says, other files, fields of the step | words of the error, which begins with them
# where they name a line.
MISTAKES: dict[str, tuple[str, dict[str, str], dict[str, object], tuple[str, ...]]] = {
    "a package a folder above": (OF_PKG, {}, {"packages": {"pkg": "pkg/urdf"}}, (MOVED,)),
    "a package a folder below": (OF_PKG, {}, {"packages": {"pkg": "."}}, (MOVED,)),
    "an argument of another name": (
        '<xacro:arg name="kind" default="x"/><xacro:include filename="$(arg kind).xacro"/>', {},
        {"args": {"knd": "m"}}, ("no `<xacro:arg>` is called `knd`: did you mean `kind`?",),
    ),
    "an argument of another value": (
        '<xacro:include filename="$(find pkg)/$(arg kind)/k.xacro"/>', {"pkg/long/k.xacro": ""},
        {"args": {"kind": "lnog"}}, ("the argument `kind` is `lnog`: did you mean `long`?",),
    ),
    "an argument that nobody gives": ('<link name="$(arg nobody)"/>', {}, {}, ("source.args",)),
    "a macro of old": (
        '<macro name="m" params="x"><link name="${x}"/></macro><xacro:m x="a"/>', {}, {},
        ("hint: write `<xacro:macro`: xacro reads `<macro` no more",),
    ),
    "a macro above its definition": (
        '<xacro:m/>\n<xacro:macro name="m"><link name="a"/></xacro:macro>', {}, {},
        ("pkg/r.xacro:1: ", "it is defined below its first use"),
    ),
    "no such macro": ("\n<xacro:nothing/>", {}, {}, ("pkg/r.xacro:2: ",)),
    "no such name in an include": (
        OF_PKG + "<xacro:good/>",
        {"pkg/m.xacro": robot('\n\n<xacro:macro name="good" params=""><link name="${foo}"/>'
                              "</xacro:macro>")}, {},
        ("pkg/m.xacro:3: ", "hint: define `foo` above its use by "),
    ),
    "an include that is no XML": (
        OF_PKG, {"pkg/m.xacro": "<robot>\n<link>\n</robot>"}, {},
        ("pkg/m.xacro:3: not readable as XML: ", "link line 2", "hint: the file must be XML"),
    ),
    "an include in Latin-1": (
        OF_PKG, {"pkg/m.xacro": '<robot>\n<link name="Revoluci\udcf3n"/></robot>'}, {},
        ("pkg/m.xacro:2: byte 0xf3 is no UTF-8", "hint: save the file as UTF-8"),
    ),
    "no such package": (
        '<xacro:include filename="$(find pkq)/m.xacro"/>', {}, {},
        ("pkg/r.xacro:1: ", "no package named `pkq`", "hint: known: `pkg`"),
    ),
    "a file in other letters": (
        '\n<xacro:include filename="$(find pkg)/urdf/Arm.trans"/>',
        {"pkg/urdf/arm.trans": robot("")}, {},
        ("pkg/r.xacro:2: no file `pkg/urdf/Arm.trans`", "did you mean `pkg/urdf/arm.trans`?"),
    ),
    "broken YAML": (
        "<link name=\"${xacro.load_yaml('y.yaml')}\"/>", {"pkg/y.yaml": "a: 1\nb: [\n"}, {},
        ("pkg/y.yaml:3: not readable as YAML",),
    ),
    "an environment variable": (
        '<link name="$(env CANARY)"/>', {}, {}, ("pkg/r.xacro: environment variable",),
    ),
    "a macro that calls itself": (
        '<xacro:macro name="m" params=""><xacro:m/></xacro:macro><xacro:m/>', {}, {},
        ("uses itself without end",),
    ),
    "too much memory": ("<link name=\"${python.len('x' * 10**11)}\"/>", {}, {}, ("memory",)),
}  # fmt: skip


@pytest.mark.parametrize("what", MISTAKES)
def test_mistakes_name_file_line_and_the_next_move(what: str, tmp_path: Path):
    body, files, fields, words = MISTAKES[what]
    said = refusal(tmp_path, body, {"pkg/m.xacro": robot("")} | files, **fields)
    assert [word for word in words if word not in said] == []
    assert not words[0].startswith("pkg/") or said.startswith(words[0])


def test_arguments_macros_includes_and_yaml_make_the_robot(tmp_path):
    files = {
        "pkg/r.xacro": robot(
            '<xacro:arg name="mass" default="1"/><xacro:include filename="$(find pkg)/m.xacro"/>'
            '<xacro:property name="y" value="${xacro.load_yaml(\'conf/y.yaml\')}"/>'
            '<xacro:part name="a" mass="${2*$(arg mass) + y[\'extra\']}"/>'
        ),
        "pkg/m.xacro": robot(
            '<xacro:macro name="part" params="name mass">'
            '<link name="${name}"><inertial><mass value="${mass}"/></inertial></link>'
            "</xacro:macro>"
        ),
        "pkg/conf/y.yaml": "extra: 0.5\n",
    }
    urdf, used, findings = expand(tmp_path, files, args={"mass": "3"})
    assert etree.fromstring(urdf.encode()).find(".//mass").get("value") == "6.5"
    assert used["files"] == ["pkg/conf/y.yaml", "pkg/m.xacro", "pkg/r.xacro"]
    assert used["packages"] == ["pkg"]
    assert findings == []


@pytest.mark.parametrize(("name", "warns"), [("pi", True), ("pie", False)])
def test_what_xacro_warns_about_is_passed_on_once(name: str, warns: bool, tmp_path):
    """`pi` is xacro's own."""
    body = f'<xacro:property name="{name}" value="3"/>' * 2
    _, _, findings = expand(tmp_path, {"pkg/r.xacro": robot(body)})
    assert [finding.rule for finding in findings] == ["xacro.warning"] * warns


@pytest.mark.parametrize(
    ("name", "known"), [("hand", True), ("used", True), ("hnad", False), ("link", False)]
)
def test_an_argument_that_nothing_takes_is_told(name: str, known: bool, tmp_path):
    body = '<xacro:arg name="hand" default="1"/><xacro:if value="0">$(arg used)</xacro:if>'
    _, _, findings = expand(tmp_path, {"pkg/r.xacro": robot(body)}, args={name: "0"})
    assert [finding.rule for finding in findings] == ["xacro.argument"] * (not known)


def test_paths_of_the_machine_come_out_as_packages(tmp_path):
    body = (
        '<mesh filename="file://$(find pkg)/a.stl"/><mesh filename="$(find pkg)/b.stl"/>'
        '<mesh filename="$(cwd)/other/c.stl"/>'
    )
    urdf, _, _ = expand(tmp_path, {"pkg/r.xacro": robot(body)})
    names = re.findall('filename="(.*?)"', urdf)
    assert names == ["package://pkg/a.stl", "package://pkg/b.stl", "../other/c.stl"]
    assert str(tmp_path) not in urdf


@pytest.mark.parametrize(
    "body",
    [
        '<xacro:include filename="{path}"/>',
        '<xacro:include filename="{path}" optional="true"/>',
        '<xacro:include filename="../../../{name}"/>',
        "<link name=\"${{xacro.load_yaml('{path}')}}\"/>",
        '<link name="${{' + ESCAPE + "['open']('{path}').read()}}\"/>",
    ],
    ids=["include", "optional include", "relative include", "yaml", "escape"],
)
def test_a_file_outside_is_refused_and_named(tmp_path, body):
    outside = tmp_path / "secret.yaml"
    outside.write_text(CANARY)
    text = refusal(tmp_path, body.format(path=outside, name="secret.yaml"))
    assert text.startswith("pkg/r.xacro:1: ")
    assert "secret.yaml" in text
    assert "outside the declared packages" in text


@pytest.mark.parametrize(
    "value",
    ["$(env CANARY)", "$(optenv CANARY nothing)", "${" + ESCAPE + "['__import__']('os').environ}"],
)
def test_the_environment_is_empty(tmp_path, value, monkeypatch):
    monkeypatch.setenv("CANARY", CANARY)
    files = {"pkg/r.xacro": robot(f'<link name="{value}"/>')}
    try:
        urdf, _, _ = expand(tmp_path, files)
    except SourceError as error:
        urdf = str(error)
        assert "CANARY" in urdf
    assert CANARY not in urdf


def test_a_file_cannot_be_written(tmp_path):
    target = tmp_path / "written"
    text = refusal(tmp_path, f"<link name=\"${{{ESCAPE}['open']('{target}', 'w')}}\"/>")
    assert "wants to write" in text
    assert not target.exists()


def test_nothing_is_sent_and_nothing_started(tmp_path):
    for module, call in (("socket", "socket()"), ("os", "system('true')")):
        folder = tmp_path / module
        folder.mkdir()
        body = f"<link name=\"${{{ESCAPE}['__import__']('{module}').{call}}}\"/>"
        assert refusal(folder, body).startswith("pkg/r.xacro: ")


def test_an_endless_loop_is_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(expand_xacro, "SECONDS", 1.5)
    text = refusal(tmp_path, '<link name="${python.sum(python.range(10**15))}"/>')
    assert "more than 1.5 s" in text


def test_an_entity_bomb_is_refused_at_its_doctype(tmp_path):
    bomb = '<!DOCTYPE r [<!ENTITY a "aaaa">]>' + robot("<link name='&a;'/>")
    with pytest.raises(SourceError, match="DOCTYPE"):
        expand(tmp_path, {"pkg/r.xacro": bomb})


def test_the_kernel_itself_refuses_what_is_not_declared(tmp_path):
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    inside.write_text("in")
    outside.write_text(CANARY)
    reader, writer = os.pipe()
    pid = os.fork()
    if pid == 0:
        said = "no landlock"
        if confine([str(inside)]):
            said = inside.read_text()
            for attempt in (outside.read_text, lambda: outside.write_text("x")):
                try:
                    attempt()
                    said += " leaked"
                except OSError:
                    said += " refused"
        os.write(writer, said.encode())
        os._exit(0)
    os.waitpid(pid, 0)
    said = os.read(reader, 100).decode()
    os.close(reader)
    os.close(writer)
    if said == "no landlock":
        pytest.skip("this kernel has no Landlock")
    assert said == "in refused refused"
    assert outside.read_text() == CANARY
