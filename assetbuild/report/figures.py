"""What a check found: a sentence with its numbers and limits, and all of its figures as tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeGuard

from assetbuild.errors import counted
from assetbuild.report.tables import Record, Table, table, text_of
from assetbuild.report.verdict import CheckResult

Figures = Mapping[str, Any]  # Any: plain JSON, of as many shapes as there are checks
FILES = {
    "urdf": "URDF", "mjcf": "MJCF", "mjx": "MJX model", "bare": "bare MJCF", "scene": "scene",
    "scene_mjx": "MJX scene", "usd": "USD", "usd_scene": "USD scene",
    "mjlab": "mjlab module", "isaaclab": "Isaac Lab module", "xrdf": "XRDF",
}  # fmt: skip


def sentence(name: str, check: CheckResult) -> str:
    """One sentence; figures that no sentence is written for stand as `name value unit`."""
    figures = check.figures
    if check.note or "skipped" in figures:
        did = "does not apply" if check.status == "pass" else "not run"
        return f"{did}: {check.note or figures['skipped']}"
    stem = name.removesuffix("_equal")
    if stem != name and stem in FILES and "facts" in figures:
        return _equal(FILES[stem], figures)
    write = SENTENCES.get(name.removeprefix("physx_").removeprefix("newton_"))
    try:
        made = write(figures) if write else ""
    except (KeyError, TypeError, ValueError):  # a check that stopped early has fewer figures
        made = ""
    return made or str(figures.get("summary") or "") or _plain(figures)


def _equal(file: str, figures: Figures) -> str:
    facts, differ = (int(figures.get(key) or 0) for key in ("facts", "differ"))
    if not facts:
        return f"the {file} could not be read"
    result = "match the robot" if not differ else f"compared with the robot: {differ} differ"
    return f"{facts:,} values of the {file} {result}"


def _plain(figures: Figures) -> str:
    shown = [(k, v) for k, v in figures.items() if not isinstance(v, Mapping | list | None)]
    return ", ".join(_quantity(key, value) for key, value in shown[:3])


UNITS = {
    "m": "m", "rad": "rad", "kg": "kg", "s": "s", "hz": "Hz", "mm": "mm", "deg": "°",
    "nm": "N m", "n": "N", "j": "J", "m3": "m³",
}  # fmt: skip


def _quantity(key: str, value: object) -> str:
    name, _, unit = words(key).partition(", ")
    return f"{name} {text_of(value)} {unit}".rstrip()


def _length(value_m: float) -> str:
    """A length as people say it: millimetres below 0.1 m."""
    return f"{1e3 * value_m:.3g} mm" if abs(value_m) < 0.1 else f"{value_m:.3g} m"


def _error(value: float) -> str:
    """A relative error; what rounding leaves is called that."""
    return "0" if value == 0.0 else f"{value:.1e}"


def _oracle(f: Figures) -> str:
    worst = max(float(f[key]) for key in f if key.endswith("_error"))
    return (
        f"kinematics, mass matrix and gravity equal pinocchio's on the source in {f['poses']} "
        f"poses: largest relative error {_error(worst)}, limit 1e-9"
    )


def _full_effort(f: Figures) -> str:
    parts = []
    for kind, what in (("limits", "past a limit"), ("couplings", "from where it is held")):
        held = f["mjcf"].get(kind, {})  # none, where the MJCF does not load
        for motion, unit in (("turn", "rad"), ("slide", "m")):
            error = held[motion]["error"] if motion in held else None
            if error is not None:
                parts.append(f"`{held[motion]['joint']}` {error:.2g} {unit} {what}")
    return f"full effort pushes at most {', '.join(parts)}" if parts else "nothing to push"


def _grip(f: Figures) -> str:
    parts = []
    for file, hands in f.items():
        rows = [row for hand in hands.values() if isinstance(hand, list) for row in hand]
        held = [row for row in rows if row["held"]]
        worst = max((float(row["slip_m"]) for row in held), default=0.0)
        parts.append(f"{file}: holds {len(held)} of {len(rows)} objects, slip {_length(worst)}")
    return "; ".join(parts)


def _slope(f: Figures) -> str:
    parts = [
        f"{file}: creeps at {1e3 * float(row['speed_m_s']):.2g} mm/s below the angle of friction"
        if "speed_m_s" in row
        else f"{file}: {row['skipped']}"
        for file, row in f.items()
    ]
    return "; ".join(parts)


def _mass(f: Figures) -> str:
    stated = f.get("datasheet_kg")
    beside = f"; its data sheet says {float(stated):.4g} kg" if stated is not None else ""
    return f"{float(f['total_kg']):.4g} kg in {counted(len(f['bodies']), 'body', 'bodies')}{beside}"


def _loops(f: Figures) -> str:
    return (
        f"{len(f['open'])} loops stay closed while the drives swing for {float(f['seconds']):.3g} "
        f"s: the largest gap is {_length(float(f['largest_gap']))}"
    )


SENTENCES: Mapping[str, Callable[[Figures], str]] = {
    "oracle": _oracle,
    "urdf_kinematics": lambda f: (
        f"{f['links']} links stand where yourdfpy puts them in {f['samples']} poses: "
        f"largest error {_error(float(f['kinematics_error']))}, limit 1e-9"
    ),
    "urdf_loads": lambda f: f"urdfdom reads the URDF: {f['joints']} joints",
    "free_fall": lambda f: (
        f"free fall {float(f['drop_m']):.4g} m in {float(f['seconds']):.3g} s (expected "
        f"{float(f['expected_m']):.4g} m; {100.0 * float(f['relative_error']):.2g} % off, "
        "limit 0.3 %)"
    ),
    "full_effort": _full_effort,
    "grip": _grip,
    "slope": _slope,
    "stand": lambda f: (
        f"stands for {float(f['seconds']):.3g} s: its base moves by "
        f"{_length(abs(float(f['height_change_m'])))} in height and {_length(float(f['drift_m']))} "
        f"sideways and tilts by {math.degrees(float(f['tilt_rad'])):.2g}°; "
        f"the busiest drive uses {100 * float(f['max_load']):.3g} % of its effort"
    ),
    "mass": _mass,
    "counts": lambda f: (
        f"{f['visual_built']} visual and {f['collision_built']} collision shapes were built from "
        f"{f['visual_source']} and {f['collision_source']} of the source"
    ),
    "mirror": lambda f: (
        f"{f['twins'] or 'no'} pairs of bodies or joints are each other's mirror image"
    ),
    "gains": lambda f: (
        f"stiffness, damping and sag of {len(f['joints'])} drives at `{f['keyframe']}`"
    ),
    "coverage": lambda f: (
        f"collision and visual geometry of {counted(len(f['bodies']), 'body', 'bodies')} compared"
    ),
    "usd_valid": lambda f: f"OpenUSD's validators read {float(f['bytes']) / 1e6:.3g} MB of USD",
    "trials": lambda f: (
        "released, shaken and simulated with other time steps: the energy drifts by "
        f"{100.0 * float(f['energy_drift']):.2g} %"
    ),
    "mjcf_compiles": lambda f: (
        f"{', '.join(f'`{name}`' for name in f)} compile in MuJoCo without a warning" if f else ""
    ),
    "mjx_pairs": lambda f: (
        f"{f['pairs']} pairs of shapes can touch, {f['fast_on_warp']} of them fast on MuJoCo Warp"
    ),
    "loops": _loops,
    "mjlab_contract": lambda f: (
        f"mjlab finds the module's names among {f['sites']} sites and {f['sensors']} sensors"
    ),
    "mjcf_source": lambda f: f"{f['facts']:,} values compared with the source's MJCF",
    "simready": lambda f: f"{f['met']} of {f['of']} features of {f['profile']} are met",
    "asset_validator": lambda f: f"{f['failures']} rules fail, {f['warnings']} warnings",
}
"""Check, in any simulator -> its sentence, from figures that it always has when it ran."""


FIRST = (
    *("", "rank", "row", "of", "name", "robot", "link", "body", "joint", "pair", "a", "b"),
    *("mujoco", "physx", "off", "unit"),
)
"""Columns that stand first in a table, in this order."""


def figures_of(name: str, check: CheckResult) -> Iterator[Table]:
    """All figures of a check: first its plain numbers, then a table or several for each other."""
    figures = dict(sorted(check.figures.items()))
    plain = {k: v for k, v in figures.items() if not (isinstance(v, Mapping) or _is_list(v))}
    if rows := [(words(key), value) for key, value in plain.items() if value is not None]:
        yield table(f"figures of {name}", ("figure", "value"), rows)
    for key, value in figures.items():
        if key not in plain and value not in ([], {}):
            yield from tables_of(key, value)


def tables_of(name: str, value: object) -> Iterator[Table]:
    """Rows of mappings, a mapping of mappings, a mapping of numbers, a plain list: as tables."""
    title = words(name)
    if isinstance(value, Mapping) and value:
        if all(isinstance(v, Mapping) for v in value.values()):
            yield _of_rows(title, [{"name": key, **row} for key, row in value.items()])
        elif any(isinstance(v, Mapping) or _is_rows(v) for v in value.values()):
            for key, inner in value.items():
                yield from tables_of(f"{name}: {key}", inner)
        else:
            yield table(title, ("name", "value"), [(k, _flat(v)) for k, v in value.items()])
    elif _is_rows(value):
        yield _of_rows(title, value)
    elif _is_list(value):
        lists = [v if _is_list(v) else [v] for v in value]
        width = max(map(len, lists), default=1)
        rows = [(*map(_flat, row), *[""] * (width - len(row))) for row in lists]
        head = ("value",) if width == 1 else [f"value {n + 1}" for n in range(width)]
        yield table(title, head, rows)
    else:
        yield table(title, ("value",), [(_flat(value),)])


def _is_list(value: object) -> TypeGuard[Sequence[object]]:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _is_rows(value: object) -> TypeGuard[Sequence[Record]]:
    return _is_list(value) and bool(value) and all(isinstance(row, Mapping) for row in value)


def _of_rows(title: str, rows: Sequence[Record]) -> Table:
    """What names a row stands first, whatever the sorting of the JSON."""
    keys = dict.fromkeys(key for row in rows for key in row)
    head = sorted(keys, key=lambda key: FIRST.index(key) if key in FIRST else len(FIRST))
    return table(title, map(words, head), [[_flat(row.get(key)) for key in head] for row in rows])


def _flat(value: object) -> object:
    if isinstance(value, Mapping):
        return ", ".join(f"{words(k)} {text_of(_flat(v))}" for k, v in value.items())
    if isinstance(value, list | tuple):
        return tuple(_flat(v) for v in value)
    return value


def words(key: str) -> str:
    """`max_outside_m` as `max outside, m`."""
    head, _, last = key.rpartition("_")
    if head and last in UNITS:
        return f"{head.replace('_', ' ')}, {UNITS[last]}"
    return key.replace("_", " ")
