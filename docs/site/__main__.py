"""The documentation as a site: `python -m docs.site serve`, or `build -d FOLDER`.

MkDocs with this folder's configuration; what follows the verb are MkDocs' own options.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

CONFIG = Path(__file__).with_name("mkdocs.yml")


def main(words: list[str]) -> None:
    """Run MkDocs without the advertisement of the theme's successor."""
    os.environ["NO_MKDOCS_2_WARNING"] = "1"
    try:
        from mkdocs.__main__ import cli
    except ModuleNotFoundError as error:
        sys.exit(f"error: no module `{error.name}`\nhint: .venv/bin/pip install -e '.[docs]'")

    verb, *rest = words or ["serve"]
    cli([verb, "--strict", "-f", str(CONFIG), *rest])


if __name__ == "__main__":
    main(sys.argv[1:])
