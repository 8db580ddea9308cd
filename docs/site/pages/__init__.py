"""Pages of the site that the code itself states; `hooks.py` adds them when the site is built."""

from __future__ import annotations

from collections.abc import Mapping

from docs.site.pages.facts import fact_page
from docs.site.pages.keys import key_page
from docs.site.pages.mjcf import mjcf_page
from docs.site.pages.rules import entries_of, package_modules, rule_pages
from docs.site.pages.verbs import verb_page


def generated() -> Mapping[str, str]:
    """Path below `docs/reference` -> text."""
    return {
        **rule_pages(entries_of(package_modules())),
        "recipe.md": key_page(),
        "facts.md": fact_page(),
        "mjcf.md": mjcf_page(),
        "verbs.md": verb_page(),
    }
