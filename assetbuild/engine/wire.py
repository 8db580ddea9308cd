"""What goes between a build and its child processes: steps, findings and errors as JSON.

No pickle: a child that was handed hostile input cannot make its parent run anything.
"""

from __future__ import annotations

import errno
import importlib
import io
import sys
import traceback
from collections.abc import Callable, Mapping
from typing import Any

from assetbuild.engine.digest import canonical_json
from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import AssetBuildError, MachineError, StepError, Where
from assetbuild.findings import Finding


def step_to_json(step: Step) -> dict[str, object]:
    """Module, class and fields. ValueError when a child could not find the class again."""
    kind = type(step)
    if kind.__module__ == "__main__" or "<locals>" in kind.__qualname__:
        raise ValueError(f"a child process cannot import {kind.__module__}.{kind.__qualname__}")
    return {
        "module": kind.__module__,
        "class": kind.__qualname__,
        "fields": step.model_dump(mode="json"),
    }


def step_from_json(raw: Mapping[str, Any]) -> Step:  # Any: JSON
    """Inverse of `step_to_json`; imports the step's module."""
    target: Any = importlib.import_module(raw["module"])  # Any: module, then class
    for name in raw["class"].split("."):
        target = getattr(target, name)
    if not (isinstance(target, type) and issubclass(target, Step)):
        raise TypeError(f"{raw['module']}.{raw['class']} is not a step")
    return target.model_validate(raw["fields"])


def error_to_json(error: AssetBuildError) -> dict[str, object]:
    """Class names from the error's own up to the base, and what it says."""
    where = error.where
    return {
        "classes": [
            [kind.__module__, kind.__qualname__]
            for kind in type(error).__mro__
            if issubclass(kind, AssetBuildError)
        ],
        "message": error.message,
        "where": [where.file, where.line, where.column] if where else None,
        "hint": error.hint,
    }


def error_from_json(raw: Mapping[str, Any]) -> AssetBuildError:  # Any: JSON
    """Inverse of `error_to_json`: the nearest class that this process has loaded already."""
    where = Where(*raw["where"]) if raw["where"] else None
    for module, name in raw["classes"]:
        kind = getattr(sys.modules.get(module), name, None)
        if isinstance(kind, type) and issubclass(kind, AssetBuildError):
            try:
                return kind(raw["message"], where=where, hint=raw["hint"])
            except TypeError:  # a class with a constructor of its own: take its base
                continue
    return StepError(raw["message"], where=where, hint=raw["hint"])


def perform(
    step: Callable[[], Step], files: Files, label: str, limits: Limits
) -> tuple[dict[str, object], str]:
    """Run a step; `{"findings": [...]}` or `{"error": {...}}`, and the traceback of an error.

    Used by the child process and by in-process steps alike, so both give the same result.
    """
    try:
        findings = []
        for finding in step().run(files) or ():
            if not isinstance(finding, Finding):
                raise TypeError(f"run() yielded {type(finding).__name__}, not a Finding")
            findings.append(finding.to_json())
            canonical_json(findings[-1])  # TypeError on numpy scalars and the like, named by type
        return {"findings": findings}, ""
    except (Exception, SystemExit) as error:
        log = io.StringIO()
        traceback.print_exception(error, file=log)
        failure = error
        if not isinstance(failure, AssetBuildError):
            failure = error_of_exception(error, label, limits)
        return {"error": error_to_json(failure)}, log.getvalue()


def error_of_exception(error: BaseException, label: str, limits: Limits) -> AssetBuildError:
    """The sentence for an exception that the step did not mean to raise."""
    if isinstance(error, MemoryError) or "not allocate memory" in str(error):  # as MuJoCo says it
        return StepError(
            f"step `{label}` ran over its memory limit of {limits.memory_mb} MB",
            hint="simplify the input of this step",
        )
    if isinstance(error, OSError) and error.errno == errno.EFBIG:
        return StepError(f"step `{label}` wrote a file over its limit of {limits.file_mb} MB")
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return MachineError(
            f"no space left on the disk while step `{label}` ran",
            hint="free some space; what is built already stays",
        )
    if isinstance(error, ModuleNotFoundError) and error.name:
        package = error.name.partition(".")[0]
        if package != "assetbuild":
            return MachineError(
                f"step `{label}` needs the Python package `{package}`, which is not installed",
                hint=f"install it: pip install {package}",
            )
    kind = type(error).__name__
    text = " ".join(str(error).split())
    return StepError(f"a bug in step `{label}`: {kind}{': ' + text[:300] if text else ''}")
