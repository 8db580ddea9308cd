"""A robot whose files lie elsewhere than its URDF says is found by `init`, and its recipe checks.

Each case is a tiny robot in a tree of files; `check` runs the recipe that `init` wrote, so what
`init` has found is what a build reads.
"""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from urdfs import inertial, joint, link, mesh, robot, shape

from assetbuild.cli.check import check
from assetbuild.errors import SourceError, UsageError
from assetbuild.findings import Finding
from assetbuild.init import propose, write
from assetbuild.init.source import CASE, find_source

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
OTHER = OBJ.replace("v 1 0 0", "v 2 0 0")
XACRO = "xmlns:xacro='http://www.ros.org/wiki/xacro'"


def lay(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = folder / "ws" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (folder / "ws/.git").mkdir(parents=True, exist_ok=True)
    return folder


def arm(*names: str, role: str = "visual") -> str:
    """A fixed link and a moving one; every name is a mesh of the first."""
    shown = "".join(shape(role, mesh(name)) for name in names)
    return robot(link("a", inertial(), shown), link("b"), joint("j", "a", "b"))


def proposed(folder: Path, file: str) -> dict:
    """`source` of the recipe that `init` writes."""
    out = folder / "arm.yaml"
    write(propose(folder / "ws" / file, out, {}), force=True)
    return yaml.safe_load(out.read_text())["source"]


def said(findings: list[Finding], rule: str) -> Finding:
    return next(finding for finding in findings if finding.rule == rule)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "cache"))


def xacro(body: str) -> str:
    return f"<robot name='arm' {XACRO}>{body}</robot>"


BODY = link("a") + link("b") + joint("j", "a", "b")
SHAPES = {"lib/one/package.xml": "<name>shapes</name>", "lib/one/a.obj": OBJ}
PARTS = {"lib/parts_v2/package.xml": "<name>parts</name>", "lib/parts_v2/meshes/a.obj": OBJ}
COMPUTED = (
    "<xacro:arg name='of' default='parts'/><xacro:property name='v' value='$(arg of)'/>"
    "<xacro:include filename='$(find ${v})/b.xacro'/>"
)
CHAIN = {
    "lib/x/package.xml": "<name>parts</name>",
    "lib/x/b.xacro": xacro("<xacro:include filename='$(find ${v}_more)/c.xacro'/>"),
    "lib/y/package.xml": "<name>parts_more</name>",
    "lib/y/c.xacro": xacro(BODY),
}


def drawn(scheme: str) -> str:
    """A xacro with a mesh of its own package behind a scheme."""
    shown = shape("visual", mesh(f"{scheme}$(find arm)/a.obj"))
    return xacro(link("a", inertial(), shown) + link("b") + joint("j", "a", "b"))


