"""What the source's licence asks of who passes the bundle on."""

from __future__ import annotations

import re

from assetbuild.findings import Finding

_TERMS = {
    "ND": (
        "license.no_derivatives",
        "warning",
        "forbids to pass on what was made from the work: converted meshes, an edited URDF",
        "keep the bundle to yourself, or ask the rights holder",
    ),
    "NC": (
        "license.non_commercial",
        "info",
        "allows no commercial use",
        "ask the rights holder before you sell what was made with it",
    ),
    "SA": (
        "license.share_alike",
        "info",
        "asks that what was made from the work is passed on under the same licence",
        "pass the bundle on under that licence",
    ),
}
"""Terms of Creative Commons in an SPDX identifier, `CC-BY-NC-ND-4.0`."""


def licence_findings(license_id: str | None, texts: int) -> list[Finding]:
    """license_id: SPDX expression of the recipe; texts: licence files that the source brings."""
    subject, found = "recipe source", []
    if license_id is None:
        found.append(
            Finding(
                rule="license.unstated",
                severity="warning",
                subject=subject,
                message="the recipe does not say under which licence the robot comes",
                hint="add `license:` with an SPDX identifier below `source`",
            )
        )
    for word in re.findall(r"[A-Za-z0-9.+-]+", license_id or ""):
        parts = word.upper().split("-")
        for term, (rule, severity, message, hint) in _TERMS.items():
            if parts[0] == "CC" and term in parts:
                found.append(
                    Finding(
                        rule,
                        severity,  # type: ignore[arg-type] # one of the literals above
                        "recipe source.license",
                        f"{word} {message}",
                        hint,
                        data={"license": word},
                    )
                )
    if not texts:
        found.append(
            Finding(
                rule="license.no_text",
                severity="info",
                subject=subject,
                message="the source brings no licence text, so the bundle has none",
                hint="add the text to the source: most licences ask that it is passed on",
            )
        )
    return found
