"""An archive from the network, pinned to the byte: a wheel, a commit, a file of a web server.

Only these steps use the network. A wheel comes through pip, from the user's package index. git runs
as a child process without the user's configuration: no hooks, no submodules, no filters, no
password prompt, and the local file protocol only for repositories that are local.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import tarfile
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from assetbuild.engine.digest import digest_file
from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import (
    AssetBuildError,
    LockError,
    MachineError,
    SourceError,
    did_you_mean,
)
from assetbuild.findings import Finding


class Download(Step):
    """The steps below bring `archive` here and compare it with a pinned digest."""

    usual_s = 10.0
    outputs = ("archive",)
    network = True
    in_parent = True
    limits = Limits(wall_s=3600)

    sha256: str
    """64 hex digits."""


# --- a wheel --------------------------------------------------------------------------------

OnLine = Callable[[str], None]

_PIP_DEFAULTS = {"PIP_RETRIES": "2", "PIP_TIMEOUT": "15"}
"""Only where the user says nothing: without a network an answer should come soon."""
_PIP_FORCED = {
    "PIP_DISABLE_PIP_VERSION_CHECK": "1",
    "PIP_NO_INPUT": "1",
    "PIP_NO_COLOR": "1",
    "PYTHONUNBUFFERED": "1",
    "PYTHONIOENCODING": "utf-8",
}
_UNREACHABLE = re.compile(
    "name resolution|NameResolution|not known|new ?connection|timeout|unreachable|ProxyError"
    "|refused|connection error",
    re.IGNORECASE,
)


class Fetch(Download):
    """`archive`: the wheel `filename` of `name==release`, with the digest that the lock pins."""

    name: str
    """Distribution on the index."""
    release: str
    """Its version; `version` is the step's own."""
    filename: str
    """Name of the wheel."""

    def run(self, files: Files) -> Iterator[Finding]:
        """LockError: other bytes; SourceError: no such wheel; MachineError: no index in reach."""
        # Beside the result, so that moving the file is a rename.
        with TemporaryDirectory(prefix=".fetch-", dir=files.outputs) as folder:
            wheel = downloaded_wheel(self.name, self.release, Path(folder))
            if wheel.name != self.filename:
                raise LockError(
                    f"{self.name}=={self.release}: the index gives `{wheel.name}`, "
                    f"the lock pins `{self.filename}`",
                    hint="run `assetbuild lock` if the change is wanted",
                )
            digest = digest_file(wheel)
            if digest != self.sha256:
                raise LockError(
                    f"{self.filename}: sha256 is {digest}, the lock pins {self.sha256}",
                    hint="the index gives other bytes than when the lock was written; "
                    "run `assetbuild lock` only if you trust the change",
                )
            wheel.replace(files.outputs / "archive")
        yield from ()


def downloaded_wheel(name: str, version: str, folder: Path, on_line: OnLine | None = None) -> Path:
    """The wheel that the user's pip chooses, in `folder`."""
    wanted = f"{name}=={version}"
    command = [sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary=:all:"]
    command += ["--progress-bar=off", "--dest", str(folder), "--", wanted]
    # The user's environment, so that index, proxy and certificate settings hold.
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    code, lines = _run(command, _PIP_DEFAULTS | kept | _PIP_FORCED, on_line)
    if code != 0:
        raise _pip_trouble(wanted, lines)
    wheels = sorted(folder.glob("*.whl"))
    if len(wheels) != 1:
        raise MachineError(f"{wanted}: pip left {len(wheels)} wheels instead of one")
    return wheels[0]


def _run(
    command: list[str], environment: dict[str, str], on_line: OnLine | None
) -> tuple[int, list[str]]:
    """Exit code and lines of a child process; it dies with us when we are interrupted."""
    lines = []
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=environment,
        encoding="utf-8",
        errors="replace",
    ) as child:
        try:
            for line in child.stdout or ():
                if text := line.strip():
                    lines.append(text)
                    if on_line is not None:
                        on_line(text)
        except BaseException:
            child.kill()
            raise
    return child.returncode, lines


def _pip_trouble(wanted: str, lines: list[str]) -> AssetBuildError:
    """One sentence for a failed pip, by who must act."""
    text = "\n".join(lines)
    if "No module named pip" in text:
        return MachineError(
            "pip is not installed beside assetbuild",
            hint="install it with `uv pip install pip` or `python -m ensurepip`",
        )
    if "No space left on device" in text:
        return MachineError(f"{wanted}: no space left on the disk for the download")
    if _UNREACHABLE.search(text):
        # The innermost reason, as in `NewConnectionError("HTTPConnection(...): REASON")`.
        reasons = re.findall(r"[>)]: ([^'\"]+)['\"]", text)
        trouble = f": {reasons[-1].strip()[:200]}" if reasons else ""
        return MachineError(
            f"{wanted}: no package index could be reached{trouble}",
            hint="check the network, `pip config list` and the PIP_* variables",
        )
    if "No matching distribution found" in text or "Could not find a version" in text:
        listed = re.search(r"from versions: ([^)]*)\)", text)
        versions = (
            [v.strip() for v in listed[1].split(",") if v.strip() != "none"] if listed else []
        )
        hint = "check the name and `pip config list`; only wheels for this Python are taken"
        near = did_you_mean(wanted.partition("==")[2], versions) if any(versions) else hint
        return SourceError(f"no wheel of {wanted} on the index", hint=near)
    errors = [line.removeprefix("ERROR:").strip() for line in lines if line.startswith("ERROR:")]
    last = [*errors, *lines[-1:], "pip printed nothing"][0]
    return MachineError(f"{wanted}: pip failed: {last[:200]}")


