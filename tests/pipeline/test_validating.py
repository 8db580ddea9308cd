"""A bundle that lost a file is found out by its manifest."""

from __future__ import annotations

import json
from pathlib import Path

from assetbuild.pipeline.validating import lost_files


def test_a_file_that_the_manifest_lists_must_be_there(tmp_path: Path):
    rows = [{"path": name, "sha256": "0"} for name in ("NOTICE", "mjcf/legs.xml")]
    (tmp_path / "manifest.json").write_text(json.dumps({"files": rows}))
    (tmp_path / "NOTICE").touch()
    lost = [(finding.rule, finding.where) for finding in lost_files(tmp_path)]
    assert lost == [("equal.lost", "mjcf/legs.xml")]
