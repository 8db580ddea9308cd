"""CPUs of one class compute the same bytes, whatever kernels libraries choose by themselves."""

from __future__ import annotations

import json
import platform
from pathlib import Path

import pytest
from builds_for_tests import one
from steps_for_tests import Kernels

from assetbuild.engine import cpu
from assetbuild.engine.actions import key_parts
from assetbuild.engine.code import Code
from assetbuild.engine.cpu import UNKNOWN, X86_CLASSES, cpu_class, platform_tag
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store

pytestmark = pytest.mark.own_workers

V3 = "avx avx2 fma bmi1 bmi2 f16c abm movbe ssse3 sse4_1 sse4_2 popcnt"
CODE = Code()
IS_V3 = cpu_class().name == "v3"
USERS = (
    {"OPENBLAS_CORETYPE": "SkylakeX", "NPY_ENABLE_CPU_FEATURES": "X86_V3"},
    {
        "OPENBLAS_CORETYPE": "Prescott",
        "OPENBLAS_NUM_THREADS": "7",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
    },
)
"""What users set, knowingly or not."""


def made(tmp_path: Path) -> tuple[dict, dict]:
    with Session(Store(tmp_path / "store"), build="test") as session:
        result = one(session, Kernels())
        assert result.error is None
        return tuple(json.loads(session.read(result[f"{n}.json"])) for n in ("chosen", "numbers"))


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> tuple[dict, dict]:
    return made(tmp_path_factory.mktemp("plain"))


@pytest.mark.parametrize("environment", USERS, ids=lambda e: " ".join(map("=".join, e.items())))
def test_a_child_computes_the_same_whatever_the_user_asks_of_libraries(
    tmp_path, monkeypatch, plain, environment
):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert made(tmp_path) == plain


@pytest.mark.skipif(not IS_V3, reason="this CPU lacks AVX2 or FMA")
def test_a_cpu_with_more_than_avx2_uses_the_kernels_of_one_without(plain):
    chosen, _ = plain
    assert set(chosen["blas"].values()) == {"Haswell"}
    assert len(chosen["blas"]) == 2  # numpy's and scipy's own
    assert not [name for name in chosen["numpy"] if "512" in name or name == "X86_V4"]
    assert "X86_V3" in chosen["numpy"] or "AVX2" in chosen["numpy"]


@pytest.mark.skipif(not IS_V3, reason="this CPU lacks AVX2 or FMA")
@pytest.mark.parametrize("older", X86_CLASSES[1:], ids=lambda each: each.name)
def test_another_class_computes_other_bytes_and_has_another_key(
    tmp_path, monkeypatch, plain, older
):
    tag = platform_tag()
    monkeypatch.setattr(cpu, "cpu_class", lambda: older)
    monkeypatch.setattr("assetbuild.engine.doors.cpu_class", lambda: older)
    theirs = made(tmp_path)
    assert theirs[1].keys() == plain[1].keys()
    for name in ("product", "exp", "libm"):
        assert theirs[1][name] != plain[1][name]
    platform_tag.cache_clear()
    try:
        assert platform_tag() == tag.replace("-v3", f"-{older.name}")
    finally:
        platform_tag.cache_clear()


@pytest.mark.parametrize(
    ("machine", "flags", "name"),
    [
        ("x86_64", V3, "v3"),
        ("x86_64", V3 + " avx512f avx512vl", "v3"),
        ("x86_64", V3.replace(" fma", ""), "v2"),  # a virtual machine may hide some
        ("x86_64", "avx ssse3 sse4_1 sse4_2 popcnt", "v2"),
        ("x86_64", "ssse3 sse4_1 sse4_2 popcnt", "v1"),
        ("x86_64", "", "v1"),
        ("riscv64", V3, UNKNOWN.name),
    ],
)
def test_the_class_of_a_cpu_follows_from_what_it_can_do(machine, flags, name, monkeypatch):
    monkeypatch.setattr(platform, "machine", lambda: machine)
    monkeypatch.setattr(cpu, "cpuinfo", lambda: {"flags": flags})
    assert cpu_class.__wrapped__().name == name


def test_only_a_step_that_cannot_be_pinned_has_the_model_in_its_key(monkeypatch):
    pinned = key_parts(Kernels(), {}, CODE)
    assert pinned["platform"] == platform_tag()
    monkeypatch.setattr(Kernels, "cpu_bound", True)
    assert key_parts(Kernels(), {}, CODE)["platform"] == f"{platform_tag()} {cpu.cpu_model()}"
