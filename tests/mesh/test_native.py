"""A native library that crashes, hangs or eats memory loses one result and nothing else."""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from assetbuild.mesh.merge import grown_to, merge_steps
from assetbuild.mesh.native import NativeError, NativeLimits, run_apart
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.triangles import TriangleMesh, signed_volume
from assetbuild.robot.shapes import Box

LIMITS = NativeLimits(cpu_s=2.0, memory_mb=256)
UNIT = tessellate(Box((1.0, 1.0, 1.0)))


def test_what_is_computed_apart_comes_back_as_it_was():
    made = run_apart(lambda: [UNIT, UNIT.select(np.arange(3))], LIMITS)
    assert np.array_equal(made[0].vertices, UNIT.vertices)
    assert np.array_equal(made[0].faces, UNIT.faces)
    assert len(made[1].faces) == 3
    assert run_apart(list, LIMITS) == []


def crash() -> list[TriangleMesh]:
    faulthandler.disable()  # pytest's would print a page about this crash, which is meant
    os.kill(os.getpid(), signal.SIGSEGV)
    return []


def abort() -> list[TriangleMesh]:
    faulthandler.disable()
    os.write(2, b"terminate called after throwing an instance of 'std::length_error'\n")
    os.abort()


def hang() -> list[TriangleMesh]:
    while True:
        pass


def gorge() -> list[TriangleMesh]:
    return [TriangleMesh(np.ones((100_000_000, 3)), UNIT.faces)]


def killed() -> list[TriangleMesh]:
    os.kill(os.getpid(), signal.SIGKILL)  # as the system does when memory is short
    return []


def refuse() -> list[TriangleMesh]:
    raise ValueError("no such mesh")


@pytest.mark.parametrize(
    ("work", "cause", "words"),
    [
        (crash, "crash", "SIGSEGV"),
        (abort, "crash", "length_error"),
        (hang, "time", "1 CPU s"),
        (gorge, "memory", "256 MB"),
        (killed, "memory", "killed by the system"),
        (refuse, "error", "no such mesh"),
    ],
)
def test_the_cause_of_a_lost_result_is_told(work, cause, words):
    with pytest.raises(NativeError, match=words) as caught:
        run_apart(work, NativeLimits(1.0, 256) if work is hang else LIMITS)
    assert caught.value.cause == cause


def test_work_is_stopped_at_a_word_that_it_prints():
    def talk() -> list[TriangleMesh]:
        os.write(1, b"Mesh Manifoldness: false\n")
        return hang()

    with pytest.raises(NativeError) as caught:
        run_apart(talk, LIMITS, stop_when=lambda line: line.endswith(b"Manifoldness: false"))
    assert caught.value.cause == "stopped"


def test_work_that_ends_before_it_is_heard_is_stopped_all_the_same():
    def talk() -> list[TriangleMesh]:
        os.write(1, b"iter 1: 20\niter 2: ")
        os.write(1, b"40\niter 3: 5\n")
        return [UNIT]

    heard: list[bytes] = []

    def stop_when(line: bytes) -> bool:
        heard.append(line)
        return line == b"iter 2: 40"

    with pytest.raises(NativeError) as caught:
        run_apart(talk, LIMITS, stop_when=stop_when)
    assert caught.value.cause == "stopped"
    assert heard == [b"iter 1: 20", b"iter 2: 40"]


def octants() -> list[TriangleMesh]:
    half = UNIT.scaled((0.5, 0.5, 0.5))
    return [
        half.mapped(np.eye(3), (x, y, z))
        for x in (-0.25, 0.25)
        for y in (-0.25, 0.25)
        for z in (-0.25, 0.25)
    ]


def test_eight_octants_merge_into_the_box_that_they_are():
    family = list(merge_steps(octants()))
    assert [len(parts) for parts in family] == [8, 7, 6, 5, 4, 3, 2, 1]
    (whole,) = family[-1]
    assert np.ptp(whole, axis=0) == pytest.approx([1.0, 1.0, 1.0])
    # Halves and slabs add no volume: a pair that leaves the box is never joined.
    for parts in family:
        assert all(np.abs(points).max() <= 0.5 + 1e-12 for points in parts)


def test_a_shrunken_part_grows_back_onto_the_surface():
    small = UNIT.scaled((0.9, 0.9, 0.9))
    (grown,) = grown_to([small], UNIT.vertices, reach=0.1)
    assert signed_volume(grown) == pytest.approx(1.0)
    (left,) = grown_to([small], UNIT.vertices, reach=0.01)
    assert signed_volume(left) == pytest.approx(0.9**3)


@pytest.mark.skipif(sys.platform != "linux", reason="counts children in /proc")
def test_no_process_is_left_behind():
    before = children()
    with pytest.raises(NativeError):
        run_apart(crash, LIMITS)
    assert children() == before


def children() -> set[str]:
    """Process ids of this process's children, those that nobody has waited for among them."""
    tasks = Path("/proc/self/task").glob("*/children")
    return {pid for task in tasks for pid in task.read_text().split()}


def test_parts_that_nothing_joins_are_merged_in_the_end():
    far = [UNIT, UNIT.mapped(np.eye(3), (10.0, 0.0, 0.0))]
    assert [len(parts) for parts in merge_steps(far)] == [2, 1]
