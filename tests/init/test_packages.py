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
from assetbuild.errors import SourceError
from assetbuild.findings import Finding
from assetbuild.init import propose, write

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


def built(folder: Path, file: str) -> tuple[dict, list[Finding]]:
    """(`source` of the recipe that `init` writes, findings of its `check`)."""
    return proposed(folder, file), check(folder / "arm.yaml")


def said(findings: list[Finding], rule: str) -> Finding:
    return next(finding for finding in findings if finding.rule == rule)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "cache"))


# --- relative and absolute names ------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "start"), [("meshes/a.obj", "."), ("arm/meshes/a.obj", ".")], ids=["package", "assets"]
)
def test_a_name_may_start_from_a_folder_above(tmp_path: Path, name: str, start: str):
    lay(tmp_path, {"arm/urdf/arm.urdf": arm(name), "arm/meshes/a.obj": OBJ})
    source, findings = built(tmp_path, "arm/urdf/arm.urdf")
    assert source["relative_to"] == start  # of the lowest folder that holds all
    assert "taken to start at `.`, 1 times" in said(findings, "urdf.path").message


def test_a_file_beside_the_urdf_wins_over_one_above(tmp_path: Path):
    files = {"arm/urdf/meshes/a.obj": OBJ, "arm/meshes/a.obj": OTHER}
    lay(tmp_path, {"arm/urdf/arm.urdf": arm("meshes/a.obj")} | files)
    assert "relative_to" not in proposed(tmp_path, "arm/urdf/arm.urdf")


def test_two_folders_with_other_bytes_are_refused(tmp_path: Path):
    files = {"arm/meshes/a.obj": OBJ, "meshes/a.obj": OTHER}
    lay(tmp_path, {"arm/urdf/arm.urdf": arm("meshes/a.obj")} | files)
    with pytest.raises(SourceError, match=r"`meshes/a\.obj` is two files"):
        proposed(tmp_path, "arm/urdf/arm.urdf")


@pytest.mark.parametrize("scheme", ["", "file://"])
def test_a_path_of_the_author_is_found_by_its_end(tmp_path: Path, scheme: str):
    name = f"{scheme}/home/me/ws/arm/meshes/a.obj"
    lay(tmp_path, {"arm/urdf/arm.urdf": arm(name), "arm/meshes/a.obj": OBJ})
    source, findings = built(tmp_path, "arm/urdf/arm.urdf")
    assert source["absolute"] == {"/home/me/ws/arm": "."}
    found = said(findings, "urdf.path")
    assert found.severity == "warning"
    assert found.data["path"] == "meshes/a.obj"


def test_a_path_of_the_author_into_another_package_is_found(tmp_path: Path):
    name = "file:///opt/ros/share/parts/meshes/a.obj"
    files = {"lib/parts_v2/package.xml": "<name>parts</name>", "lib/parts_v2/meshes/a.obj": OBJ}
    lay(tmp_path, {"arm/urdf/arm.urdf": arm(name)} | files)
    source = proposed(tmp_path, "arm/urdf/arm.urdf")
    assert source["absolute"] == {"/opt/ros/share/parts": "lib/parts_v2"}


def test_the_name_of_a_file_alone_proves_nothing(tmp_path: Path):
    lay(tmp_path, {"arm/arm.urdf": arm("/home/me/a.obj"), "arm/a.obj": OBJ})
    with pytest.raises(SourceError, match="on the author"):
        proposed(tmp_path, "arm/arm.urdf")


# --- packages -------------------------------------------------------------------------------


def test_a_package_is_known_by_the_name_that_it_declares(tmp_path: Path):
    files = {"lib/one/package.xml": "<name>shapes</name>", "lib/one/a.obj": OBJ}
    lay(tmp_path, {"bot/urdf/arm.urdf": arm("package://shapes/a.obj")} | files)
    assert proposed(tmp_path, "bot/urdf/arm.urdf")["packages"] == {"shapes": "lib/one"}


def test_two_packages_of_one_name_are_a_choice(tmp_path: Path):
    files = {f"lib/{n}/package.xml": "<name>shapes</name>" for n in ("one", "two")}
    files |= {f"lib/{n}/a.obj": OBJ for n in ("one", "two")}
    lay(tmp_path, {"bot/urdf/arm.urdf": arm("package://shapes/a.obj")} | files)
    with pytest.raises(SourceError, match="2 folders are package `shapes`") as raised:
        proposed(tmp_path, "bot/urdf/arm.urdf")
    assert raised.value.hint.count("--package shapes=") == 2


def xacro(body: str) -> str:
    return f"<robot name='arm' {XACRO}>{body}</robot>"


