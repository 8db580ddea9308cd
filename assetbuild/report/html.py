"""`report/index.html`: one self-contained page, readable in a minute.

Its markup stands in `assets/`, beside style and scripts; here is what the templates print.
"""

from __future__ import annotations

import base64
import functools
import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from assetbuild._version import __version__
from assetbuild.findings import SEVERITIES, Finding, is_consequence, is_waived
from assetbuild.grouping import grouped
from assetbuild.report.card import Subject, card_tables
from assetbuild.report.document import Report
from assetbuild.report.figures import figures_of, sentence
from assetbuild.report.tables import Table, table, text_of
from assetbuild.report.verdict import CheckResult, verdict_rows
from assetbuild.robot.identify import Fit
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Body, Joint
from assetbuild.robot.pose import Pose
from assetbuild.robot.tree import unit_of

if TYPE_CHECKING:
    from jinja2 import Environment


ASSETS = Path(__file__).parent / "assets"
GROUPS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("equality", "The same robot in every format",
     ("oracle", "urdf_", "bare_", "dr_", "isaaclab_", "mjcf_", "mjlab_", "mjx_", "scene_", "usd_",
      "xrdf_", "counts")),
    ("alignment", "Simulators agree", ("alignment", "physx", "newton", "free_fall")),
    ("gains", "Drives and their effect", ("gains", "stand", "slope", "grip", "trials",
      "full_effort")),
    ("collision", "Collision quality", ("coverage", "collision")),
)  # fmt: skip
"""Anchor, title and the beginnings of the checks' names; all others come last."""


@dataclass(frozen=True)
class View:
    """The 3D view: geometry as JSON, and the text of three.js; empty = none."""

    geometry: str
    library: str


def html_page(report: Report, subject: Subject, hero: bytes | None, view: View | None) -> str:
    """The whole page; nothing in it is fetched from anywhere. hero: a PNG of the robot."""
    targets = subject.recipe.targets
    return templates().get_template("page.html").render(
        report=report,
        verdict=report.verdict,
        name=subject.recipe.robot,
        hero=base64.b64encode(hero).decode("ascii") if hero else "",
        rows=verdict_rows(report.verdict),
        loading=[] if report.has_errors else list(loading_lines(subject.recipe.robot, targets)),
        missing=[target for target in ("mjlab", "isaaclab") if target not in targets],
        tiles=_tiles(report, subject),
        loud=sum(finding.severity != "info" for finding in report.findings),
        findings=_sorted_out(report.findings),
        view=view if view and view.library else None,
        robot=Markup(view_data(subject).replace("<", "\\u003c")),  # noqa: S704 # ends no script
        groups=_grouped(report.checks),
        fits=[(fit, list(fit_tables(fit))) for fit in subject.fits],
        tables=card_tables(subject, report),
        built=_provenance(subject),
    )  # fmt: skip


