"""What does each format go without that the robot has?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.facts.losses import losses
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.findings import Finding
from assetbuild.kinds import Check, write_figures
from assetbuild.plugins import load_plugin, plugin_names


class Losses(Check):
    """One finding for each format that the recipe builds. Figure: the formats that lose something.

    What a format lacks is declared by its reader, the same by which it is compared.
    """

    reads: ClassVar = Reader.reads
    told: ClassVar[Mapping[str, str]] = {"targets": "targets"}

    robot: str
    targets: tuple[str, ...] = ()

    def run(self, files: Files) -> Iterator[Finding]:
        """No file is read: what is lost follows from the robot alone."""
        table = robot_table(Reference.of_ports(files.inputs, {}))
        found: list[Finding] = []
        for name in plugin_names(Reader):
            reader = load_plugin(Reader, name)
            if set(reader.needs) <= set(self.targets):
                found += losses(
                    table, reader.form, reader.called, reader.lacks, simulated=reader.simulated
                )
        write_figures(files, {"formats": len(found)})
        yield from found
