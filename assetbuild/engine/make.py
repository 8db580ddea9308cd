"""Making one node: from the store if its key is known, else by running its step."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

from assetbuild.engine.children import Ended, step_environment
from assetbuild.engine.digest import digest_bytes
from assetbuild.engine.explain import Change, changes_text, why_it_runs
from assetbuild.engine.graph import Graph, Node
from assetbuild.engine.keys import Parts
from assetbuild.engine.session import Made, Resolver, Session
from assetbuild.engine.staging import check_present, check_untouched, collect, stage
from assetbuild.engine.step import Files
from assetbuild.engine.store import LostObjectError, machine_error
from assetbuild.engine.wire import REFUSED, error_from_json, perform, step_to_json
from assetbuild.engine.worker import NO_SPACE
from assetbuild.errors import AssetBuildError, StepError
from assetbuild.findings import Finding, finding_from_json

Status = Literal["ran", "cached", "failed", "blocked"]
HEALING_ROUNDS = 3
ATTEMPTS = 2
"""How often a step is run whose process is killed by something else than our limits."""


@dataclass(frozen=True)
class NodeResult:
    """What became of one node.

    key: empty when it was never computed (blocked). outputs: name -> digest.
    seconds: wall clock of its step when it ran just now, else 0. cpu_seconds: of its child
    process. saved_seconds: what a cached step took when it last ran. child: in a child process.
    reason: why it ran, or what blocked it, as text; changes: the same as data.
    log: what the step printed, and the traceback of a bug; None when there is nothing.
    """

    label: str
    status: Status
    key: str = ""
    outputs: dict[str, str] | None = None
    findings: tuple[Finding, ...] = ()
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    saved_seconds: float = 0.0
    child: bool = False
    error: AssetBuildError | None = None
    reason: str = ""
    changes: tuple[Change, ...] = ()
    log: Path | None = None

    def __getitem__(self, output: str) -> str:
        """Digest of an output; KeyError when there is none (the node failed or was blocked)."""
        return (self.outputs or {})[output]


class Maker:
    """Makes nodes of one graph. `make` may be called from many threads."""

    def __init__(self, graph: Graph, session: Session) -> None:
        self.graph = graph
        self.session = session
        self.resolver = Resolver(graph.nodes, session)
        self.healed: dict[str, NodeResult] = {}
        self._healing = threading.RLock()
        self._mine = threading.local()
        # Those of this execution: once they are closed by Ctrl-C, none is started any more.
        self._children = session.children

    def make(self, label: str, started: Callable[[str], None] | None = None) -> NodeResult:
        """The node, from the store or freshly run; its errors are in the result.

        `started` is called when the step really runs. The nodes it reads are made already; if
        the store lost one of their outputs since, they are made again first.
        """
        node = self.graph.nodes[label]
        began = time.monotonic()
        key = ""
        changes: tuple[Change, ...] = ()
        try:
            key, parts = self._key(label)
            made = self.resolver.made(label)
            if made is None:
                with self._turn(node, key):
                    made = self.resolver.made(label)  # another may have made it meanwhile
                    if made is None:
                        changes = why_it_runs(self.session, label, key, parts)
                        if started is not None:
                            started(label)
                        made = self._run_healing(node, parts)
                        self.session.learn(key, made)
                        self.session.journal.ran(label, parts, [c.to_json() for c in changes])
                        return self._ran(label, key, made, changes)
            self.session.journal.saw(label, parts)
            return _cached(label, key, made)
        except AssetBuildError as error:
            failure = error
        except OSError as error:  # of the private folder: disk full, no permission
            failure = machine_error(error, self.session.store.root.parent)
        return NodeResult(
            label=label,
            status="failed",
            key=key,
            seconds=round(time.monotonic() - began, 4),
            child=node.step.isolated,
            error=self._with_log(failure, label),
            reason=changes_text(changes),
            changes=changes,
            log=_existing(self.log_path(label)),
        )

    def _turn(self, node: Node, key: str) -> AbstractContextManager[None]:
        """Each action runs once: in this build, and among all builds that share the store.

        Who heals holds the turn of a later step already, and waits for nobody: no circles.
        """
        if self._mine.__dict__.get("heals"):
            return nullcontext()
        patience_s = node.step.limits.wall_s * ATTEMPTS + 30.0
        return self.session.store.turns.turn(
            key, patience_s=patience_s, done=lambda: self._children.closed
        )

    def _ran(self, label: str, key: str, made: Made, changes: tuple[Change, ...]) -> NodeResult:
        return NodeResult(
            label=label,
            status="ran",
            key=key,
            outputs=dict(made.outputs),
            findings=made.findings,
            seconds=made.seconds,
            cpu_seconds=made.cpu_seconds,
            child=made.child,
            reason=changes_text(changes) + ("; run again after a crash" * (made.attempts > 1)),
            changes=changes,
            log=_existing(self.log_path(label)),
        )

    def log_path(self, label: str) -> Path:
        """Where the log of a node of this build lies, if its last run left one."""
        build = digest_bytes(os.fsencode(self.session.build))[:12]
        name = re.sub(r"[^\w.-]+", "_", label, flags=re.ASCII)[:80]
        return self.session.store.root / "logs" / build / f"{name}-{_short(label)}.log"

    # -- lost objects

    def _key(self, label: str) -> tuple[str, Parts]:
        for _ in range(HEALING_ROUNDS):
            found = self.resolver.key(label)
            if found is not None:
                return found
            self._heal(label)
        raise StepError(f"the store keeps losing what step `{label}` reads")

    def _run_healing(self, node: Node, parts: Parts) -> Made:
        for _ in range(HEALING_ROUNDS):
            try:
                return self._run(node, parts)
            except LostObjectError:
                self.session.forget()
                self._heal(node.label)
        raise StepError(f"the store keeps losing what step `{node.label}` reads")

    def _heal(self, label: str) -> None:
        """Make the nodes again whose outputs the store lost. StepError when they differ now."""
        with self._healing:
            for maker in self.graph.predecessors(label):
                key = self._key(maker)[0]
                if self.resolver.made(maker) is not None:
                    continue
                result = self._make_again(maker)
                self.healed[maker] = result
                if result.error is not None:
                    raise result.error
                if result.key != key:
                    raise StepError(f"step `{maker}` changed while it was made again")
            node = self.graph.nodes[label]
            known = self.resolver.key(label)
            if known is not None and any(
                self.resolver.digest(ref) != dict_of(known[1]["inputs"])[name]
                for name, ref in node.inputs.items()
            ):
                raise StepError(
                    f"a step before `{label}` gave other bytes when it was run again",
                    hint="run the build again; a step must give the same bytes for the same inputs",
                )

    def _make_again(self, label: str) -> NodeResult:
        before = self._mine.__dict__.get("heals", False)
        self._mine.heals = True
        try:
            return self.make(label)
        finally:
            self._mine.heals = before

    # -- running

    def _run(self, node: Node, parts: Parts) -> Made:
        cluster = self.session.cluster
        if cluster is not None and node.step.isolated and not node.step.network:
            made = cluster.run(node, parts, self.session)
            self.session.check_sources(node)
            return made
        folder = self.session.store.scratch()
        log = folder / "log"
        try:
            staged = stage(self.session, dict_of(parts["inputs"]), folder / "inputs")
            (folder / "outputs").mkdir()
            began = time.monotonic()
            if node.step.isolated or self._is_confined(node):
                result, used = self._in_child(node, folder, log)
            else:
                result, trace = perform(node.step, _files(folder), node.label)
                used = Ended(status=0, wall_s=round(time.monotonic() - began, 4))
                if trace:
                    log.write_text(trace, encoding="utf-8", errors="backslashreplace")
            check_untouched(self.session, staged, node.label)
            self.session.check_sources(node)
            if "error" in result:
                check_present(staged)
                raise error_from_json(dict_of(result["error"]))
            outputs = collect(self.session, node, folder / "outputs")
            findings = result["findings"]
            return Made(
                outputs=outputs,
                findings=tuple(finding_from_json(f) for f in _list_of(findings)),
                seconds=used.wall_s,
                cpu_seconds=used.cpu_s,
                child=node.step.isolated,
                attempts=used.attempts,
            )
        finally:
            self._keep_log(log, node.label)
            shutil.rmtree(folder, ignore_errors=True)

    def _in_child(self, node: Node, folder: Path, log: Path) -> tuple[dict[str, object], Ended]:
        home = folder / "home"
        home.mkdir()
        job = {
            "label": node.label,
            "step": step_to_json(node.step),
            "inputs": str(folder / "inputs"),
            "outputs": str(folder / "outputs"),
            "result": str(folder / "result.json"),
            "log": str(log),
            "home": str(home),
            "environ": step_environment(node.step, home),
            "limits": asdict(node.step.limits),
            "sandbox": str(folder) if self._is_confined(node) else "",
        }
        path = folder / "job.json"
        path.write_text(json.dumps(job), encoding="utf-8")
        for attempt in range(1, ATTEMPTS + 1):
            ended = self._children.run(node.step, path)
            self._check_refused(node, folder)
            if ended.status == 0 and not ended.over:
                with suppress(OSError, ValueError):
                    result = json.loads((folder / "result.json").read_bytes())
                    return result, replace(ended, attempts=attempt)
            if attempt == ATTEMPTS or not was_killed_by_chance(ended, log):
                break
            for private in ("outputs", "home"):
                shutil.rmtree(folder / private)
                (folder / private).mkdir()
        raise StepError(how_it_ended(node, ended, log))

    def _is_confined(self, node: Node) -> bool:
        """A step that may use the network runs programs and reads settings of the user's."""
        return self.session.sandbox and not node.step.network

    def _check_refused(self, node: Node, folder: Path) -> None:
        """Whatever became of a step that reads what it does not declare: that is its error."""
        with suppress(FileNotFoundError):
            refused = json.loads((folder / REFUSED).read_bytes())
            more = f", and {len(refused) - 1} more files" if len(refused) > 1 else ""
            raise StepError(
                f"step `{node.label}` reads `{refused[0]}`, which is not among its inputs{more}",
                hint="a step reads its inputs only: this is a fault of the step",
            )

    def _with_log(self, error: AssetBuildError, label: str) -> AssetBuildError:
        log = self.log_path(label)
        if not error.hint and isinstance(error, StepError) and log.is_file():
            error.hint = f"its log: {log}"
        return error

    def _keep_log(self, log: Path, label: str) -> None:
        """The log of the last run stays, outside the private folder; an empty one goes."""
        place = self.log_path(label)
        with suppress(OSError):
            if log.is_file() and log.stat().st_size:
                place.parent.mkdir(exist_ok=True)
                log.replace(place)
            else:
                place.unlink(missing_ok=True)


