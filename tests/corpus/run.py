"""Every robot of example-robot-data through `init` and `build`, as a Markdown table.

    python tests/corpus/run.py -o table.md [--only NAME ...] [--jobs N]

The data: `--data FOLDER` or $ASSETBUILD_TEST_DATA (a folder that holds
`example-robot-data/robots`), else the wheel is fetched once with pip.
Results are kept in `<table>.json` as they come, so that an interrupted run goes on where it
stopped; `--again` forgets them.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import zipfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock
from xml.etree.ElementTree import Element, ParseError

from defusedxml.ElementTree import parse

from corpus.xacros import Given, given, xacros

PACKAGE = "example-robot-data==6.0.0"
ROOT_IN_WHEEL = "cmeel.prefix/share/example-robot-data"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=Path("corpus.md"))
    parser.add_argument("--only", nargs="+", metavar="NAME", help="parts of the robots' paths")
    parser.add_argument("--jobs", type=int, default=1, help="robots at a time")
    parser.add_argument("--data", type=Path)
    parser.add_argument("--again", action="store_true", help="forget earlier results")
    parser.add_argument("--work", type=Path, help="keep recipes and bundles here")
    options = parser.parse_args()
    root = data_root(options.data)
    names = corpus(root) + xacros()
    if options.only:
        names = [name for name in names if any(part in name for part in options.only)]
    state = options.out.with_suffix(".json")
    rows = {} if options.again or not state.is_file() else json.loads(state.read_text())
    writing = Lock()
    with tempfile.TemporaryDirectory(prefix="corpus-") as scratch:
        work = options.work or Path(scratch)

        def do(name: str) -> None:
            row = one(root, name, work)
            print(f"{name}: {row['result']} ({row['seconds']:.0f} s)", flush=True)
            with writing:
                rows[name] = row
                state.write_text(json.dumps(rows, indent=1, sort_keys=True))
                options.out.write_text(table(rows))

        left = [name for name in names if name not in rows or options.only]
        with ThreadPoolExecutor(options.jobs) as pool:
            list(pool.map(do, left))
    options.out.write_text(table(rows))
    print(summary(rows))
    return 0


def data_root(stated: Path | None) -> Path:
    """The folder `example-robot-data`."""
    named = stated or os.environ.get("ASSETBUILD_TEST_DATA")
    if named:
        return Path(named) / "example-robot-data"
    folder = Path.home() / ".cache/assetbuild/test-data/whole"
    root = folder / ROOT_IN_WHEEL
    if not root.is_dir():
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest"]
        subprocess.run([*pip, str(folder), PACKAGE], check=True)
        (wheel,) = folder.glob("*.whl")
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder)
        wheel.unlink()
    return root


def corpus(root: Path) -> list[str]:
    """Paths of all URDFs below `robots`, sorted."""
    robots = root / "robots"
    return sorted(path.relative_to(robots).as_posix() for path in robots.rglob("*.urdf"))


# --- one robot ------------------------------------------------------------------------------


def one(root: Path, name: str, work: Path) -> dict[str, object]:
    """Init and build; everything that the table says about it."""
    folder = work / re.sub(r"[^A-Za-z0-9_]", "_", name.removesuffix(".urdf"))
    folder.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    row: dict[str, object] = {"result": "refused", "note": "", "seconds": 0.0}
    got = given(name, root, folder) if name in xacros() else Given(root / "robots" / name, {})
    row |= counts_in(as_urdf(got, folder), root)
    done = run("init", str(got.file), *got.words, "-o", str(folder / "recipe.yaml"), "--force")
    if done.returncode == 0:
        done = run("build", str(folder / "recipe.yaml"), "-o", str(folder / "bundle"))
        row |= judged(folder, done.returncode)
    row["seconds"] = round(time.monotonic() - started, 1)
    if row["result"] in ("refused", "crashed"):
        if "Traceback" in done.stderr:
            row["result"] = "crashed"
        row["note"] = error_of(done.stderr + done.stdout).replace(str(root), "")
    return row


def run(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "assetbuild", *words]
    return subprocess.run(command, capture_output=True, text=True)


def error_of(text: str) -> str:
    """The first error line."""
    lines = [line for line in text.splitlines() if "error" in line.lower()] or text.splitlines()
    return lines[0].removeprefix("error: ")[:200] if lines else ""


def as_urdf(got: Given, folder: Path) -> Path:
    """The description itself, of a xacro what it expands to."""
    if got.file.suffix == ".urdf":
        return got.file
    from assetbuild.init.source import find_source

    expanded = folder / "expanded.urdf"
    expanded.write_bytes(find_source(got.file, {}, got.args).data)
    return expanded


def counts_in(urdf: Path, root: Path) -> dict[str, object]:
    """Shapes, textures and mass that the source states, read by another library than ours."""
    try:
        robot = parse(urdf).getroot()
    except ParseError:
        return {}
    masses = [float(m.get("value") or 0) for m in robot.iterfind("link/inertial/mass")]
    return {
        "visual_in": len(robot.findall("link/visual")),
        "collision_in": len(robot.findall("link/collision")),
        "mass_source": sum(masses),
        "textures_in": len(pictures_of(robot, urdf, root)),
    }


def pictures_of(robot: Element, urdf: Path, root: Path) -> set[Path]:
    """Pictures of what is seen: the files that the visual meshes name, as far as they exist."""
    found: set[Path] = set()
    for mesh in robot.iterfind("link/visual/geometry/mesh"):
        uri = mesh.get("filename", "")
        inside = re.sub(r"^package:/+[^/]+/", "", uri)
        path = urdf.parent / uri if inside == uri else root / inside
        if path.is_file():
            found |= {picture.resolve() for picture in named_by(path) if picture.is_file()}
    return found


def named_by(mesh: Path) -> list[Path]:
    """Pictures that a COLLADA file or an OBJ's material library names."""
    if mesh.suffix.lower() == ".dae":
        images = [e for e in parse(mesh).getroot().iter() if e.tag.endswith("}image")]
        names = [e.text for image in images for e in image.iter() if e.tag.endswith("}init_from")]
        return [mesh.parent / name.strip() for name in names if name]
    if mesh.suffix.lower() == ".obj":
        text = mesh.read_text(errors="replace")
        libraries = [mesh.parent / n for n in re.findall(r"(?m)^mtllib (.+?)\s*$", text)]
        return [
            library.parent / name
            for library in libraries
            if library.is_file()
            for name in re.findall(r"(?m)^\s*map_Kd (.+?)\s*$", library.read_text())
        ]
    return []


