"""Every kind of bug is planted where it can be, and nowhere in what only raises or explains."""

from __future__ import annotations

from pathlib import Path

from tests.writers.plant import bugs, planted

CODE = """def write(out, value, pair):
    'Words: -1.'
    if value:
        out['x'] = -pair[1] + 2.0
    out.append(max(value, pair, True))
    if not pair:
        raise ValueError(-3.0)
"""
CHANGED = {
    "sign": "pair[1] + 2.0", "operator": "-pair[1] - 2.0", "constant": "-pair[1] + 3.25",
    "index": "-pair[0] + 2.0", "flag": "pair, False)", "condition": "if not value:",
    "swapped arguments": "max(pair, value, True)", "dropped store": "pass",
}  # fmt: skip


def test_each_kind_changes_the_code(tmp_path: Path) -> None:
    (tmp_path / "writer.py").write_text(CODE)
    found = bugs(tmp_path, "writer.py")
    first = {bug.kind: bug for bug in reversed(found)}
    assert set(first) == set(CHANGED)
    for kind, text in CHANGED.items():
        assert text in planted(tmp_path, first[kind]), kind
    assert [bug.kind for bug in found].count("sign") == 1  # not in the docstring, nor in `raise`