BODY = link("a") + link("b") + joint("j", "a", "b")


@pytest.mark.parametrize("ending", ["gazebo", "XACRO", ""])
def test_a_xacro_may_include_a_file_of_any_ending(tmp_path: Path, ending: str):
    name = f"more.{ending}".rstrip(".")
    body = BODY + f"<xacro:include filename='{name}'/>"
    lay(tmp_path, {"arm/arm.xacro": xacro(body), f"arm/{name}": xacro(link("c").strip())})
    with pytest.raises(SourceError, match=r"root|c"):  # it was read: link c hangs on nothing
        proposed(tmp_path, "arm/arm.xacro")


def test_names_of_packages_may_be_computed(tmp_path: Path):
    body = (
        "<xacro:arg name='of' default='parts'/><xacro:property name='v' value='$(arg of)'/>"
        "<xacro:include filename='$(find ${v})/b.xacro'/>"
    )
    inner = xacro("<xacro:include filename='$(find ${v}_more)/c.xacro'/>")
    files = {"lib/x/package.xml": "<name>parts</name>", "lib/x/b.xacro": inner}
    files |= {"lib/y/package.xml": "<name>parts_more</name>", "lib/y/c.xacro": xacro(BODY)}
    lay(tmp_path, {"arm/arm.xacro": xacro(body)} | files)
    source = proposed(tmp_path, "arm/arm.xacro")
    assert source["packages"] == {"parts": "lib/x", "parts_more": "lib/y"}


@pytest.mark.parametrize("scheme", ["", "file:///", "package://"])
def test_a_found_package_is_one_behind_any_scheme(tmp_path: Path, scheme: str):
    shown = shape("visual", mesh(f"{scheme}$(find arm)/a.obj"))
    body = link("a", inertial(), shown) + link("b") + joint("j", "a", "b")
    lay(tmp_path, {"arm/urdf/arm.xacro": xacro(body), "arm/a.obj": OBJ})
    source = proposed(tmp_path, "arm/urdf/arm.xacro")
    assert source["packages"] == {"arm": "."}


def test_a_xacro_may_include_from_its_own_package(tmp_path: Path):
    files = {"arm/package.xml": "<name>arm</name>", "arm/urdf/b.xacro": xacro(BODY)}
    main = xacro("<xacro:include filename='../urdf/b.xacro'/>")
    lay(tmp_path, {"arm/robots/arm.xacro": main} | files)
    source = proposed(tmp_path, "arm/robots/arm.xacro")
    assert source["packages"] == {"arm": "."}


def test_a_package_of_which_nothing_is_read_may_be_missing(tmp_path: Path):
    body = BODY + "<gazebo><plugin><p>$(find arm_control)/c.yaml</p></plugin></gazebo>"
    lay(tmp_path, {"arm/arm.xacro": xacro(body)})
    source, findings = built(tmp_path, "arm/arm.xacro")
    assert source["missing"] == {"packages": ["arm_control"]}
    assert said(findings, "xacro.package_missing").data["package"] == "arm_control"


def test_a_package_of_which_something_is_read_may_not(tmp_path: Path):
    body = BODY + "<xacro:include filename='$(find parts)/b.xacro'/>"
    lay(tmp_path, {"arm/arm.xacro": xacro(body)})
    with pytest.raises(SourceError, match=r"`\$\(find parts\)`: no package") as raised:
        proposed(tmp_path, "arm/arm.xacro")
    assert "`--package` of `init`" in raised.value.hint


# --- what is missing, and what is called otherwise ------------------------------------------


def test_a_missing_visual_is_left_out_by_name(tmp_path: Path):
    lay(tmp_path, {"arm.urdf": arm("a.obj", "none.obj"), "a.obj": OBJ})
    source, findings = built(tmp_path, "arm.urdf")
    assert source["missing"] == {"visuals": ["none.obj"]}
    found = said(findings, "urdf.visual.missing")
    assert (found.severity, found.subject) == ("warning", "link a")


def test_a_missing_collision_mesh_is_refused(tmp_path: Path):
    lay(tmp_path, {"arm.urdf": arm("a.obj", "none.obj", role="collision"), "a.obj": OBJ})
    with pytest.raises(SourceError, match=r"no file `none\.obj`"):
        proposed(tmp_path, "arm.urdf")


def test_a_robot_of_which_no_mesh_is_there_is_refused(tmp_path: Path):
    lay(tmp_path, {"arm.urdf": arm("none.obj")})
    with pytest.raises(SourceError, match=r"no file `none\.obj`"):
        proposed(tmp_path, "arm.urdf")


