"""The licence that the files around a description state, as SPDX spells it."""

from __future__ import annotations

import os
import re
from pathlib import Path

from assetbuild.init.packages import in_repository, start_of
from assetbuild.source.get.files import LICENSES

SPDX = (
    "Apache-2.0", "MIT", "MIT-0", "BSD-2-Clause", "BSD-3-Clause", "BSD-3-Clause-Clear", "MPL-2.0",
    "GPL-2.0-only", "GPL-3.0-only", "GPL-3.0-or-later", "LGPL-2.1-only", "LGPL-3.0-only", "ISC",
    "EPL-2.0", "CC0-1.0", "CC-BY-4.0", "CC-BY-SA-4.0", "CC-BY-NC-4.0", "CC-BY-NC-SA-4.0",
)  # fmt: skip
"""Identifiers that are taken as they stand."""
LICENCES = {
    "apache 2.0": "Apache-2.0", "apache2.0": "Apache-2.0", "apache license 2.0": "Apache-2.0",
    "apache license, version 2.0": "Apache-2.0", "mit license": "MIT", "the mit license": "MIT",
    "bsd 3-clause": "BSD-3-Clause", "bsd-3": "BSD-3-Clause", "3-clause bsd": "BSD-3-Clause",
    "bsd 2-clause": "BSD-2-Clause", "mpl 2.0": "MPL-2.0", "cc0": "CC0-1.0",
} | {name.lower(): name for name in SPDX}  # fmt: skip
"""Spellings that mean one licence; `BSD` alone and `GPL` mean several."""
TEXTS = (
    (r"apache license\s+version 2\.0", "Apache-2.0"),
    (r"mozilla public license,? version 2\.0", "MPL-2.0"),
    (r"permission is hereby granted, free of charge, to any person", "MIT"),
    (r"redistribution and use .*neither the name", "BSD-3-Clause"),
    (r"redistribution and use .*materials provided with the distribution", "BSD-2-Clause"),
    (r"attribution 4\.0 international", "CC-BY-4.0"),
    (r"attribution-sharealike 4\.0 international", "CC-BY-SA-4.0"),
    (r"attribution-noncommercial 4\.0 international", "CC-BY-NC-4.0"),
    (r"attribution-noncommercial-sharealike 4\.0 international", "CC-BY-NC-SA-4.0"),
)
"""Words that only the text of one licence has; the first that matches counts."""
MOST_BYTES = 200_000
"""Bytes of a licence or a package.xml that are read."""
ABOVE = 2
"""Folders above the source that are looked at: meshes and URDF may lie deep in a package."""
StatedLicence = tuple[str, str, str]
"""What a file states: the licence as SPDX spells it, or "" where the words mean no one licence;
the words; the file.
"""


def stated_licence(root: Path, file: str) -> StatedLicence | None:
    """The licence that the file nearest to the description states; None where none does.

    root: of the source; file: the description, below it.
    """
    above = (root / file).parents
    most = sum(folder.is_relative_to(root) for folder in above) + ABOVE
    for folder in in_repository(above[:most], most):
        for path in sorted(folder.iterdir()) if folder.is_dir() else ():
            if path.name.lower().startswith(LICENSES) and (text := start_of(path, MOST_BYTES)):
                words = " ".join(text.lower().split())
                if licence := next((name for own, name in TEXTS if re.search(own, words)), ""):
                    outside = not folder.is_relative_to(root)
                    return licence, licence, os.path.relpath(path, root) if outside else path.name
        package = start_of(folder / "package.xml", MOST_BYTES)
        if package and (stated := _of_package(package)):
            return stated
    return None


def _of_package(text: str) -> StatedLicence | None:
    """What package.xml states; of several licences nobody knows which is the robot's.

    ROS' template for packages states `TODO: License declaration`.
    """
    tags = re.findall(r"<license[^>]*>([^<]*)</license>", text)
    stated = (" ".join(words.split()) for words in tags if not words.strip().startswith("TODO"))
    chosen = list(dict.fromkeys(stated))
    if not chosen:
        return None
    name = LICENCES.get(chosen[0].lower(), "") if len(chosen) == 1 else ""
    return name, ", ".join(chosen), "package.xml"
