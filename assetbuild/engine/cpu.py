"""The CPU's class, and the environment under which all CPUs of one class compute the same bytes.

Libraries choose kernels by what the CPU can do, and kernels add in another order or fuse a
multiplication with an addition, so the last bits differ. docs/explanation/determinism.md lists
every library, what in it depends on the CPU, and how that is pinned.
"""

from __future__ import annotations

import functools
import platform
import sys
from dataclasses import dataclass

from assetbuild.engine.machine import cpuinfo, libc


@dataclass(frozen=True)
class CpuClass:
    """CPUs that compute the same bytes under `environment`.

    flags: what /proc/cpuinfo must list. environment: of a process, before its first import.
    """

    name: str
    flags: frozenset[str]
    environment: dict[str, str]


PLAIN_LIBM = ",".join(
    f"-{name}{end}" for name in ("AVX2", "FMA", "FMA4") for end in ("", "_Usable")
)
"""glibc's names of what its libm looks for, the older ones too; unknown names are ignored."""
OLD_SSE = "SSSE3 SSE41 POPCNT SSE42"
"""NumPy's names before 2.4; names that its build does not know are ignored."""

X86_CLASSES = (
    CpuClass(
        "v3",
        frozenset(["avx", "avx2", "fma", "bmi1", "bmi2", "f16c", "abm", "movbe"]),
        {
            "OPENBLAS_CORETYPE": "Haswell",
            "NPY_ENABLE_CPU_FEATURES": f"X86_V3 {OLD_SSE} AVX F16C FMA3 AVX2",
            "LP_NATIVE_VECTOR_WIDTH": "256",
        },
    ),
    CpuClass(
        "v2",
        frozenset(["ssse3", "sse4_1", "sse4_2", "popcnt", "avx"]),
        {
            "OPENBLAS_CORETYPE": "Nehalem",
            "NPY_ENABLE_CPU_FEATURES": f"X86_V2 {OLD_SSE}",
            "GLIBC_TUNABLES": f"glibc.cpu.hwcaps={PLAIN_LIBM}",
            "LP_NATIVE_VECTOR_WIDTH": "128",
        },
    ),
    CpuClass(
        "v1",
        frozenset(),
        {
            "OPENBLAS_CORETYPE": "Prescott",
            "NPY_ENABLE_CPU_FEATURES": "SSE2",
            "GLIBC_TUNABLES": f"glibc.cpu.hwcaps={PLAIN_LIBM}",
            "LP_NATIVE_VECTOR_WIDTH": "128",
        },
    ),
)
"""The best first. v3 is x86-64-v3: AVX2 and FMA, with or without AVX-512."""
ARM = CpuClass(
    "armv8",
    frozenset(),
    {"OPENBLAS_CORETYPE": "ARMV8", "NPY_ENABLE_CPU_FEATURES": "NEON"},
)
UNKNOWN = CpuClass("any", frozenset(), {})


@functools.cache
def cpu_class() -> CpuClass:
    """The class of this machine's CPU."""
    machine = platform.machine().lower()
    if machine in ("x86_64", "amd64"):
        flags = frozenset(cpuinfo().get("flags", "").split())
        return next(each for each in X86_CLASSES if each.flags <= flags)
    return ARM if machine in ("aarch64", "arm64") else UNKNOWN


@functools.cache
def cpu_model() -> str:
    """Maker, family and model of this CPU, for steps that compute what no environment pins."""
    fields = cpuinfo()
    names = ("vendor_id", "cpu family", "model", "CPU implementer", "CPU part")
    values = [fields[name] for name in names if name in fields]
    return " ".join(values) or platform.processor() or platform.machine()


@functools.cache
def platform_tag() -> str:
    """`linux-x86_64-v3-glibc2.36`: numbers may differ between two of them.

    The C library is part of it, because every library takes `sin` and `exp` from there.
    """
    parts = (sys.platform, platform.machine(), cpu_class().name, libc())
    return "-".join(part for part in parts if part)