@pytest.mark.parametrize("name", ["file://meshes/cad/a.obj", "file://a.obj"])
def test_two_slashes_start_from_the_urdf(tmp_path: Path, name: str):
    lay(tmp_path, {"arm.urdf": arm(name), name.removeprefix("file://"): OBJ})
    source = proposed(tmp_path, "arm.urdf")
    assert not {"absolute", "patches", "missing"} & source.keys()


def test_names_of_no_package_start_from_the_urdf(tmp_path: Path):
    """As Onshape's exporters write them."""
    names = ("package:///a.obj", "package:///b.obj")
    lay(tmp_path, {"arm/arm.urdf": arm(*names), "arm/a.obj": OBJ, "arm/b.obj": OTHER})
    patches = proposed(tmp_path, "arm/arm.urdf")["patches"]
    assert [patch["replace"] for patch in patches] == ['"a.obj"', '"b.obj"']


@pytest.mark.parametrize("name", ["meshes/A.OBJ", "Meshes/a.obj", "meshes\\a.obj"])
def test_a_name_that_only_windows_would_find_is_patched(tmp_path: Path, name: str):
    lay(tmp_path, {"arm.urdf": arm(name, name), "meshes/a.obj": OBJ})
    source, findings = built(tmp_path, "arm.urdf")
    (patch,) = source["patches"]
    assert patch["find"] == f'"{name}"'
    assert patch["replace"] == '"meshes/a.obj"'
    assert patch["times"] == 2
    assert said(findings, "source.patch").data["file"] == "arm.urdf"


# --- percent-encoded names, `$(find ...)`, and what is not there --------------------------------

PACKAGE = "<package><name>rob</name></package>"
FOUND = {
    "encoded": ("package://rob/mesh%20dir/Part%20A.obj", "rob/mesh dir/Part A.obj"),
    "encoded and relative": ("../K%C3%B6rper.obj", "rob/K\u00f6rper.obj"),
    "find": ("file://$(find rob)/meshes/a.obj", "rob/meshes/a.obj"),
    "find without a scheme": ("$(find rob)/meshes/a.obj", "rob/meshes/a.obj"),
    "find of a neighbour": ("file://$( find  looks )/a.obj", "looks/a.obj"),
}


@pytest.mark.parametrize("role", ["visual", "collision"])
def test_names_of_the_web_and_of_ros_are_found_and_said(role: str, tmp_path: Path):
    uris = [uri for uri, _ in FOUND.values()]
    files = {"rob/package.xml": PACKAGE, "rob/urdf/arm.urdf": arm(*uris, role=role)}
    files |= {path: OBJ for _, path in FOUND.values()}
    looks = "<package><name>looks</name></package>"
    source, found = built(lay(tmp_path, files | {"looks/package.xml": looks}), "rob/urdf/arm.urdf")
    assert "missing" not in source
    assert {patch["find"][1:-1] for patch in source["patches"]} == set(uris)
    assert said(found, "source.patch").severity == "info"


LACKING = {
    "a folder": (
        "package://rob/mesh%20dir/a.obj",
        ("package `rob` is `", "which holds no folder `mesh%20dir`"),
    ),
    "a file": ("package://rob/meshes/a.obj", ("which holds no file `a.obj` in `meshes`",)),
    "a file of a sister folder": (
        "package://rob/meshes/collision/b.obj",
        ("no folder `collision` in `meshes`", "is `meshes/visual/b.obj` meant?"),
    ),
    "a package": ("package://bob/meshes/a.obj", ("no folder above", "the package `bob`")),
    "a package to find": ("$(find bob)/a.obj", ("holds the package `bob`",)),
}  # fmt: skip


@pytest.mark.parametrize("what", LACKING)
def test_what_is_there_and_what_is_not_is_said(what: str, tmp_path: Path):
    uri, words = LACKING[what]
    files = {"rob/package.xml": PACKAGE, "rob/arm.urdf": arm(uri, role="collision")}
    folder = lay(tmp_path, files | {"rob/meshes/visual/b.obj": OBJ})
    with pytest.raises(SourceError) as caught:
        proposed(folder, "rob/arm.urdf")
    for one in words:
        assert one in str(caught.value)


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


def test_a_build_without_init_says_how_the_file_is_called(tmp_path: Path):
    folder = lay(tmp_path, {"rob/arm.urdf": arm("my%20a.obj"), "rob/my a.obj": OBJ})
    proposed(folder, "rob/arm.urdf")
    recipe = folder / "arm.yaml"
    lines = recipe.read_text().splitlines(keepends=True)
    kept = [line for line in lines if "patches:" not in line and "my%20a" not in line]
    recipe.write_text("".join(kept))
    with pytest.raises(SourceError, match=r"did you mean `my a\.obj`"):
        check(recipe)
