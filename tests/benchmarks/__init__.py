"""Programs that measure; what they print stands on pages of docs/."""

from __future__ import annotations

import subprocess
import sys


def assetbuild(*words: object) -> str:
    """`assetbuild WORDS...`; its output."""
    command = [sys.executable, "-m", "assetbuild", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr[-3000:])
    return done.stdout