# The robot's file, its text, other files | keys of `source` with their values; None: no such key.
FOUND = {
    "a package above the URDF": (
        "robots/urdf/r.urdf", arm("package://pkg/m/a.obj"), {"pkg/m/a.obj": OBJ},
        {"path": "ws", "packages": {"pkg": "pkg"}},
    ),
    "a package of another name than its folder": (
        "robots/urdf/r.urdf", arm("package://renamed/m/a.obj"), {"robots/m/a.obj": OBJ},
        {"path": "ws/robots", "packages": {"renamed": "."}, "urdf": "urdf/r.urdf"},
    ),
    "three slashes and the folder that holds the package": (
        "robots/urdf/r.urdf", arm("package:///robots/m/a.obj"), {"robots/m/a.obj": OBJ},
        {"path": "ws/robots", "packages": {"robots": "."}},
    ),
    "no package at all": (
        "robots/urdf/r.urdf", arm("../m/a.obj"), {"robots/m/a.obj": OBJ},
        {"path": "ws/robots", "packages": None},
    ),
    "a name that leaves the package and comes back": (
        "ws/arm/urdf/arm.urdf", arm("../../arm/m/a.obj"),
        {"ws/arm/m/a.obj": OBJ, "ws/arm/package.xml": "<name>arm</name>"},
        {"path": "ws/ws", "urdf": "arm/urdf/arm.urdf"},
    ),
    "a name that starts from the package": (
        "arm/urdf/arm.urdf", arm("meshes/a.obj"), {"arm/meshes/a.obj": OBJ},
        {"relative_to": "."},  # of the lowest folder that holds all
    ),
    "a name that starts from the folder above the package": (
        "arm/urdf/arm.urdf", arm("arm/meshes/a.obj"), {"arm/meshes/a.obj": OBJ},
        {"relative_to": "."},
    ),
    "a file beside the URDF wins over one above": (
        "arm/urdf/arm.urdf", arm("meshes/a.obj"),
        {"arm/urdf/meshes/a.obj": OBJ, "arm/meshes/a.obj": OTHER}, {"relative_to": None},
    ),
    "a path of the author": (
        "arm/urdf/arm.urdf", arm("/home/me/ws/arm/meshes/a.obj"), {"arm/meshes/a.obj": OBJ},
        {"absolute": {"/home/me/ws/arm": "."}},
    ),
    "a path of the author as a URI": (
        "arm/urdf/arm.urdf", arm("file:///home/me/ws/arm/meshes/a.obj"),
        {"arm/meshes/a.obj": OBJ}, {"absolute": {"/home/me/ws/arm": "."}},
    ),
    "a path of the author into another package": (
        "arm/urdf/arm.urdf", arm("file:///opt/ros/share/parts/meshes/a.obj"), PARTS,
        {"absolute": {"/opt/ros/share/parts": "lib/parts_v2"}},
    ),
    "a package by the name that it declares": (
        "bot/urdf/arm.urdf", arm("package://shapes/a.obj"), SHAPES,
        {"packages": {"shapes": "lib/one"}},
    ),
    "computed names of packages": (
        "arm/arm.xacro", xacro(COMPUTED), CHAIN,
        {"packages": {"parts": "lib/x", "parts_more": "lib/y"}},
    ),
    "a found package without a scheme": (
        "arm/urdf/arm.xacro", drawn(""), {"arm/a.obj": OBJ}, {"packages": {"arm": "."}},
    ),
    "a found package behind a scheme": (
        "arm/urdf/arm.xacro", drawn("file:///"), {"arm/a.obj": OBJ}, {"packages": {"arm": "."}},
    ),
    "a found package behind `package:`": (
        "arm/urdf/arm.xacro", drawn("package://"), {"arm/a.obj": OBJ}, {"packages": {"arm": "."}},
    ),
    "an include of the xacro's own package": (
        "arm/robots/arm.xacro", xacro("<xacro:include filename='../urdf/b.xacro'/>"),
        {"arm/package.xml": "<name>arm</name>", "arm/urdf/b.xacro": xacro(BODY)},
        {"packages": {"arm": "."}},
    ),
    "a file that CMake installs beside the package.xml": (
        "arm/description/urdf/arm.xacro",
        xacro("<xacro:include filename='$(find arm)/c/b.xacro'/>"),
        {"arm/package.xml": "<name>arm</name>", "arm/description/c/b.xacro": xacro(BODY)},
        {"packages": {"arm": "."}, "xacro": "urdf/arm.xacro"},
    ),
    "a mesh that CMake installs beside the package.xml": (
        "arm/model/urdf/arm.urdf", arm("package://arm/meshes/a.obj"),
        {"arm/package.xml": "<name>arm</name>", "arm/model/meshes/a.obj": OBJ},
        {"packages": {"arm": "."}, "urdf": "urdf/arm.urdf"},
    ),
    "an include of a folder beside the file's, in no package": (
        "arm/urdf/arm.xacro",
        xacro("<xacro:property name='top' value='..'/>"
              "<xacro:include filename='${top}/parts/b.xacro'/>"),
        {"arm/parts/b.xacro": xacro(BODY)},
        {"packages": {"arm": "."}, "xacro": "urdf/arm.xacro"},
    ),
    "an include that leaves the file's folder and comes back to it": (
        "arm/urdf/arm.xacro", xacro("<xacro:include filename='../urdf/b.xacro'/>"),
        {"arm/urdf/b.xacro": xacro(BODY)}, {"packages": {"arm": "."}, "xacro": "urdf/arm.xacro"},
    ),
    "a package of which every file is called otherwise, as Windows does not mind": (
        "rob/urdf/arm.urdf", arm("package://rob/meshes/VISUAL/b.OBJ"),
        {"rob/package.xml": "<name>rob</name>", "rob/meshes/visual/b.obj": OBJ},
        {"packages": {"rob": "."}, "patches": [{
            "file": "urdf/arm.urdf", "find": '"package://rob/meshes/VISUAL/b.OBJ"',
            "replace": '"package://rob/meshes/visual/b.obj"', "because": CASE}]},
    ),
    "a package of which nothing is read": (
        "arm/arm.xacro",
        xacro(BODY + "<gazebo><plugin><p>$(find arm_control)/c.yaml</p></plugin></gazebo>"), {},
        {"missing": {"packages": ["arm_control"]}},
    ),
    "a missing visual": (
        "arm.urdf", arm("a.obj", "none.obj"), {"a.obj": OBJ},
        {"missing": {"visuals": ["none.obj"]}},
    ),
    "two slashes start from the URDF": (
        "arm.urdf", arm("file://meshes/cad/a.obj"), {"meshes/cad/a.obj": OBJ},
        {"absolute": None, "patches": None, "missing": None},
    ),
    "a package without a name": (
        "arm.urdf", arm("package://a.obj"), {"a.obj": OBJ}, {"packages": None, "missing": None},
    ),
    "two slashes and the file alone": (
        "arm.urdf", arm("file://a.obj"), {"a.obj": OBJ},
        {"absolute": None, "patches": None, "missing": None},
    ),
}  # fmt: skip
# What `check` reports of it: rule, words of its message.
REPORTED = {
    "a name that starts from the package": ("urdf.path", "taken to start at `.`, 1 times"),
    "a path of the author": ("urdf.path", "meshes/a.obj"),
    "a package without a name": ("urdf.path", "without a package was taken to start at `.`"),
    "a package of which nothing is read": ("xacro.package_missing", "arm_control"),
    "a missing visual": ("urdf.visual.missing", "none.obj"),
}


