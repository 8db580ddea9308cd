"""Steps run on the spot: each reads what those before it wrote, and nothing stays behind."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from assetbuild.engine.scratch import scratch
from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding


class Double(Step):
    """`text` -> `text`, twice as long."""

    outputs = ("text",)

    def run(self, files: Files) -> Iterator[Finding]:
        data = (files.inputs / "text").read_bytes()
        (files.outputs / "text").write_bytes(2 * data)
        yield Finding("test.doubled", "info", "robot", f"{len(data)} bytes")


def test_a_step_reads_what_the_one_before_it_wrote():
    with scratch() as ports:
        ports.put("text", b"ab")
        said = [*ports.run(Double()), *ports.run(Double())]
        assert ports.read("text") == b"abababab"
    assert [finding.message for finding in said] == ["2 bytes", "4 bytes"]
    assert not ports.folder.exists()


def test_a_file_of_the_user_is_read_where_it_lies_and_left_there(tmp_path: Path):
    (tmp_path / "a.xacro").write_bytes(b"robot")
    with scratch() as ports:
        for _ in range(2):
            ports.link("tree/pkg/a.xacro", tmp_path / "a.xacro")
        assert ports.read("tree/pkg/a.xacro") == b"robot"
    assert (tmp_path / "a.xacro").read_bytes() == b"robot"
