"""Templates that were compiled before, kept where Python keeps the bytecode of what lies there."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

import jinja2
from jinja2.bccache import Bucket, BytecodeCache

from assetbuild.engine.digest import digest_bytes, digest_file, replace_file

DIGEST = 64
"""Characters at the begin of a file: the digest of the others."""


class Compiled(BytecodeCache):
    """One file for each template; jinja2 knows by its text whether it is the same template.

    settings: the module that makes the environment, which decides as well what a template becomes.
    """

    def __init__(self, folder: Path, settings: Path) -> None:
        self.folder = folder
        self.settings = digest_bytes(f"{jinja2.__version__} {digest_file(settings)}".encode())

    def load_bytecode(self, bucket: Bucket) -> None:
        """What an earlier process made of the template, if it is whole."""
        with suppress(OSError):
            data = self._file(bucket).read_bytes()
            digest, code = data[:DIGEST], data[DIGEST:]
            if digest == digest_bytes(code).encode():
                bucket.bytecode_from_string(code)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep it, unless Python keeps no bytecode here."""
        if sys.dont_write_bytecode or not os.access(self.folder.parent, os.W_OK):
            return
        code = bucket.bytecode_to_string()
        with suppress(OSError):
            replace_file(self._file(bucket), digest_bytes(code).encode() + code)

    def _file(self, bucket: Bucket) -> Path:
        name = digest_bytes(f"{self.settings} {bucket.key}".encode())[:16]
        return self.folder / f"{sys.implementation.cache_tag}-{name}.jinja"
