"""Templates that were compiled before, kept where Python keeps the bytecode of what lies there."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

import jinja2
from jinja2.bccache import Bucket, FileSystemBytecodeCache

from assetbuild.engine.digest import digest_bytes, digest_file


class Compiled(FileSystemBytecodeCache):
    """jinja2's own cache, but that no file of it and no full disk can end a build.

    settings: the module that makes the environment, which decides as well what a template becomes.
    """

    def __init__(self, folder: Path, settings: Path) -> None:
        makes = digest_bytes(f"{jinja2.__version__} {digest_file(settings)}".encode())[:16]
        super().__init__(str(folder), f"{sys.implementation.cache_tag}-{makes}-%s.jinja")

    def load_bytecode(self, bucket: Bucket) -> None:
        """What an earlier process made of the template; a torn file is none."""
        try:
            super().load_bytecode(bucket)
        except Exception:  # of `pickle`, which raises what it likes
            bucket.reset()

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep it, unless Python keeps no bytecode here."""
        folder = Path(self.directory)
        if not sys.dont_write_bytecode and os.access(folder.parent, os.W_OK):
            with suppress(OSError):
                folder.mkdir(exist_ok=True)
                super().dump_bytecode(bucket)
