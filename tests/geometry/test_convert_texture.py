"""A picture that the description names becomes PNG; what is none is reported."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import pytest
from PIL import Image
from tiny import run_step

from assetbuild.geometry.convert_texture import ConvertTexture


def jpeg(size: tuple[int, int]) -> bytes:
    file = BytesIO()
    Image.new("RGB", size, (200, 30, 30)).save(file, "JPEG")
    return file.getvalue()


@pytest.mark.parametrize(
    ("data", "rules"),
    [
        (jpeg((8, 4)), []),
        (b"", ["texture.unreadable"]),
        (jpeg((64, 64))[:200], ["texture.unreadable"]),
        (b"<html>404 Not Found</html>", ["texture.unreadable"]),
    ],
)
def test_what_is_no_picture_is_told_and_leaves_no_file(
    data: bytes, rules: list[str], tmp_path: Path
):
    (tmp_path / "in").mkdir()
    (tmp_path / "in/picture").write_bytes(data)
    found = run_step(ConvertTexture(name="wood.jpg"), tmp_path / "in", tmp_path / "out")
    assert [finding.rule for finding in found] == rules
    made = tmp_path / "out/texture/texture.png"
    assert made.is_file() is not bool(rules)
    assert rules or Image.open(made).size == (8, 4)
