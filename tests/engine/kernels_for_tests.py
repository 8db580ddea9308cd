"""A step that computes with whatever kernels the libraries choose in its process."""

from __future__ import annotations

import ctypes
import hashlib
import json
import math
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding

CORENAMES = ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename")


class Kernels(Step):
    """Writes what was chosen, and digests of numbers that another choice changes."""

    outputs = ("chosen.json", "numbers.json")
    preload: ClassVar[tuple[str, ...]] = ("numpy", "scipy.linalg")

    def run(self, files: Files) -> Iterable[Finding]:
        (files.outputs / "chosen.json").write_text(json.dumps(chosen()))
        (files.outputs / "numbers.json").write_text(json.dumps(numbers()))
        return ()


def chosen() -> dict[str, object]:
    """The kernels of each OpenBLAS that is loaded, and numpy's dispatched features."""
    import numpy._core._multiarray_umath as umath

    lines = Path("/proc/self/maps").read_text().splitlines()
    found = {}
    for path in {line.split()[-1] for line in lines if "openblas" in line}:
        library = ctypes.CDLL(path)
        for name in CORENAMES:
            corename = getattr(library, name, None)
            if corename is not None:
                corename.restype = ctypes.c_char_p
                found[Path(path).name] = corename().decode()
                break
    has = umath.__cpu_features__
    return {"blas": found, "numpy": [name for name in umath.__cpu_dispatch__ if has[name]]}


def numbers() -> dict[str, str]:
    """BLAS, numpy's own loops and libm on the same numbers each time."""
    import numpy as np
    import scipy.linalg

    random = np.random.RandomState(0)
    a, b, x = random.rand(97, 63), random.rand(63, 41), random.rand(10_007) * 20 - 10
    square = a.T @ a
    libm = [f(v) for v in x.tolist() for f in (math.sin, math.exp, math.atan)]
    return {
        "product": digest(a @ b),
        "eigenvalues": digest(np.linalg.eigvalsh(square)),
        "solution": digest(scipy.linalg.lstsq(a, np.ones(97))[0]),
        "exp": digest(np.exp(x)),
        "power": digest(np.abs(x) ** 1.3),
        "sine": digest(np.sin(x)),
        "libm": digest(struct.pack(f"{len(libm)}d", *libm)),
    }


def digest(data: object) -> str:
    import numpy as np

    raw = data if isinstance(data, bytes) else np.ascontiguousarray(data).tobytes()
    return hashlib.sha256(raw).hexdigest()[:12]
