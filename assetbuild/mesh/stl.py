"""STL: binary or text, told apart by size and never by the first word."""

from __future__ import annotations

import codecs
import re

import numpy as np

from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.mesh.material import STRAY
from assetbuild.mesh.triangles import TriangleMesh

HEADER = 80
RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

NUMBER = rb"\s+([-+.\dni]\S*)"
CORNER = re.compile(rb"\bvertex" + 3 * NUMBER)
"""A corner of a text STL in lower case; `nan` and `inf` are refused later, with all the others."""


def read_stl(data: bytes, subject: str) -> tuple[TriangleMesh, tuple[Finding, ...]]:
    """The triangles of an STL file, not welded; its normals follow from the winding.

    76 of 410 real binary files begin with `solid`: 84 + 50 n == size decides. Up to 49 bytes more
    hold no further triangle and are left out, with a finding.
    Raises StepError when the face count and the size disagree, or the text is not STL.
    """
    count = int.from_bytes(data[HEADER : HEADER + 4], "little") if len(data) >= HEADER + 4 else -1
    expected = HEADER + 4 + RECORD.itemsize * count
    stray = len(data) - expected
    if count >= 0 and 0 <= stray < RECORD.itemsize:
        corners = np.frombuffer(data, dtype=RECORD, offset=HEADER + 4, count=count)["corners"]
        said = f"{stray} bytes after the last of {count} triangles are left out"
        findings = (STRAY(subject, said, hint="save the file again"),) if stray else ()
        return _soup(corners.astype(np.float64).reshape(-1, 3)), findings
    begin = data[:512].removeprefix(codecs.BOM_UTF8).lstrip().lower()
    if begin.startswith(b"solid") and b"facet" in data[:4096].lower():
        return _read_text(data, subject), ()
    if count < 0:
        raise StepError(f"{subject}: {len(data)} bytes are too few for an STL file")
    raise StepError(
        f"{subject}: the header promises {count} faces, which is {expected} bytes, "
        f"the file has {len(data)}",
        hint="the file is cut off, or it is not an STL file"
        if stray < 0
        else "the count is wrong, or something else follows: save the file again",
    )


def _read_text(data: bytes, subject: str) -> TriangleMesh:
    data = data.lower()
    if b"endsolid" not in data[-512:]:
        line = data.count(b"\n") + 1
        raise StepError(f"{subject}: cut off at line {line}: no `endsolid`")
    try:
        found = [tuple(map(float, corner)) for corner in CORNER.findall(data)]
    except ValueError as error:
        raise StepError(f"{subject}: not a text STL: {error}") from error
    if 3 * data.count(b"endfacet") != len(found):
        raise StepError(f"{subject}: {data.count(b'endfacet')} facets, {len(found)} corners")
    return _soup(np.array(found, dtype=np.float64).reshape(-1, 3))


def _soup(corners: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> TriangleMesh:
    faces = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    return TriangleMesh(corners, faces)
