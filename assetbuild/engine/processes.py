"""Steps that run on this machine, each in a child process between two folders."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Self

from assetbuild.engine.actions import Action, Made
from assetbuild.engine.children import Children
from assetbuild.engine.digest import Signature, signature_of
from assetbuild.engine.doors import Ended, last_line
from assetbuild.engine.session import Session
from assetbuild.engine.step import Files, Step
from assetbuild.engine.store import (
    Listing,
    LostObjectError,
    below,
    files_below,
    machine_errors,
)
from assetbuild.engine.wire import error_from_json, perform, step_to_json
from assetbuild.engine.worker import NO_SPACE
from assetbuild.errors import StepError, quoted
from assetbuild.findings import finding_from_json

PRIVATE = ("inputs", "outputs", "views", "home")
"""Folders in the private folder of a step. views: of folders that it reads, where it is alone."""

ATTEMPTS = 2
"""How often a step is run whose process is killed by something else than our limits."""


class Processes:
    """Runs actions here, from many threads; a context manager that ends what still runs."""

    def __init__(self, session: Session, *, long_lived: bool = False) -> None:
        """long_lived: nothing of a step stays when it has ended."""
        self._session = session
        self._long_lived = long_lived
        self._children = Children(session.store.scratch())
        self._emptied: list[Path] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Kill all that runs; nothing is started any more."""
        self._children.close()

    def rest(self) -> None:
        """No step comes for now."""
        self._children.rest()

    @property
    def closed(self) -> bool:
        """Is nothing started any more?"""
        return self._children.closed

    @property
    def places(self) -> int:
        """Steps that may run at once."""
        return usable_cores()

    @property
    def memory_mb(self) -> int:
        """Memory that this process and its children may still take."""
        free_mb = [_available_mb()]
        group = Path("/sys/fs/cgroup")
        with suppress(OSError, ValueError):  # no control group, or `max`: no limit
            limit, used = ((group / f"memory.{n}").read_text() for n in ("max", "current"))
            free_mb.append((int(limit) - int(used)) >> 20)
        return max(1, min(free_mb))

    def prepare(self, step: Step) -> None:
        """Such a step comes next: its worker may begin to import."""
        if not step.in_parent:
            self._children.prepare(step)

    def run(self, action: Action) -> Made:
        """Run a step; its outputs are in the store afterwards. AssetBuildError.

        LostObjectError when the store lost one of its inputs.
        """
        try:
            with machine_errors(self._session.store.root.parent), self._folder(action) as folder:
                return self._run(action, folder)
        except StepError as error:
            log = self._session.journal.log_path(action.label)
            if not error.hint and log.is_file():
                error.hint = f"its log: {log}"
            raise

    @contextmanager
    def _folder(self, action: Action) -> Iterator[Path]:
        """A private folder; the log in it stays, in place of that of the step's last run.

        After a step that went well it is emptied for another one: some file systems take longer
        to make what is in it than small steps run.
        """
        folder = self._next_folder()
        went_well = False
        try:
            yield folder
            went_well = True
        finally:
            log, place = folder / "log", self._session.journal.log_path(action.label)
            with suppress(OSError):
                if log.is_file() and log.stat().st_size:
                    place.parent.mkdir(exist_ok=True)
                    log.replace(place)
                else:
                    place.unlink(missing_ok=True)
            if went_well and all(clear(folder / name) for name in PRIVATE):
                self._emptied.append(folder)
            else:
                shutil.rmtree(folder, ignore_errors=True)

    def _next_folder(self) -> Path:
        if self._emptied:  # renamed: steps of one process must not meet the same path again
            folder = self._emptied.pop()
            return folder.rename(folder.with_name(secrets.token_hex(6)))
        folder = self._session.store.scratch()
        for name in PRIVATE:
            (folder / name).mkdir()
        return folder

    def _run(self, action: Action, folder: Path) -> Made:
        alone = self._long_lived
        staged = stage(self._session, action.inputs, folder / "inputs", alone=alone)
        began = time.monotonic()
        if not action.step.in_parent:
            result, used = self._in_child(action, folder)
        else:
            files = Files(inputs=folder / "inputs", outputs=folder / "outputs")
            result, trace = perform(lambda: action.step, files, action.label, action.step.limits)
            used = Ended(status=0, wall_s=round(time.monotonic() - began, 4))
            if trace:
                (folder / "log").write_text(trace, encoding="utf-8", errors="backslashreplace")
        check_untouched(self._session, staged, action.label)
        self._session.code.check(type(action.step))
        if "error" in result:
            check_present(staged)
            raise error_from_json(result["error"])
        return Made(
            outputs=collect(self._session, action, folder),
            findings=tuple(map(finding_from_json, result["findings"])),
            seconds=used.wall_s,
            cpu_seconds=used.cpu_s,
            child=not action.step.in_parent,
            attempts=used.attempts,
        )

    def _in_child(self, action: Action, folder: Path) -> tuple[dict[str, Any], Ended]:  # Any: JSON
        step, home, log = action.step, folder / "home", folder / "log"
        variables = ("TMPDIR",) if step.network else ("TMPDIR", "HOME")
        job = {
            "label": action.label,
            "step": step_to_json(step),
            "inputs": str(folder / "inputs"),
            "outputs": str(folder / "outputs"),
            "result": str(folder / "result.json"),
            "log": str(log),
            "home": str(home),
            "environ": dict.fromkeys(variables, str(home)),
            "limits": asdict(step.limits),
            "shares": step.may_share(),
        }
        path = folder / "job.json"
        path.write_text(json.dumps(job), encoding="utf-8")
        for attempt in range(1, ATTEMPTS + 1):
            (folder / "result.json").write_bytes(b"")  # of the step before
            ended = self._children.run(step, path)
            if ended.status == 0 and not ended.over:
                with suppress(OSError, ValueError):
                    result = json.loads((folder / "result.json").read_bytes())
                    return result, replace(ended, attempts=attempt)
            if attempt == ATTEMPTS or not was_killed_by_chance(ended, log):
                break
            if not all(clear(folder / name) for name in ("outputs", "home")):
                break
        raise StepError(how_it_ended(action, ended, log))


