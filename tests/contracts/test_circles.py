"""No two modules of the package need each other, not even by a late import or for types alone.

import-linter's contract speaks of packages and modules side by side; this one also sees a package's
own `__init__`.
"""

from __future__ import annotations

import grimp
import networkx


def test_no_modules_import_one_another_in_a_circle():
    graph = grimp.build_graph("assetbuild", cache_dir=None)
    imports = networkx.DiGraph(
        (module, found)
        for module in graph.modules
        for found in graph.find_modules_directly_imported_by(module)
    )
    circles = networkx.strongly_connected_components(imports)
    assert [sorted(circle) for circle in circles if len(circle) > 1] == []
