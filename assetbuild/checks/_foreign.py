"""What other people's programs say of a built file: a class for each, with how it is called, what
its report means, and the rule that says that there is none.

simcheck and mjcf-doctor judge the MJCF (extra `lint`). NVIDIA's asset validator and its profile
SimReady judge the USD, as its sites and pipelines ask for; both are in environments of their own.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.engine.step import Files, Limits
from assetbuild.engine.world import World
from assetbuild.errors import StepError, quoted
from assetbuild.findings import Data, Finding, Rule, Severity
from assetbuild.plugin_types import Check, write_figures
from assetbuild.simulators.children import last_line, run
from assetbuild.simulators.consumers import ConsumerCheck, Environment

BEYOND_IMPORTS = ("simcheck", "mjcf_doctor")
REPORT = "../report.json"
"""Where a program may write its report, seen from the folder it runs in; else it prints it."""
SEVERITIES: Mapping[str, Severity] = {"error": "error", "warning": "warning", "warn": "warning"}
"""Ours for theirs; what is neither an error nor a warning informs."""
PROFILE_VERSION = "3.0.0"
DRAWN_LATER = "SR.002"
"""SimReady's thumbnail: it is a picture of the report, which is drawn beside the checks."""
SHOWN = 3
"""Prims that a message names."""
Json = dict[str, Any]  # Any: foreign JSON