# --- a commit -------------------------------------------------------------------------------

GIT_SECONDS = 1800.0
COMMIT = re.compile(r"[0-9a-f]{40}")
_GIT_SETTINGS = (
    "-c", "core.hooksPath=/dev/null", "-c", "protocol.allow=never",
    "-c", "fetch.recurseSubmodules=false", "-c", "submodule.recurse=false",
    "-c", "credential.helper=", "-c", "core.fsmonitor=false", "-c", "gc.auto=0",
    "-c", "tar.umask=0022",
)  # fmt: skip
_GIT_VARIABLES = {
    "GIT_CONFIG_NOSYSTEM": "1",
    "GIT_CONFIG_GLOBAL": os.devnull,
    "GIT_TERMINAL_PROMPT": "0",
    "GIT_LFS_SKIP_SMUDGE": "1",
    "GIT_SSH_COMMAND": "ssh -o BatchMode=yes",
    "LC_ALL": "C",
}
"""Beside the user's variables, which proxies and keys need: no configuration but ours."""


class FetchGit(Download):
    """`archive`: the files of `commit` as a tar, whose `tree_digest` the lock pins.

    SourceError: no such repository or commit; LockError: other content; MachineError: no git.
    """

    own_name = "fetch_git"

    url: str
    """http(s), ssh, or the absolute path of a local repository."""
    commit: str
    """40 hex digits."""

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
    command = ["git", *_GIT_SETTINGS, *protocols, *words]
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env={k: v for k, v in os.environ.items() if not k.startswith("GIT_")} | _GIT_VARIABLES,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=GIT_SECONDS,
            encoding="utf-8",
            errors="replace",
        )
    except FileNotFoundError:
        raise MachineError("git is not installed", hint="install git") from None
    except subprocess.TimeoutExpired:
        raise MachineError(f"{url}: git took more than {GIT_SECONDS:g} s") from None
    if done.returncode == 0:
        return done.stdout
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    text = next((s for s in lines if s.startswith(("fatal:", "error:"))), "; ".join(lines[:2]))
    short = text.removeprefix("fatal: ").removeprefix("error: ")[:200]
    if "Could not resolve host" in text or "unable to access" in text or "Connection" in text:
        raise MachineError(f"{url}: cannot be reached: {short}", hint="check the network")
    raise SourceError(f"{url}: git says: {short}", hint="check `source.git` and `source.rev`")


# --- a file of a web server -----------------------------------------------------------------

MAX_BYTES = 2 << 30
TIMEOUT_S = 60.0
"""Limit of each wait for the server, not of the whole download."""
_CHUNK = 1 << 20


class FetchUrl(Download):
    """`archive`: what lies at `url`, when it has the digest `sha256`.

    Proxies and certificates are the user's; no password is sent. SourceError: not there, too
    large, other bytes; MachineError: no server in reach.
    """

    own_name = "fetch_url"

    url: str
    """http or https."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Download and compare."""
        from http.client import HTTPException
        from urllib.error import HTTPError

        target = files.outputs / "archive"
        try:
            with _open(self.url) as answer:
                digest = _save(answer, target, self.url)
        except HTTPError as error:
            raise SourceError(f"{self.url}: the server says {error.code} {error.reason}") from None
        except (OSError, HTTPException, ValueError) as error:
            reason = getattr(error, "reason", None) or error
            raise MachineError(
                f"{self.url}: cannot be reached: {reason}", hint="check the network and the proxy"
            ) from None
        if digest != self.sha256:
            target.unlink()
            raise SourceError(
                f"{self.url}: sha256 is {digest}, the recipe says {self.sha256}",
                hint="the file has changed; change `source.sha256` only if you trust it",
            )
        yield from ()


def _open(url: str) -> Any:  # Any: an HTTPResponse, which urllib types as object
    """The answer; a server may send us on to another web address, and to nothing else."""
    from urllib.request import HTTPRedirectHandler, Request, build_opener

    class WebOnly(HTTPRedirectHandler):
        def redirect_request(
            self, req: Request, fp: Any, code: int, msg: str, headers: Any, newurl: str
        ) -> Request | None:  # Any: as urllib's own
            if not newurl.startswith(("https://", "http://")):
                raise SourceError(f"{req.full_url}: the server sends us on to `{newurl[:200]}`")
            return super().redirect_request(req, fp, code, msg, headers, newurl)

    return build_opener(WebOnly).open(url, timeout=TIMEOUT_S)


def _save(answer: Any, target: Path, url: str) -> str:  # Any: as above
    digest, size = hashlib.sha256(), 0
    with target.open("wb") as file:
        while chunk := answer.read(_CHUNK):
            size += len(chunk)
            if size > MAX_BYTES:
                raise SourceError(f"{url}: larger than {MAX_BYTES >> 20} MB")
            digest.update(chunk)
            file.write(chunk)
    return digest.hexdigest()