def clear(folder: Path) -> bool:
    """Remove all that lies in a folder; False where that is not possible, or it is no folder."""
    try:
        if folder.is_symlink():
            return False
        for entry in os.scandir(folder):
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path)
            else:
                os.unlink(entry.path)  # noqa: PTH108 # of the entry
    except OSError:
        return False
    return True


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0)) or 1
    return os.cpu_count() or 1


def _available_mb() -> int:
    with suppress(OSError, StopIteration):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return int(next(x for x in lines if x.startswith("MemAvailable")).split()[1]) >> 10
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") >> 20


def was_killed_by_chance(ended: Ended, log: Path) -> bool:
    """Did a signal end the process that none of our limits sent? Then it may go well again."""
    if ended.over or ended.status is None or not os.WIFSIGNALED(ended.status):
        return False
    if os.WTERMSIG(ended.status) in (signal.SIGXCPU, signal.SIGXFSZ):
        return False
    return not _is_about_memory(last_line(log))


def _is_about_memory(text: str) -> bool:
    return any(word in text for word in ("bad_alloc", "MemoryError", "annot allocate memory"))


def how_it_ended(action: Action, ended: Ended, log: Path) -> str:
    """The sentence for a child process that did not end well."""
    name, limits = f"step `{action.label}`", action.step.limits
    if ended.over == "wall":
        return f"{name} ran over its time limit of {limits.wall_s:g} s and was stopped"
    if ended.over == "worker" or ended.status is None:
        last = f"; last line: {ended.log}" if ended.log else ""
        modules = action.step.modules()
        loads = f" while it loads {', '.join(modules)}" if modules else ""
        return f"the process that runs {name} died{loads}{last or '; ' + ended.over}"
    if os.WIFSIGNALED(ended.status):
        number = os.WTERMSIG(ended.status)
        if number == signal.SIGXCPU:
            allowed = limits.wall_s * max(1, limits.cpus)
            return f"{name} used more than {allowed:g} s of processor time and was stopped"
        tail = last_line(log)
        if _is_about_memory(tail):
            return f"{name} ran over its memory limit of {limits.memory_mb} MB"
        details = f": {tail}" if tail else ""
        if number == signal.SIGKILL:
            details = " (by this machine, when memory runs out, or by hand)" + details
        return f"{name} crashed with {signal.Signals(number).name}{details}"
    status = os.waitstatus_to_exitcode(ended.status)
    if status == NO_SPACE:
        return f"no space left on the disk of the store while {name} ran"
    return f"{name} ended without a result (exit status {status})"


Staged = dict[str, tuple[str, Path, Signature]]
"""What a step may read, by its path below the folder -> (digest, file or folder, signature)."""


