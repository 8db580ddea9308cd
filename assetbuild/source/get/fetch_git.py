"""One commit of a git repository as a tar, pinned to the byte.

git runs as a child process without the user's configuration: no hooks, no submodules, no filters,
no password prompt, and the local file protocol only for repositories that are local.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import tarfile
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import LockError, MachineError, SourceError, did_you_mean
from assetbuild.findings import Finding

SECONDS = 1800.0
COMMIT = re.compile(r"[0-9a-f]{40}")
_NO_SURPRISES = (
    "-c", "core.hooksPath=/dev/null", "-c", "protocol.allow=never",
    "-c", "fetch.recurseSubmodules=false", "-c", "submodule.recurse=false",
    "-c", "credential.helper=", "-c", "core.fsmonitor=false", "-c", "gc.auto=0",
    "-c", "tar.umask=0022",
)  # fmt: skip
_OURS = {
    "GIT_CONFIG_NOSYSTEM": "1",
    "GIT_CONFIG_GLOBAL": os.devnull,
    "GIT_TERMINAL_PROMPT": "0",
    "GIT_LFS_SKIP_SMUDGE": "1",
    "GIT_SSH_COMMAND": "ssh -o BatchMode=yes",
    "LC_ALL": "C",
}
"""Beside the user's variables, which proxies and keys need: no configuration but ours."""


class FetchGit(Step):
    """`archive`: the files of `commit` as a tar, with the digest that the lock pins.

    SourceError: no such repository or commit; LockError: other content; MachineError: no git.
    """

    usual_s = 10.0
    outputs = ("archive",)
    network = True
    in_parent = True
    limits: ClassVar[Limits] = Limits(wall_s=3600)

    url: str
    """http(s), ssh, or the absolute path of a local repository."""
    commit: str
    """40 hex digits."""
    sha256: str
    """What `tree_digest` must return for the fetched tree."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Fetch, export, compare."""
        target = files.outputs / "archive"
        with TemporaryDirectory(prefix=".git-", dir=files.outputs) as folder:
            export_commit(self.url, self.commit, Path(folder), target)
        digest = tree_digest(target)
        if digest != self.sha256:
            raise LockError(
                f"{self.url}: commit {self.commit} has the digest {digest}, "
                f"the lock pins {self.sha256}",
                hint="run `assetbuild lock` only if you trust the change",
            )
        yield from ()


def tree_digest(archive: Path) -> str:
    """sha256 of the canonical list of paths, kinds and contents: no times, owners or tar details.

    Links count by where they point.
    """
    rows: list[list[str]] = []
    with tarfile.open(archive, "r:") as tar:
        for member in tar:
            if member.isreg():
                stream = tar.extractfile(member)
                data = stream.read() if stream else b""
                rows.append([member.name, "file", hashlib.sha256(data).hexdigest()])
            elif member.issym():
                rows.append([member.name, "link", member.linkname])
    text = json.dumps(sorted(rows), separators=(",", ":"))
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def commit_of(url: str, rev: str, folder: Path) -> str:
    """A tag (what it points to), else a branch."""
    lines = _git(["ls-remote", "--", url], folder, url).splitlines()
    refs = {name: commit for commit, _, name in (line.partition("\t") for line in lines)}
    wanted = (f"refs/tags/{rev}^{{}}", f"refs/tags/{rev}", f"refs/heads/{rev}", rev)
    for name in wanted:
        if name in refs:
            return refs[name]
    names = [n.split("/", 2)[2] for n in refs if n.count("/") >= 2 and not n.endswith("^{}")]
    raise SourceError(
        f"{url}: no branch or tag `{rev}`",
        hint=did_you_mean(rev, names) + "; a commit is given by its 40 digits",
    )


def export_commit(url: str, commit: str, folder: Path, target: Path) -> None:
    """The files of one commit as a tar at `target`; `folder` takes the repository."""
    _git(["init", "--quiet", "--bare", "."], folder, url)
    fetch = ["fetch", "--quiet", "--no-tags", "--no-write-fetch-head"]
    try:
        _git([*fetch, "--depth=1", "--", url, commit], folder, url)
    except SourceError:  # a server that hands out branches and tags only
        _git([*fetch, "--", url, "+refs/heads/*:refs/heads/*", "+refs/tags/*:refs/tags/*"],
             folder, url)  # fmt: skip
    _git(["archive", "--format=tar", f"--output={target}", commit], folder, url)


def _git(words: list[str], folder: Path, url: str) -> str:
    allowed = ("file",) if os.path.isabs(url) else ("http", "https", "ssh")  # noqa: PTH117
    protocols = [word for name in allowed for word in ("-c", f"protocol.{name}.allow=always")]
    command = ["git", *_NO_SURPRISES, *protocols, *words]
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env={k: v for k, v in os.environ.items() if not k.startswith("GIT_")} | _OURS,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=SECONDS,
            encoding="utf-8",
            errors="replace",
        )
    except FileNotFoundError:
        raise MachineError("git is not installed", hint="install git") from None
    except subprocess.TimeoutExpired:
        raise MachineError(f"{url}: git took more than {SECONDS:g} s") from None
    if done.returncode == 0:
        return done.stdout
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    raise _reason(url, lines)


def _reason(url: str, lines: list[str]) -> MachineError | SourceError:
    text = next((s for s in lines if s.startswith(("fatal:", "error:"))), "; ".join(lines[:2]))
    short = text.removeprefix("fatal: ").removeprefix("error: ")[:200]
    if "Could not resolve host" in text or "unable to access" in text or "Connection" in text:
        return MachineError(f"{url}: cannot be reached: {short}", hint="check the network")
    return SourceError(f"{url}: git says: {short}", hint="check `source.git` and `source.rev`")