@functools.cache
def templates() -> Environment:
    """The templates with what they may call."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # for a page alone

    made = Environment(
        loader=FileSystemLoader(ASSETS), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, auto_reload=False,
    )  # fmt: skip
    made.filters |= {"text": text_of, "prose": prose, "one_line": _one_line}
    made.filters["count_all"] = lambda boxes: sum(len(findings) for _, _, findings in boxes)
    made.filters |= {"counted": lambda number, noun: f"{number} {noun}{'s' * (number != 1)}"}
    made.tests["waived"] = is_waived
    made.globals |= {"asset": _asset, "sentence": sentence, "figures_of": figures_of}
    return made


def prose(text: str) -> Markup:
    """A sentence whose backticks become code."""
    marked = re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text)))
    return Markup(marked)  # noqa: S704 # escaped above


def _asset(name: str) -> Markup:
    """A file that comes with the report."""
    return Markup((ASSETS / name).read_text(encoding="utf-8"))  # noqa: S704 # our own


def _one_line(markup: Markup) -> Markup:
    return Markup("").join(Markup(line.strip()) for line in markup.splitlines())  # noqa: S704 # as it was


Box = tuple[str, str, list[Finding]]
"""(severity, rule, its findings)."""


def _sorted_out(findings: Sequence[Finding]) -> dict[str, list[Box]]:
    """Findings in groups: open ones, their consequences, waived ones, and notes."""
    loud = [f for f in findings if f.severity != "info"]
    quiet = [f for f in findings if f.severity == "info"]
    return {
        "loud": _by_rule(f for f in loud if not is_consequence(f)),
        "following": _by_rule(filter(is_consequence, loud)),
        "waived": _by_rule(f for f in quiet if is_waived(f)),
        "quiet": _by_rule(f for f in quiet if not is_waived(f)),
    }


def _by_rule(findings: Iterable[Finding]) -> list[Box]:
    """One box for each rule, in order of the worst."""
    boxes = grouped(findings, lambda finding: (finding.severity, finding.rule))
    return [(severity, rule, same) for (severity, rule), same in boxes.items()]


def _tiles(report: Report, subject: Subject) -> tuple[tuple[str, str], ...]:
    states = [check.status for check in report.checks.values()]
    severities = [finding.severity for finding in report.findings]
    plural = {"error": "errors", "warning": "warnings", "info": "notes"}
    numbers = [(severities.count(severity), severity) for severity in SEVERITIES]
    counts = ", ".join(f"{n} {plural[s][: -1 if n == 1 else None]}" for n, s in numbers if n)
    return (
        (f"{total_mass(subject.tree):.4g} kg", "total mass"),
        (str(len(subject.tree.moving_joints)), "moving joints"),
        (str(len(subject.tree.bodies)), "bodies"),
        (str(len(subject.shapes.of("collision"))), "collision shapes"),
        (f"{states.count('pass')} of {len(states)}", "checks passed"),
        (counts or "none", "findings"),
    )


def _grouped(checks: Mapping[str, CheckResult]) -> list[tuple[str, str, list[object]]]:
    """(anchor, title, [(name, check)]) by what they are about."""
    left = dict(sorted(checks.items()))
    groups: list[tuple[str, str, list[object]]] = []
    for key, title, beginnings in GROUPS:
        names = [name for start in beginnings for name in left if name.startswith(start)]
        groups.append((key, title, [(name, left.pop(name)) for name in dict.fromkeys(names)]))
    return [*groups, ("checks", "Other checks", list(left.items()))]


def _provenance(subject: Subject) -> list[tuple[str, object]]:
    source = subject.recipe.source
    return [
        ("built by", f"assetbuild {__version__}"),
        ("source", source.origin),
        *sorted(subject.pin.items()),
        ("licence of the source", source.license or "not stated"),
    ]


# --- the lines that load a bundle, to copy --------------------------------------------------


def loading_lines(robot: str, targets: Collection[str]) -> Iterator[tuple[str, str]]:
    """(consumer, lines) for what the bundle holds; paths as seen from where the build ran."""
    bundle = f"build/{robot}"
    module = re.sub(r"\W", "_", robot)
    module = f"_{module}" if module[:1].isdigit() else module
    if "mjcf" in targets:
        yield (
            "MuJoCo",
            f'import mujoco\n\nmodel = mujoco.MjModel.from_xml_path("{bundle}/mjcf/scene.xml")',
        )
    path = f'import sys\n\nsys.path.insert(0, "{bundle}/python")\n'
    if "mjlab" in targets:
        yield "mjlab", f"{path}from {module}_mjlab import robot_cfg"
    if "isaaclab" in targets:
        upper = module.upper()
        yield (
            "Isaac Lab",
            f"{path}from {module}_isaaclab_2 import {upper}_CFG  # Isaac Lab 3: _isaaclab_3\n\n"
            f'robot = {upper}_CFG.replace(prim_path="{{ENV_REGEX_NS}}/Robot")',
        )
    elif "usd" in targets:
        yield (
            "Isaac Lab",
            "import isaaclab.sim as sim_utils\n\n"
            f'spawn = sim_utils.UsdFileCfg(usd_path="{bundle}/usd/{robot}.usda")',
        )
    if "urdf" in targets:
        yield (
            "ROS 2",
            f"ros2 run robot_state_publisher robot_state_publisher {bundle}/urdf/{robot}.urdf",
        )


# --- what was measured ----------------------------------------------------------------------


def fit_tables(fit: Fit) -> Iterator[Table]:
    """What the logs of the real robot showed."""
    yield table(
        "Parameters",
        ("parameter", "value", "low", "high", "prior", "unit", "verdict"),
        [
            (p.label, None if p.refused else p.value, p.low, p.high, p.prior, p.unit,
             p.refused or "identified")
            for p in fit.parameters
        ],
        "low, high: 95 % interval from the fitted part",
    )  # fmt: skip
    yield table(
        "Residuals",
        ("joint", "fitted part", "held out, priors", "held out, identified"),
        [(p.joint, p.fitted, p.before, p.after) for p in fit.predictions],
        "RMS of measured minus simulated position, rad or m",
    )
    yield table(
        "Logs",
        ("log", "fitted, s", "held out, s", "samples, Hz", "sha256"),
        [(log.file, log.seconds, log.held_s, log.rate_hz, log.sha256) for log in fit.logs],
        f"condition of the scaled Fisher information: {fit.condition:.4g}",
    )
    if fit.related:
        yield table(
            "Correlated parameters",
            ("of", "and", "correlation"),
            [(r.a, r.b, r.correlation) for r in fit.related],
            "parameters whose estimates depend on one another; above 0.99 both are refused",
        )


# --- what the 3D view knows beside its geometry: joints, poses, numbers ---------------------


def view_data(subject: Subject) -> str:
    """JSON for `viewer.js`. m, rad, quaternions wxyz; poses of joints are in the parent body."""
    tree, start = subject.tree, initial_pose(subject.tree, subject.control)
    others = [key for key in subject.control.keyframes if key.name != start.name]
    poses: list[object] = [
        {"name": k.name or "initial", "joints": dict(k.joints), **_plain_pose(tree.root_pose(k))}
        for k in (start, *others)
        if k.name or any(value for _, value in k.joints)
    ]
    poses.append({"name": "all joints 0", "joints": {}, **_plain_pose(tree.root_pose(start))})
    content = {
        "robot": subject.recipe.robot,
        "floating": tree.base == "floating",
        "root": tree.root,
        "size": subject.measured.size_m,
        "bodies": [_body(body, subject) for body in tree.bodies],
        "joints": [_joint(joint) for joint in tree.joints],
        "poses": poses,
    }
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


def _plain_pose(pose: Pose) -> dict[str, object]:
    return {"xyz": list(pose.xyz), "quat": list(pose.quat)}


def _joint(joint: Joint) -> dict[str, object]:
    lower, upper = joint.shown_range
    has_axis = joint.kind in ("revolute", "continuous", "prismatic")
    mimic = joint.mimic
    return {
        "name": joint.name,
        "kind": joint.kind,
        "parent": joint.parent,
        "child": joint.child,
        "axis": list(joint.axis) if has_axis else None,
        "lower": lower,
        "upper": upper,
        "unit": unit_of(joint),
        "mimic": mimic and asdict(mimic),
        **_plain_pose(joint.X_parent_joint),
    }


def _body(body: Body, subject: Subject) -> dict[str, object]:
    row: dict[str, object] = {"name": body.name, "facts": list(_facts(body, subject))}
    if body.inertial is None:
        return row
    row["com"] = list(body.inertial.com_m)
    measured = subject.measured.by_body[body.name]
    if measured.semi_axes_m is not None:
        row["ellipsoid"] = {"axes": list(measured.semi_axes_m), "quat": list(measured.axes)}
    return row


def _facts(body: Body, subject: Subject) -> Iterator[tuple[str, str]]:
    tree = subject.tree
    yield "link", body.name
    if body.inertial is not None:
        yield "mass", f"{body.inertial.mass_kg:.6g} kg"
        yield "centre of mass", f"{text_of(body.inertial.com_m)} m"
        moments = subject.measured.by_body[body.name].moments_kg_m2
        yield "principal moments", f"{text_of(moments)} kg m²"
    merged = [frame.name for frame in tree.frames if frame.body == body.name]
    if merged:
        yield "holds", ", ".join(merged)
    joint = tree.joint_above.get(body.name)
    if joint is not None:
        yield "joint", f"{joint.name}, {joint.kind}, axis {text_of(joint.axis)}"
        yield "limits", f"{text_of(joint.limits.lower)} to {text_of(joint.limits.upper)}"
        drive = subject.control.by_joint.get(joint.name)
        if drive is not None:
            yield "drive", f"{drive.model}, kp {drive.kp:g}, kd {drive.kd:g}"
            yield "effort", text_of(drive.effort)
            yield "armature", f"{drive.armature:.4g} kg m²"
    links = {body.name, *merged}
    pieces = [s for s in subject.shapes.of("collision") if s.link in links]
    kinds = sorted({type(shape.geometry).__name__.lower() for shape in pieces})
    yield "collision", f"{len(pieces)} pieces" + (f": {', '.join(kinds)}" if kinds else "")