class ForeignTool(Check):
    """Runs a program on a copy of a target's folder; one that breaks is a finding."""

    isolated = True
    reads: ClassVar[tuple[str, ...]] = ()
    no_report: ClassVar[Rule]
    words: ClassVar[tuple[str, ...]]
    """Words after `python -P`, in the folder of the target; `{tool.robot}` is a field of it."""

    robot: str
    """Name of the robot: the stem of the main file."""

    def judge(self, report: str, figures: dict[str, object]) -> Iterator[Finding]:
        """The report's findings; puts its numbers into `figures`.

        ValueError, LookupError or TypeError: it is no report.
        """
        raise NotImplementedError

    def interpreter(self) -> Path:
        """The Python that has the program."""
        return Path(sys.executable)

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: none where there is no report."""
        report, failure = self._report(files.inputs / self.needs[0])
        figures: dict[str, object] = {}
        try:
            findings = [*self.judge(report, figures)]
        except (ValueError, LookupError, TypeError) as error:
            why = failure or f"it is not as expected: {error}"
            findings = [self.no_report("robot", f"{self.no_report.meaning}: {why}")]
        write_figures(files, figures)
        yield from findings

    def _report(self, folder: Path) -> tuple[str, str]:
        """Its report, and the last line that it says."""
        with tempfile.TemporaryDirectory(prefix="foreign-") as scratch:
            # A program that resolves links would find the store's files, each in another folder.
            place = Path(shutil.copytree(folder, Path(scratch).resolve() / "files"))
            command = [str(self.interpreter()), "-P", *(w.format(tool=self) for w in self.words)]
            done = run(command, place, self.limits.wall_s)
            report = place / REPORT
            output = report.read_bytes() if report.exists() else done.stdout
        return output.decode("utf-8", "replace"), last_line(done.stderr or done.stdout)


# --- of the MJCF ---------------------------------------------------------------------------------


SIMCHECK = Rule(
    "simcheck.*",
    ("info", "warning", "error"),
    "what simcheck reports, with its checks and severities (`validate.linters: [simcheck]`)",
    "`simcheck explain CHECK`",
)
SIMCHECK_BROKEN = Rule(
    "simcheck.broken", "warning", "simcheck gave no report", "read its own message"
)


class Simcheck(ForeignTool):
    """Findings `simcheck.<category>.<check>`. Its engines are left off: ours simulate already."""

    own_name = "simcheck"
    usual_s = 30.0
    listed_in = "validate.linters"
    needs = ("mjcf",)
    requires: ClassVar = {"simcheck": "lint"}
    limits = Limits(wall_s=1200.0, memory_mb=4096)
    no_report = SIMCHECK_BROKEN
    words = (
        "-m", "simcheck", "check", "{tool.robot}.xml", "--json", "-", "--static-only",
        "--no-config", "--robot", "--quiet", "--fail-on", "never",
    )  # fmt: skip

    def judge(self, report: str, figures: dict[str, object]) -> Iterator[Finding]:
        """Its ids, its severities, its words."""
        results = json.loads(report[report.index("{") :])["results"]
        passed = sum(result["status"] == "pass" for result in results)
        figures |= {"checks": len(results), "passed": passed}
        for result in results:
            for finding in result["findings"]:
                yield SIMCHECK.named(result["id"])(
                    "robot",
                    f"simcheck: {finding['message']}",
                    severity=SEVERITIES.get(finding["severity"].lower(), "info"),
                    data={"target": str(finding.get("target", ""))},
                )


DOCTOR = Rule(
    "doctor.*",
    ("info", "warning", "error"),
    "what mjcf-doctor reports, with its codes and severities (`validate.linters: [mjcf_doctor]`)",
    "`mjcf-doctor check -v mjcf/scene.xml` explains it",
)
DOCTOR_BROKEN = Rule(
    "doctor.broken", "warning", "mjcf-doctor gave no report", "read its own message"
)


class MjcfDoctor(ForeignTool):
    """Findings `doctor.<code>`, of short simulations, soft contacts and masks of the scene."""

    own_name = "mjcf_doctor"
    listed_in = "validate.linters"
    needs = ("mjcf",)
    requires: ClassVar = {"mjcf_doctor": "lint"}
    no_report = DOCTOR_BROKEN
    words = ("-m", "mjcf_doctor", "check", "scene.xml", "--json", "-q")

    def judge(self, report: str, figures: dict[str, object]) -> Iterator[Finding]:
        """The report stands after a page for people."""
        (file,) = json.loads(report[f"\n{report}".index("\n[\n") :])
        figures["findings"] = len(file["findings"])
        for finding in file["findings"]:
            yield DOCTOR.named(finding["code"])(
                "robot",
                f"mjcf-doctor: {finding['subject']}: {finding['message']}",
                severity=SEVERITIES.get(finding["level"].lower(), "info"),
            )


# --- of the USD ----------------------------------------------------------------------------------


class Validator(ForeignTool, ConsumerCheck):
    """A validator of USD, in an environment of its own: its OpenUSD or numpy clashes with ours."""

    isolated = False
    needs: ClassVar[tuple[str, ...]] = ("usd",)
    limits: ClassVar[Limits] = Limits(wall_s=600.0)

    def interpreter(self) -> Path:
        """The Python of the validator's environment."""
        python = self.home.python(World())
        if python is None:
            raise StepError(f"the environment of {self.home.name} is not there", hint=self.absent())
        return python


REQUIRED = Rule(
    "simready.required",
    "error",
    "a requirement of the SimReady profile is not met",
    "state what is missing in the recipe's `about`, or `license` under `source`",
)
OPTIONAL = Rule(
    "simready.optional",
    "info",
    "optional features of the SimReady profile are not there",
    "docs/reference/simready.md says why, feature by feature",
)
NOT_SIMREADY = Rule(
    "simready.no_result", "error", "SimReady's validator gave no result", "read its own message"
)


