"""Does NVIDIA's asset validator accept the USD, as its sites and pipelines ask for?

The validator runs in an environment of its own, for it wants an older numpy. Meshes are looked at
as they are: a rule about the surface that the maker drew is told, and is no error.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

from assetbuild.engine.step import Files, Limits
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import write_figures
from assetbuild.simulators.consumers import ConsumerCheck
from assetbuild.simulators.environments import Environment

BEYOND_IMPORTS = ("assetbuild.simulators._asset_validator_child",)
SHOWN = 3
"""Prims that a message names."""

FAILURE = Rule(
    "asset_validator.failure",
    "error",
    "a rule of the asset validator fails",
    "the message is the validator's, which explains its rules with `--explain`",
)
WARNING = Rule(
    "asset_validator.warning",
    "info",
    "the asset validator warns, mostly of the makers' visual meshes",
    "repair the mesh in the source where it disturbs a renderer",
)
NO_RESULT = Rule(
    "asset_validator.no_result",
    "error",
    "the asset validator gave no result",
    "read its own message",
)


class AssetValidator(ConsumerCheck):
    """All rules that the validator enables by itself, on the variant that is selected."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)
    reads: ClassVar[tuple[str, ...]] = ()
    consumer: ClassVar[str] = "asset_validator"
    limits: ClassVar[Limits] = Limits(wall_s=600.0)
    home: ClassVar[Environment] = Environment(
        "asset_validator",
        ("omniverse-asset-validator==1.18.0", "usd-core==26.11", "numpy<2"),
    )

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: failures and warnings."""
        file = (files.inputs / f"usd/{self.robot}.usda").absolute()
        answer, failure = self.answer("_asset_validator_child.py", {"file": str(file)})
        found = (answer or {}).get("issues")
        issues = found if isinstance(found, list) else None
        yield from judged(issues, failure)
        counts = Counter("warnings" if is_mild(issue) else "failures" for issue in issues or ())
        write_figures(files, {word: counts[word] for word in ("failures", "warnings")})


def is_mild(issue: Mapping[str, Any]) -> bool:
    """Whether the validator itself only warns."""
    return issue["severity"] in ("WARNING", "INFO")


def judged(issues: Sequence[Mapping[str, Any]] | None, failure: str = "") -> Iterator[Finding]:
    """An error for each failure; one line for each rule that warns.

    issues: None where the validator gave no list of them; failure: how it failed, where it did.
    """
    if issues is None:
        yield NO_RESULT("robot", f"no result: {failure or 'no list of issues'}")
        return
    mild: dict[str, list[Mapping[str, Any]]] = {}
    for issue in issues:
        if is_mild(issue):
            mild.setdefault(issue["rule"], []).append(issue)
        else:
            subject = f"prim {issue['path']}" if issue["path"] else "robot"
            yield FAILURE(subject, f"{issue['rule']}: {issue['message']}")
    for rule, found in sorted(mild.items()):
        paths = list(dict.fromkeys(issue["path"] for issue in found))
        more = f" and {len(paths) - SHOWN} more" if len(paths) > SHOWN else ""
        shown = ", ".join(f"`{path}`" for path in paths[:SHOWN])
        yield WARNING(
            "robot",
            f"{rule} warns {len(found)} times of {shown}{more}; the first: {found[0]['message']}",
            data={"rule": rule, "times": len(found)},
        )