def was_killed_by_chance(ended: Ended, log: Path) -> bool:
    """Did a signal end the process that none of our limits sent? Then it may go well again."""
    if ended.over or ended.status is None or not os.WIFSIGNALED(ended.status):
        return False
    if os.WTERMSIG(ended.status) in (signal.SIGXCPU, signal.SIGXFSZ):
        return False
    return not _tells_of_memory(_tail(log))


def _tells_of_memory(text: str) -> bool:
    return any(word in text for word in ("bad_alloc", "MemoryError", "annot allocate memory"))


def how_it_ended(node: Node, ended: Ended, log: Path) -> str:
    """The sentence for a child process that did not end well."""
    name, limits = f"step `{node.label}`", node.step.limits
    if ended.over == "wall":
        return f"{name} ran over its time limit of {limits.wall_s:g} s and was stopped"
    if ended.over == "worker" or ended.status is None:
        last = f"; last line: {ended.log}" if ended.log else ""
        loads = f" while it loads {', '.join(node.step.preload)}" if node.step.preload else ""
        return f"the process that runs {name} died{loads}{last or '; ' + ended.over}"
    if os.WIFSIGNALED(ended.status):
        number = os.WTERMSIG(ended.status)
        if number == signal.SIGXCPU:
            allowed = limits.wall_s * max(1, limits.cpus)
            return f"{name} used more than {allowed:g} s of processor time and was stopped"
        tail = _tail(log)
        if _tells_of_memory(tail):
            return f"{name} ran over its memory limit of {limits.memory_mb} MB"
        told = f": {tail}" if tail else ""
        if number == signal.SIGKILL:
            told = " (by this machine, when memory runs out, or by hand)" + told
        return f"{name} crashed with {signal.Signals(number).name}{told}"
    status = os.waitstatus_to_exitcode(ended.status)
    if status == NO_SPACE:
        return f"no space left on the disk of the store while {name} ran"
    return f"{name} ended without a result (exit status {status})"


def _tail(log: Path) -> str:
    with suppress(OSError):
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1].strip()[:300] if lines else ""
    return ""


def _cached(label: str, key: str, made: Made) -> NodeResult:
    return NodeResult(
        label=label,
        status="cached",
        key=key,
        outputs=dict(made.outputs),
        findings=made.findings,
        saved_seconds=made.seconds,
        child=made.child,
    )


def _files(folder: Path) -> Files:
    return Files(inputs=folder / "inputs", outputs=folder / "outputs")


def _existing(path: Path) -> Path | None:
    return path if path.is_file() else None


def _short(text: str) -> str:
    return digest_bytes(text.encode())[:6]


def dict_of(value: object) -> dict[str, str]:
    """JSON data that is an object."""
    if not isinstance(value, dict):
        raise TypeError("not an object")
    return value


def _list_of(value: object) -> list[dict[str, object]]:
    if not isinstance(value, list):
        raise TypeError("not a list")
    return value
