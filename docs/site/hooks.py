"""Adds to the site the pages that the code itself states; MkDocs calls this."""

from __future__ import annotations

import sys
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parents[2]))


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Each page of `docs.site.pages`, which no file of the repository holds."""
    from docs.site.pages import generated

    for name in ("site.css", "site.js"):
        text = Path(__file__).with_name(name).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=text))
    for path, text in generated().items():
        files.append(File.generated(config, f"reference/{path}", content=text))
    return files