@pytest.mark.parametrize("case", FOUND)
def test_files_that_lie_elsewhere_are_found(case: str, tmp_path: Path):
    file, text, files, expected = FOUND[case]
    lay(tmp_path, {file: text} | files)
    source = proposed(tmp_path, file)
    assert {key: source.get(key) for key in expected} == expected
    if case in REPORTED:
        rule, words = REPORTED[case]
        assert words in said(check(tmp_path / "arm.yaml"), rule).message


PACKAGE = "<package><name>rob</name></package>"
TWO_PACKAGES = {f"lib/{n}/package.xml": "<name>shapes</name>" for n in ("one", "two")} | {
    f"lib/{n}/a.obj": OBJ for n in ("one", "two")
}
ROB = {"rob/package.xml": PACKAGE, "rob/meshes/visual/b.obj": OBJ}


def solid(name: str) -> str:
    return arm(name, role="collision")


# The robot's file, its text, other files | words of the error and of its hint.
LOST = {
    "two files of one name": (
        "arm/urdf/arm.urdf", arm("meshes/a.obj"),
        {"arm/meshes/a.obj": OBJ, "meshes/a.obj": OTHER}, ("`meshes/a.obj` is two files",),
    ),
    "the name of a file alone, which proves nothing": (
        "arm/arm.urdf", arm("/home/me/a.obj"), {"arm/a.obj": OBJ}, ("on the author",),
    ),
    "two packages of one name": (
        "bot/urdf/arm.urdf", arm("package://shapes/a.obj"), TWO_PACKAGES,
        ("2 folders are package `shapes`", "lib/one", "lib/two", "--package shapes="),
    ),
    "a package of which something is read": (
        "arm/arm.xacro", xacro(BODY + "<xacro:include filename='$(find parts)/b.xacro'/>"), {},
        ("`$(find parts)`: no package", "`--package` of `init`"),
    ),
    "a missing collision mesh": (
        "arm.urdf", arm("a.obj", "none.obj", role="collision"), {"a.obj": OBJ},
        ("no file `none.obj`",),
    ),
    "a robot of which no mesh is there": ("arm.urdf", arm("none.obj"), {}, ("no file `none.obj`",)),
    "a folder": (
        "rob/arm.urdf", solid("package://rob/mesh%20dir/a.obj"), ROB,
        ("package `rob` is `", "which holds no folder `mesh%20dir`"),
    ),
    "a file": (
        "rob/arm.urdf", solid("package://rob/meshes/a.obj"), ROB,
        ("which holds no file `a.obj` in `meshes`",),
    ),
    "a file of a sister folder": (
        "rob/arm.urdf", solid("package://rob/meshes/collision/b.obj"), ROB,
        ("no folder `collision` in `meshes`", "is `meshes/visual/b.obj` meant?"),
    ),
    "a package": (
        "rob/arm.urdf", solid("package://bob/meshes/a.obj"), ROB,
        ("no folder above", "the package `bob`"),
    ),
    "an include from outside of the repository": (
        "arm.xacro", xacro("<xacro:include filename='../secret.xml'/>"), {"../secret.xml": "<a/>"},
        ("outside the declared packages",),
    ),
    "a package to find": (
        "rob/arm.urdf", solid("$(find bob)/a.obj"), ROB, ("holds the package `bob`",),
    ),
    "a file of that name that is no mesh": (
        "arm.urdf", arm("palm.obj"), {"palm.part": OBJ}, ("clone all of it",),
    ),
    "a mesh of nearly that name": (
        "arm.urdf", arm("palm.obj"), {"palms.obj": OBJ}, ("did you mean `palms.obj`?",),
    ),
    "a part of another number": (
        "arm.urdf", solid("link1.obj"), {"link2.obj": OBJ}, ("clone all of it",),
    ),
    "a part of the same number": (
        "arm.urdf", solid("link1.obj"), {"link1_low.obj": OBJ}, ("did you mean `link1_low.obj`?",),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", LOST)
def test_what_is_there_and_what_is_not_is_said(case: str, tmp_path: Path):
    file, text, files, words = LOST[case]
    lay(tmp_path, {file: text} | files)
    with pytest.raises(SourceError) as caught:
        proposed(tmp_path, file)
    assert [word for word in words if word not in str(caught.value)] == []


@pytest.mark.parametrize("ending", ["gazebo", "XACRO", ""])
def test_a_xacro_may_include_a_file_of_any_ending(tmp_path: Path, ending: str):
    name = f"more.{ending}".rstrip(".")
    body = BODY + f"<xacro:include filename='{name}'/>"
    lay(tmp_path, {"arm/arm.xacro": xacro(body), f"arm/{name}": xacro(link("c").strip())})
    with pytest.raises(SourceError, match=r"root|c"):  # it was read: link c hangs on nothing
        proposed(tmp_path, "arm/arm.xacro")


def test_a_package_that_is_nowhere_may_be_given(tmp_path: Path):
    lay(tmp_path, {"r.urdf": arm("package://far/m/a.obj")})
    far, file = tmp_path / "elsewhere/m/a.obj", tmp_path / "ws/r.urdf"
    far.parent.mkdir(parents=True)
    far.write_text(OBJ)
    with pytest.raises(SourceError, match=r"r\.urdf:2: .*package `far`") as error:
        find_source(file, {})
    assert "--package far=FOLDER" in error.value.hint
    assert find_source(file, {"far": tmp_path / "elsewhere"}).recipe.packages == {
        "far": "elsewhere"
    }
    with pytest.raises(UsageError, match="no such folder"):
        find_source(file, {"far": tmp_path / "nowhere"})


# --- names that are patched -----------------------------------------------------------------


def test_names_of_no_package_start_from_the_urdf(tmp_path: Path):
    """As Onshape's exporters write them."""
    names = ("package:///a.obj", "package:///b.obj")
    lay(tmp_path, {"arm/arm.urdf": arm(*names), "arm/a.obj": OBJ, "arm/b.obj": OTHER})
    patches = proposed(tmp_path, "arm/arm.urdf")["patches"]
    assert [patch["replace"] for patch in patches] == ['"a.obj"', '"b.obj"']


@pytest.mark.parametrize("name", ["meshes/A.OBJ", "Meshes/a.obj", "meshes\\a.obj"])
def test_a_name_that_only_windows_would_find_is_patched(tmp_path: Path, name: str):
    lay(tmp_path, {"arm.urdf": arm(name, name), "meshes/a.obj": OBJ})
    (patch,) = proposed(tmp_path, "arm.urdf")["patches"]
    assert (patch["find"], patch["replace"]) == (f'"{name}"', '"meshes/a.obj"')
    assert patch["times"] == 2
    assert said(check(tmp_path / "arm.yaml"), "source.patch").data["file"] == "arm.urdf"


ENCODED = {
    "package://rob/mesh%20dir/Part%20A.obj": "rob/mesh dir/Part A.obj",
    "../K%C3%B6rper.obj": "rob/K\u00f6rper.obj",
    "file://$(find rob)/meshes/a.obj": "rob/meshes/a.obj",
    "$(find rob)/meshes/a.obj": "rob/meshes/a.obj",
    "file://$( find  looks )/a.obj": "looks/a.obj",
}


@pytest.mark.parametrize("role", ["visual", "collision"])
def test_names_of_the_web_and_of_ros_are_found_and_said(role: str, tmp_path: Path):
    files = {"rob/package.xml": PACKAGE, "rob/urdf/arm.urdf": arm(*ENCODED, role=role)}
    files |= dict.fromkeys(ENCODED.values(), OBJ)
    lay(tmp_path, files | {"looks/package.xml": "<package><name>looks</name></package>"})
    source = proposed(tmp_path, "rob/urdf/arm.urdf")
    assert "missing" not in source
    assert {patch["find"][1:-1] for patch in source["patches"]} == set(ENCODED)
    assert said(check(tmp_path / "arm.yaml"), "source.patch").severity == "info"


def test_a_visual_mesh_in_a_sister_folder_is_named_beside_what_is_missing(tmp_path: Path):
    files = {
        "rob/urdf/arm.urdf": arm("../meshes/seen/b.obj", "../meshes/c.obj"),
        "rob/meshes/visual/b.obj": OBJ,
        "rob/meshes/c.obj": OBJ,
    }
    source = proposed(lay(tmp_path, files), "rob/urdf/arm.urdf")
    assert source["missing"] == {"visuals": ["meshes/seen/b.obj"]}
    hint = "# meshes/seen/b.obj: is `meshes/visual/b.obj` meant?"
    assert hint in (tmp_path / "arm.yaml").read_text()


def test_what_another_package_calls_alike_is_not_proposed(tmp_path: Path):
    files = {
        "rob/arm.urdf": arm(
            *(f"package://{mesh}.obj" for mesh in ("rob/meshes/a", "rob/meshes/c", "bob/meshes/b"))
        ),
        "rob/package.xml": "<package><name>rob</name></package>",
        "bob/package.xml": "<package><name>bob</name></package>",
        **dict.fromkeys(("rob/meshes/c.obj", "bob/meshes/a.obj", "bob/meshes/b.obj"), OBJ),
    }
    source = proposed(lay(tmp_path, files), "rob/arm.urdf")
    assert source["missing"] == {"visuals": ["rob/meshes/a.obj"]}
    assert "bob/meshes/a.obj" not in (tmp_path / "arm.yaml").read_text()


def test_a_build_without_init_says_how_the_file_is_called(tmp_path: Path):
    folder = lay(tmp_path, {"rob/arm.urdf": arm("my%20a.obj"), "rob/my a.obj": OBJ})
    proposed(folder, "rob/arm.urdf")
    recipe = folder / "arm.yaml"
    lines = recipe.read_text().splitlines(keepends=True)
    kept = [line for line in lines if "patches:" not in line and "my%20a" not in line]
    recipe.write_text("".join(kept))
    with pytest.raises(SourceError, match=r"did you mean `my a\.obj`"):
        check(recipe)
