"""What the source's licence asks of who passes the bundle on."""

from __future__ import annotations

import re
from collections.abc import Iterator

from assetbuild.findings import Finding, Rule

UNSTATED = Rule(
    "license.unstated",
    "warning",
    "the recipe does not state the source's licence",
    "add `source.license`",
)
NO_DERIVATIVES = Rule(
    "license.no_derivatives",
    "warning",
    "the licence (CC ...-ND) does not allow you to pass on what was made from the work",
    "keep the bundle to yourself, or ask",
)
NON_COMMERCIAL = Rule(
    "license.non_commercial",
    "info",
    "the licence (CC ...-NC) does not allow commercial use",
    "ask before you sell",
)
SHARE_ALIKE = Rule(
    "license.share_alike",
    "info",
    "the licence (CC ...-SA) also applies to what is made from the work",
    "pass the bundle on under the same licence",
)
NO_TEXT = Rule(
    "license.no_text", "info", "the source comes without a licence text", "add it to the source"
)

_TERMS = {
    "ND": (
        NO_DERIVATIVES,
        "forbids to pass on what was made from the work: converted meshes, an edited URDF",
        "keep the bundle to yourself, or ask the rights holder",
    ),
    "NC": (
        NON_COMMERCIAL,
        "allows no commercial use",
        "ask the rights holder before you sell what was made with it",
    ),
    "SA": (
        SHARE_ALIKE,
        "asks that what was made from the work is passed on under the same licence",
        "pass the bundle on under that licence",
    ),
}
"""Terms of Creative Commons in an SPDX identifier, `CC-BY-NC-ND-4.0`."""


def licence_findings(license_id: str | None, texts: int) -> Iterator[Finding]:
    """license_id: SPDX expression of the recipe; texts: licence files that the source brings."""
    if license_id is None:
        message = "the recipe does not say under which licence the robot comes"
        hint = "add `license:` with an SPDX identifier below `source`"
        yield UNSTATED("recipe source", message, hint)
    for word in re.findall(r"[A-Za-z0-9.+-]+", license_id or ""):
        first, *terms = word.upper().split("-")
        for term, (rule, message, hint) in _TERMS.items():
            if first == "CC" and term in terms:
                data = {"license": word}
                yield rule("recipe source.license", f"{word} {message}", hint, data=data)
    if not texts:
        message = "the source brings no licence text, so the bundle has none"
        hint = "add the text to the source: most licences ask that it is passed on"
        yield NO_TEXT("recipe source", message, hint)
