"""How compact an MJCF is: lines, characters, classes, and attributes said three times or more.

    python -m tests.benchmarks.xml_size MODEL.xml...

Run it on our files and on a checkout of MuJoCo Menagerie. "Repeated" counts attributes of joints,
geoms and drives (names, meshes and references aside) that at least three elements with the same tag
spell out alike, each but its first time: what another class could have said.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

from defusedxml import ElementTree

OWN = {"name", "class", "mesh", "joint", "joint1", "joint2", "tendon", "site"}
BODY_TAGS = {"geom", "joint", "position", "motor", "general", "velocity"}
LEAST = 3


def main(paths: list[str]) -> None:
    """One row per file."""
    print("| file | lines | characters | classes | repeated | most of all |")
    print("| --- | --- | --- | --- | --- | --- |")
    for path in map(Path, paths):
        text = path.read_text(encoding="utf-8")
        root = ElementTree.fromstring(text)
        said = Counter(
            (element.tag, key, value)
            for section in root
            if section.tag in ("worldbody", "actuator")
            for element in section.iter()
            if element.tag in BODY_TAGS
            for key, value in element.attrib.items()
            if key not in OWN
        )
        repeated = {what: count - 1 for what, count in said.items() if count >= LEAST}
        classes = sum("class" in element.attrib for element in root.iter("default"))
        top = max(repeated, key=lambda what: repeated[what], default=("", "", ""))
        most = f'{top[0]} {top[1]}="{top[2]}"' if top[0] else ""
        lines = text.count("\n")
        row = path.name, lines, len(text), classes, sum(repeated.values()), most
        print(f"| {' | '.join(map(str, row))} |")


if __name__ == "__main__":
    main(sys.argv[1:])
