"""One file from a web server, to the byte that the recipe names."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import MachineError, SourceError
from assetbuild.findings import Finding

MAX_BYTES = 2 << 30
TIMEOUT_S = 60.0
"""Limit of each wait for the server, not of the whole download."""
_CHUNK = 1 << 20


class FetchUrl(Step):
    """`archive`: what lies at `url`, when it has the digest `sha256`.

    Proxies and certificates are the user's; no password is sent. SourceError: not there, too
    large, other bytes; MachineError: no server in reach.
    """

    usual_s = 10.0
    outputs = ("archive",)
    network = True
    in_parent = True
    limits: ClassVar[Limits] = Limits(wall_s=3600)

    url: str
    """http or https."""
    sha256: str
    """64 hex digits."""

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