def judged(folder: Path, code: int) -> dict[str, object]:
    """What the bundle's report says; a bundle in `bundle.failed` is not ready."""
    bundle = folder / ("bundle" if code == 0 else "bundle.failed")
    report = bundle / "report/report.json"
    if not report.is_file():
        return {}
    said = json.loads(report.read_text())
    findings = said["findings"]
    errors = [f for f in findings if f["severity"] == "error"]
    row: dict[str, object] = {
        "result": "built" if code == 0 else "not ready",
        "findings": dict(Counter(f["severity"] for f in findings)),
    }
    if errors:
        first = errors[0]
        rules = ", ".join(sorted({e["rule"] for e in errors}))
        row["note"] = f"{len(errors)} errors ({rules}): {first['subject']}: {first['message']}"[
            :240
        ]
        row["where"] = first["where"]
    row["figures"] = said["checks"].get("oracle", {}).get("figures", {})
    equal = said["checks"].get("mjcf_equal", {}).get("figures", {})
    row["inertia_error"] = equal.get("worst_relative_error", {}).get("inertia")
    row["edits"] = dict(Counter(f["rule"][5:] for f in findings if f["rule"].startswith("edit.")))
    row["lost"] = sorted({f["subject"] for f in findings if f["rule"].startswith("count.")})
    return row | counts_out(bundle)


def counts_out(bundle: Path) -> dict[str, object]:
    """Shapes and mass of the MJCF, as MuJoCo compiles it."""
    import mujoco

    (path,) = [p for p in (bundle / "mjcf").glob("*.xml") if p.name != "scene.xml"]
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        return {"note": f"MuJoCo: {error}"[:200]}
    groups = Counter(model.geom_group.tolist())
    return {
        "visual_out": groups[2],
        "collision_out": groups[3],
        "textures_out": sum(1 for kind in model.tex_type if kind == mujoco.mjtTexture.mjTEXTURE_2D),
        "mass_mjcf": float(model.body_mass.sum()),
    }


# --- the table ------------------------------------------------------------------------------