class SimReady(Validator):
    """Robot-Gripper for what `usd.robot_type` calls an end effector, else Robot-Body."""

    own_name = "simready"
    home: ClassVar[Environment] = Environment(
        "simready", ("simready-validate==2026.8.0", "simready-foundation-tier-core==2026.8.0")
    )
    recipe_fields: ClassVar[Mapping[str, str]] = {"robot_type": "usd.robot_type"}
    no_report = NOT_SIMREADY
    # Its command line has no module of its own.
    words = (
        "-c", "from simready.validate._cli import main; main()", "--profile", "{tool.profile}",
        "--version", PROFILE_VERSION, "--output", REPORT, "{tool.robot}.usda",
    )  # fmt: skip

    robot_type: str | None = None

    @property
    def profile(self) -> str:
        """The SimReady profile that the robot must meet."""
        return "Robot-Gripper" if self.robot_type == "End Effector" else "Robot-Body"

    def judge(self, report: str, figures: dict[str, object]) -> Iterator[Finding]:
        """One error for each requirement that is not met, one line for all optional features."""
        (result,) = json.loads(report).values()
        features: dict[str, Json] = result["features_summary"]
        if not features:
            raise LookupError("no feature")
        lacking = {name: _lacking(name, feature) for name, feature in sorted(features.items())}
        lacking = {name: codes for name, codes in lacking.items() if codes}
        missing = []
        for name, codes in lacking.items():
            if not features[name]["blocking_failure"]:
                missing.append(f"{name} ({', '.join(codes)})")
                continue
            messages = json.loads(features[name].get("requirement_messages") or "{}")
            for code in codes:
                said = " ".join(messages.get(f"com.nvidia.simready.{code}", []))
                yield REQUIRED(
                    "robot",
                    f"{self.profile} {PROFILE_VERSION}: {code}: {said or f'feature {name} fails'}",
                    data={"feature": name, "requirement": code},
                )
        named = f"{self.profile} {PROFILE_VERSION}"
        met = len(features) - len(lacking)
        figures |= {"profile": named, "met": met, "of": len(features)}
        if missing:
            text = f"{named}: {len(missing)} of {len(features)} features, all optional, are not "
            message = f"{text}there: {', '.join(missing)}"
            yield OPTIONAL("robot", message, data={"features": len(missing)})


def _lacking(name: str, feature: Json) -> list[str]:
    """Codes of what a feature lacks, its own name where it does not say what; none if it is met.

    They stand there as `['com.nvidia.simready.SR.004']`.
    """
    if feature["passed"]:
        return []
    key = "failing requirements" if feature["blocking_failure"] else "optional requirements"
    words = (word.strip(" []'") for word in feature.get(key, "").split(","))
    codes = [word.removeprefix("com.nvidia.simready.") for word in words if word] or [name]
    return [code for code in codes if code != DRAWN_LATER]


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
NOT_VALIDATED = Rule(
    "asset_validator.no_result",
    "error",
    "the asset validator gave no result",
    "read its own message",
)


class AssetValidator(Validator):
    """All rules that the validator enables by itself, on the variant that is selected.

    Meshes are looked at as they are: a rule about the surface that the maker drew informs only.
    """

    own_name = "asset_validator"
    home: ClassVar[Environment] = Environment(
        "asset_validator", ("omniverse-asset-validator==1.18.0", "usd-core==26.11", "numpy<2")
    )
    no_report = NOT_VALIDATED
    # One variant: all of them would take five times as long.
    words = (
        "-c", "from omni.asset_validator import cli_main; cli_main()", "--no-variants",
        "--json-output", REPORT, "{tool.robot}.usda",
    )  # fmt: skip

    def judge(self, report: str, figures: dict[str, object]) -> Iterator[Finding]:
        """An error for each failure; one line for each rule that warns."""
        issues: list[Json] = [i for rule in json.loads(report)["rules"] for i in rule["issues"]]
        mild: dict[str, list[Json]] = {}
        for issue in issues:
            rule = str((issue.get("rule") or {}).get("name", "validator"))
            if issue["severity"] in ("WARNING", "INFO"):
                mild.setdefault(rule, []).append(issue)
            else:
                path = _path(issue)
                yield FAILURE(f"prim {path}" if path else "robot", f"{rule}: {issue['message']}")
        warnings = sum(map(len, mild.values()))
        figures |= {"failures": len(issues) - warnings, "warnings": warnings}
        for rule, rule_issues in sorted(mild.items()):
            paths = list(dict.fromkeys(map(_path, rule_issues)))
            shown = quoted(paths, SHOWN, " and {} more")
            text = f"{rule} warns {len(rule_issues)} times of {shown}; the first: "
            data: Data = {"rule": rule, "times": len(rule_issues)}
            yield WARNING("robot", f"{text}{rule_issues[0]['message']}", data=data)


def _path(issue: Json) -> str:
    return str((issue.get("at") or {}).get("path", ""))
