"""The rows of a corpus as a Markdown table, with a summary and the causes of what went wrong."""

from __future__ import annotations

from collections import Counter


def table(rows: dict[str, dict], title: str) -> str:
    head = "| robot | result | cause | driven | judge | s (CPU, MB) | edits | lost | E/W/I | note |"
    lines = [f"# Corpus: {title}", "", summary(rows), *causes(rows), "", head, "|" + " --- |" * 10]
    lines += [line_of(name, rows[name]) for name in sorted(rows)]
    lines += [
        "",
        "Driven: actuators of our MJCF, of its joints. Judge: pinocchio or MuJoCo on the source,",
        "and a second mesh reader. Cause: the first error's rule, or its words without names.",
        "MB: of the largest process.",
        "Edits: what `init` wrote, counted by link. E/W/I: errors, warnings and infos.",
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
        lines.append(cells(len(names), cause, first, ", ".join(names)))
    return lines


def faults(row: dict) -> list[str]:
    """What keeps a robot from being right: ready, with driven joints, equal to its source."""
    if row["result"] != "ready":
        return [f"{row['result']}: {row.get('cause', '')}"]
    judge = str(row.get("judge", ""))
    kind = judge.split(":")[0] if judge.startswith("not judged") else judge.split(" ")[0]
    return [
        *(["ready, and no joint is driven"] if row.get("actuators") == 0 else []),
        *(["ready, and absurd"] if str(row.get("breaks", "")).startswith("absurd") else []),
        *([f"ready, and the judge says: {kind}"] if judge not in ("", "equal") else []),
    ]


def line_of(name: str, row: dict) -> str:
    findings = row.get("findings", {})
    return cells(
        name.removesuffix(".urdf"),
        row["result"],
        row.get("cause", ""),
        f"{row.get('actuators', '-')}/{row.get('joints', '-')}",
        row.get("judge", "-"),
        f"{row['seconds']:.0f} ({row.get('cpu_seconds', 0):.0f}, {row.get('peak_mb', 0)})",
        ", ".join(f"{count} {name}" for name, count in row.get("edits", {}).items()),
        ", ".join(row["lost"]) or "none" if "lost" in row else "-",
        "/".join(str(findings.get(s, 0)) for s in ("error", "warning", "info")),
        row["note"],
    )


def cells(*values: object) -> str:
    """A row of a table."""
    plain = (str(value).replace("|", "\\|").replace("\n", " ") for value in values)
    return f"| {' | '.join(plain)} |"


def summary(rows: dict[str, dict]) -> str:
    results = Counter(row["result"] for row in rows.values())
    told = ", ".join(f"{count} {result}" for result, count in sorted(results.items()))
    right = sum(not faults(row) for row in rows.values())
    edited = sum(bool(row.get("edits")) for row in rows.values())
    seconds = sum(row["seconds"] for row in rows.values())
    peak = max((row.get("peak_mb", 0) for row in rows.values()), default=0)
    return (
        f"{len(rows)} robots: {told}. {right} ready, driven and equal to the source. "
        f"{edited} edited. {seconds:.0f} s in all, at most {peak} MB."
    )