def table(rows: dict[str, dict]) -> str:
    head = (
        "| robot | result | edits | mass kg | mass err | inertia | kinematics | mass matrix "
        "| gravity | visual | collision | textures | lost | s | E/W/I | note |"
    )
    lines = [f"# Corpus: {PACKAGE}", "", summary(rows), "", head, "|" + " --- |" * 16]
    lines += [line_of(name, rows[name]) for name in sorted(rows)]
    lines += [
        "",
        "Errors are relative. Kinematics, mass matrix, gravity: MJCF against pinocchio on the",
        "source, of edited robots on the URDF that was written (50 poses). Inertia: MJCF against",
        "the robot, worst link. Shapes: in → out. Edits: what `init` wrote, counted by link.",
    ]
    return "\n".join(lines) + "\n"


def line_of(name: str, row: dict) -> str:
    figures, findings = row.get("figures", {}), row.get("findings", {})
    cells = [
        name.removesuffix(".urdf"),
        row["result"],
        ", ".join(f"{count} {name}" for name, count in row.get("edits", {}).items()),
        f"{row.get('mass_source', 0):.4g}",
        number(mass_error(row)),
        number(row.get("inertia_error")),
        *(
            number(figures.get(f"{kind}_error"))
            for kind in ("kinematics", "mass_matrix", "gravity")
        ),
        f"{row.get('visual_in', '-')} → {row.get('visual_out', '-')}",
        f"{row.get('collision_in', '-')} → {row.get('collision_out', '-')}",
        f"{row.get('textures_in', '-')} → {row.get('textures_out', '-')}",
        ", ".join(row["lost"]) or "none" if "lost" in row else "-",
        f"{row['seconds']:.0f}",
        "/".join(str(findings.get(s, 0)) for s in ("error", "warning", "info")),
        str(row["note"]).replace("|", "\\|").replace("\n", " "),
    ]
    return "| " + " | ".join(cells) + " |"


def mass_error(row: dict) -> float | None:
    if not row.get("mass_source") or "mass_mjcf" not in row:
        return None
    return abs(row["mass_mjcf"] - row["mass_source"]) / row["mass_source"]


def number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1e}" if value else "0"


def summary(rows: dict[str, dict]) -> str:
    results = Counter(row["result"] for row in rows.values())
    worst = {
        kind: max(
            (row.get("figures", {}).get(f"{kind}_error", 0.0) for row in rows.values()), default=0
        )
        for kind in ("kinematics", "mass_matrix", "gravity")
    }
    alike = [row for row in rows.values() if not row.get("edits")]
    masses = [e for e in map(mass_error, alike) if e is not None]
    inertias = [row["inertia_error"] for row in rows.values() if row.get("inertia_error")]
    told = ", ".join(f"{count} {result}" for result, count in sorted(results.items()))
    errors = ", ".join(f"{kind.replace('_', ' ')} {value:.1e}" for kind, value in worst.items())
    seconds = sum(row["seconds"] for row in rows.values())
    mass = f"{max(masses):.1e}" if masses else "-"
    return (
        f"{len(rows)} robots: {told}. {len(rows) - len(alike)} edited. "
        f"Worst errors: mass {mass} (not edited), "
        f"inertia {max(inertias, default=0):.1e}, {errors}. "
        f"{seconds:.0f} s in all. "
        f"{shapes_summary(rows)}"
    )


def shapes_summary(rows: dict[str, dict]) -> str:
    """Sums over the robots that have an MJCF, and who lost a shape or a texture."""
    there = {name: row for name, row in rows.items() if "visual_out" in row}
    sums = {
        key: sum(row.get(key, 0) for row in there.values())
        for kind in ("visual", "collision", "textures")
        for key in (f"{kind}_in", f"{kind}_out")
    }
    losers = [
        name
        for name, row in there.items()
        if row.get("lost")
        or row["visual_out"] < row["visual_in"]
        or row.get("textures_out", 0) != row.get("textures_in", 0)
    ]
    counts = ", ".join(
        f"{kind} {sums[f'{kind}_in']} → {sums[f'{kind}_out']}"
        for kind in ("visual", "collision", "textures")
    )
    return f"Shapes: {counts}. Lost a shape or texture: {', '.join(losers) or 'none'}."


if __name__ == "__main__":
    sys.exit(main())