def stage(
    session: Session, inputs: Mapping[str, str], folder: Path, *, alone: bool = False
) -> Staged:
    """Lay out inputs (name -> digest) as links to verified objects; `folder` is empty, or made.

    All steps of a session that read a tree share one folder of links, unless they are `alone`, and
    none may write there.
    LostObjectError when the store lost an object; SourceError when a source was edited meanwhile.
    """
    folder.mkdir(exist_ok=True)
    staged: Staged = {}
    for name, digest in inputs.items():
        place, is_tree = folder / name, name.endswith("/")
        own = folder.with_name("views") / str(len(staged)) if alone else None
        path = session.view(digest, own) if is_tree else session.object(digest)
        staged[name] = digest, path, signature_of(path.stat())
        if place.parent != folder:
            place.parent.mkdir(parents=True, exist_ok=True)
        place.symlink_to(path)
        for member, (part, _) in session.tree(digest).items() if is_tree else ():
            path = session.object(part)
            staged[name + member] = part, path, signature_of(path.stat())
    return staged


def check_untouched(session: Session, staged: Staged, label: str) -> None:
    """StepError when the step wrote to an input; a changed object leaves the store."""
    for name, (digest, path, signature) in staged.items():
        try:
            same = signature_of(path.stat()) == signature
        except OSError:
            continue  # another build set a corrupt object aside
        if same:
            continue
        size = path.stat().st_size if path.is_file() else 0
        with suppress(LostObjectError):
            if path.is_file() and session.store.path(digest):
                continue  # another step made the same again
        session.forget()
        raise StepError(
            f"step `{label}` wrote to its input `{name}` ({size} bytes now)",
            hint="a step reads its inputs and writes its outputs only",
        )


def check_present(staged: Staged) -> None:
    """LostObjectError when an input went away while the step ran: it is made again."""
    for name, (digest, path, _) in staged.items():
        if not path.exists():
            raise LostObjectError(digest, f"input `{name}` went away while its step ran")


def collect(session: Session, action: Action, folder: Path) -> dict[str, str]:
    """Take the declared outputs into the store: name -> digest.

    A link to an input, or to the folder of one, stands for what that holds; nothing is copied.
    StepError names what was declared and not written, or written and not declared.
    """
    linked, folder = _linked(session, action, folder), folder / "outputs"
    declared = action.step.outputs
    try:
        written = [path.relative_to(folder).as_posix() for path in files_below(folder)]
    except ValueError as error:
        raise StepError(f"step `{action.label}`: output {error}") from None
    trees = tuple(name for name in declared if name.endswith("/"))
    made = (*written, *linked)
    extra = [name for name in made if name not in declared and not name.startswith(trees)]
    if extra:
        raise StepError(
            f"step `{action.label}` wrote what it does not declare: {quoted(extra, 8)}",
            hint=f"its `outputs` are {quoted(declared, 8) or 'empty'}",
        )
    absent = [
        name
        for name in declared
        if not ((folder / name).is_dir() if name.endswith("/") else name in made)
    ]
    if absent:
        raise StepError(f"step `{action.label}` did not write its output {quoted(absent, 8)}")
    for name in written:
        if any("\ud800" <= letter <= "\udfff" for letter in name):  # undecodable bytes
            raise StepError(f"step `{action.label}` wrote a file whose name is not UTF-8: {name!a}")
    digests = {name: linked[name][0] for name in declared if name in linked}
    for name in declared:
        if name.endswith("/"):
            digests[name] = session.store.put_tree(folder / name, below(linked, name))
        elif name not in digests:
            digests[name] = session.store.put_file(folder / name, move=True)
    return digests


def _linked(session: Session, action: Action, folder: Path) -> Listing:
    """What links in the outputs to inputs, files or folders of them, stand for; the links go."""
    links = [path for path in (folder / "outputs").rglob("*") if path.is_symlink()]
    read: Listing = {}
    for name, digest in action.inputs.items() if links else ():
        if name.endswith("/"):
            read |= {name + member: held for member, held in session.tree(digest).items()}
        else:
            read[name] = (digest, session.object(digest).stat().st_size)
    listing: Listing = {}
    inputs = f"{folder / 'inputs'}/"
    for path in links:
        target = os.readlink(path)  # noqa: PTH115 # the text is compared
        name = target.removeprefix(inputs) if target.startswith(inputs) else ""
        place = path.relative_to(folder / "outputs").as_posix()
        if name in read:
            path.unlink()
            listing[place] = read[name]
        elif inside := below(read, f"{name}/"):
            path.unlink()
            path.mkdir()
            listing |= {f"{place}/{member}": held for member, held in inside.items()}
    return listing
