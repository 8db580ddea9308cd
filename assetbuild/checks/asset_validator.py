"""Does NVIDIA's asset validator accept the USD, as its sites and pipelines ask for?

Meshes are looked at as they are: a rule about the surface that the maker drew informs only.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

from assetbuild.findings import Finding, Rule
from assetbuild.simulators.consumers import Environment
from assetbuild.simulators.foreign import REPORT, Validator

SHOWN = 3
"""Prims that a message names."""
Issue = dict[str, Any]  # Any: foreign JSON

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


class AssetValidator(Validator):
    """All rules that the validator enables by itself, on the variant that is selected."""

    consumer: ClassVar[str] = "asset_validator"
    home: ClassVar[Environment] = Environment(
        "asset_validator", ("omniverse-asset-validator==1.18.0", "usd-core==26.11", "numpy<2")
    )
    no_report = NO_RESULT

    # One variant: all of them would take five times as long.
    words = (
        "-c", "from omni.asset_validator import cli_main; cli_main()", "--no-variants",
        "--json-output", REPORT, "{tool.robot}.usda",
    )  # fmt: skip

    def judge(self, report: str, figures: dict[str, object]) -> Iterator[Finding]:
        """An error for each failure; one line for each rule that warns."""
        issues = [issue for rule in json.loads(report)["rules"] for issue in rule["issues"]]
        mild: dict[str, list[Issue]] = {}
        for issue in issues:
            if issue["severity"] in ("WARNING", "INFO"):
                mild.setdefault(_rule(issue), []).append(issue)
            else:
                path = _path(issue)
                subject = f"prim {path}" if path else "robot"
                yield FAILURE(subject, f"{_rule(issue)}: {issue['message']}")
        warnings = sum(map(len, mild.values()))
        figures |= {"failures": len(issues) - warnings, "warnings": warnings}
        yield from (_warning(rule, found) for rule, found in sorted(mild.items()))


def _warning(rule: str, found: Sequence[Issue]) -> Finding:
    paths = list(dict.fromkeys(map(_path, found)))
    more = f" and {len(paths) - SHOWN} more" if len(paths) > SHOWN else ""
    shown = ", ".join(f"`{path}`" for path in paths[:SHOWN])
    return WARNING(
        "robot",
        f"{rule} warns {len(found)} times of {shown}{more}; the first: {found[0]['message']}",
        data={"rule": rule, "times": len(found)},
    )


def _rule(issue: Issue) -> str:
    return str((issue.get("rule") or {}).get("name", "validator"))


def _path(issue: Issue) -> str:
    return str((issue.get("at") or {}).get("path", ""))
