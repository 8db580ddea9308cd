"""The rows of a corpus as a Markdown table, with a summary and the causes of what went wrong."""

from __future__ import annotations

from collections import Counter

from corpus.one import KINDS


def table(rows: dict[str, dict], title: str) -> str:
    head = (
        "| robot | result | cause | driven | judge | s (CPU) | edits | mass kg | mass err "
        "| kinematics | mass matrix | gravity | visual | collision | textures | lost "
        "| E/W/I | note |"
    )
    lines = [f"# Corpus: {title}", "", summary(rows), *causes(rows), "", head, "|" + " --- |" * 18]
    lines += [line_of(name, rows[name]) for name in sorted(rows)]
    lines += [
        "",
        "Errors are relative. A URDF (of a xacro, what it expands to) is compared in pinocchio,",
        "in 50 poses with a free base, with our MJCF in",
        "MuJoCo; an edited robot by the URDF that was written. An MJCF is compared in MuJoCo with",
        "ours: gravity is then all forces. Shapes: in → out, in brackets the meshes among them.",
        "Edits: what `init` wrote, counted by link. E/W/I: errors, warnings and infos.",
        "Driven: actuators of our MJCF, of its joints. Judge: pinocchio or MuJoCo on the source,",
        "and a second mesh reader. Cause: the first error's rule, or its words without names.",
        *counted(rows),
    ]
    return "\n".join(lines) + "\n"


def causes(rows: dict[str, dict]) -> list[str]:
    """How often each cause, the most frequent first, with the robots that it stopped."""
    found: dict[str, list[str]] = {}
    for name, row in sorted(rows.items()):
        for cause in faults(row):
            found.setdefault(cause, []).append(name)
    if not found:
        return []
    lines = ["", "| robots | result and cause | first error | which |", "| --- | --- | --- | --- |"]
    for cause, names in sorted(found.items(), key=lambda item: (-len(item[1]), item[0])):
        row = rows[names[0]]
        first = (
            row["note"]
            if row["result"] != "ready"
            else f"{row.get('judge')} {row.get('breaks', '')}"
        )
        cells = [str(len(names)), cause, first, ", ".join(names)]
        lines.append(
            "| " + " | ".join(c.replace("|", "\\|").replace("\n", " ") for c in cells) + " |"
        )
    return lines


def faults(row: dict) -> list[str]:
    """What keeps a robot from being right: ready, with driven joints, equal to its source."""
    if row["result"] != "ready":
        return [f"{row['result']}: {row.get('cause', '')}"]
    judge = str(row.get("judge", ""))
    kind = judge.split(":")[0] if judge.startswith("not judged") else judge.split(" ")[0]
    return [
        *(["ready, and no joint is driven"] if row.get("actuators_out") == 0 else []),
        *(["ready, and absurd"] if str(row.get("breaks", "")).startswith("absurd") else []),
        *([f"ready, and the judge says: {kind}"] if judge not in ("", "equal") else []),
    ]


def counted(rows: dict[str, dict]) -> list[str]:
    """What of each MJCF was found again, by kind."""
    found = {name: row["compared"] for name, row in sorted(rows.items()) if row.get("compared")}
    if not found:
        return []
    kinds = sorted({kind for compared in found.values() for kind in compared})
    lines = ["", f"| MJCF | {' | '.join(kinds)} |", "|" + " --- |" * (len(kinds) + 1)]
    for name, compared in found.items():
        cells = ["{} → {}".format(*compared.get(kind, (0, 0))) for kind in kinds]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return [*lines, "", "Compiled by MuJoCo: in the source → found by name in ours."]


def line_of(name: str, row: dict) -> str:
    findings, errors = row.get("findings", {}), row.get("errors", {})
    cells = [
        name.removesuffix(".urdf"),
        row["result"],
        row.get("cause", ""),
        f"{row.get('actuators_out', '-')}/{row.get('joints_out', '-')}",
        row.get("judge", "-"),
        f"{row['seconds']:.0f} ({row.get('cpu_seconds', 0):.0f})",
        ", ".join(f"{count} {name}" for name, count in row.get("edits", {}).items()),
        f"{row.get('mass_source', 0):.4g}",
        number(mass_error(row)),
        *(number(errors.get(kind)) for kind in KINDS),
        f"{shapes(row, 'visual', 'in')} → {shapes(row, 'visual', 'out')}",
        f"{shapes(row, 'collision', 'in')} → {shapes(row, 'collision', 'out')}",
        f"{row.get('textures_in', '-')} → {row.get('textures_out', '-')}",
        ", ".join(row["lost"]) or "none" if "lost" in row else "-",
        "/".join(str(findings.get(s, 0)) for s in ("error", "warning", "info")),
        str(row["note"]),
    ]
    plain = (str(cell).replace("|", "\\|").replace("\n", " ") for cell in cells)
    return "| " + " | ".join(plain) + " |"


def shapes(row: dict, role: str, side: str) -> str:
    """`44 (40)`: all of a role, and the meshes among them."""
    if f"{role}_{side}" not in row:
        return "-"
    return f"{row[f'{role}_{side}']} ({row[f'{role}_meshes_{side}']})"


def mass_error(row: dict) -> float | None:
    if not row.get("mass_source") or "mass_mjcf" not in row:
        return None
    return abs(row["mass_mjcf"] - row["mass_source"]) / row["mass_source"]


def number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1e}" if value else "0"


def summary(rows: dict[str, dict]) -> str:
    results = Counter(row["result"] for row in rows.values())
    worst = {
        kind: max((row.get("errors", {}).get(kind) or 0.0 for row in rows.values()), default=0.0)
        for kind in KINDS
    }
    alike = [row for row in rows.values() if not row.get("edits")]
    masses = [e for e in map(mass_error, alike) if e is not None]
    right = sum(not faults(row) for row in rows.values())
    told = ", ".join(f"{count} {result}" for result, count in sorted(results.items()))
    errors = ", ".join(f"{kind.replace('_', ' ')} {value:.1e}" for kind, value in worst.items())
    seconds = sum(row["seconds"] for row in rows.values())
    mass = f"{max(masses):.1e}" if masses else "-"
    return (
        f"{len(rows)} robots: {told}. {right} ready, driven and equal to the source. "
        f"{len(rows) - len(alike)} edited. "
        f"Worst errors: mass {mass} (not edited), {errors}. "
        f"{seconds:.0f} s in all. "
        f"{shapes_summary(rows)}"
    )


def shapes_summary(rows: dict[str, dict]) -> str:
    """Sums over the robots that have an MJCF, and who lost a shape, a mesh or a texture."""
    there = {name: row for name, row in rows.items() if "visual_out" in row}
    roles = ("visual", "visual_meshes", "collision", "textures")
    sums = {
        key: sum(row.get(key, 0) for row in there.values())
        for role in roles
        for key in (f"{role}_in", f"{role}_out")
    }
    losers = [
        name
        for name, row in there.items()
        if row.get("lost")
        or any(
            row[f"{role}_out"] < row.get(f"{role}_in", 0) for role in ("visual", "visual_meshes")
        )
        or row.get("textures_out", 0) != row.get("textures_in", 0)
    ]
    counts = ", ".join(
        f"{role.replace('_', ' ')} {sums[f'{role}_in']} → {sums[f'{role}_out']}" for role in roles
    )
    return f"Shapes: {counts}. Lost a shape or texture: {', '.join(losers) or 'none'}."
