"""What `auto` makes of 27 meshes that crash, hang or fool decomposers: a table, in one process.

python tests/benchmarks/bad_meshes.py [NAME ...]

The cases are those of tests/collision/test_bad_meshes.py. CPU seconds are those of this process and
of the libraries that it forks; each library has 20 s and 3 GB.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

sys.path.extend(str(Path(__file__).parents[1] / name) for name in ("", "collision", "benchmarks"))

from ten_links import cpu
from test_bad_meshes import CASES, attempt

from assetbuild.errors import StepError
from assetbuild.mesh.triangles import TriangleMesh

LIMIT_S = 20.0


def outcome(bad: TriangleMesh) -> str:
    """What came out of one mesh, in cells of the table."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            pieces, findings = attempt(Path(folder), bad, cpu_limit=LIMIT_S)
        except StepError as error:
            return f"error: {str(error).splitlines()[0]} | | | | "
    gap = next(f for f in findings if f.rule == "collision.gap").data
    told = ", ".join(sorted({f.rule for f in findings} - {"collision.gap"}))
    return (
        f"{gap['method']}{': ' + told if told else ''} | {len(pieces)} "
        f"| {100 * float(gap['max_missing']):.1f} | {100 * float(gap['over']):.1f}"
        f" | {gap['max_vertices']} "
    )


def main(names: Sequence[str]) -> None:
    """Print the table; anything but a result or a StepError ends it with a traceback."""
    print("| mesh | faces | outcome | pieces | missing % | over % | most vertices | CPU s |")
    print("|---|---|---|---|---|---|---|---|")
    for name in names or CASES:
        bad = CASES[name]()
        before = cpu()
        cells = outcome(bad)
        print(
            f"| {name} | {len(bad.faces):,} | {cells}| {cpu() - before:.1f} |",
            flush=True,
        )
    print(f"\n{len(names or CASES)} meshes, and this process is alive")


if __name__ == "__main__":
    main(sys.argv[1:])
