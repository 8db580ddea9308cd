"""What `meta/info.json` of a LeRobot data set says about the columns of its Parquet files.

Version 3 keeps many episodes in `data/chunk-000/file-000.parquet`; version 2 one in each file. In
both, `features` names the elements of each column of lists.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

from assetbuild.errors import StepError

EPISODE = "episode_index"
"""Column of the number of the episode."""
INFO = "meta/info.json"


def info_beside(log: Path) -> Path | None:
    """Where the data set of `DATASET/data/chunk-000/file-000.parquet` describes itself."""
    parts = PurePosixPath(log.as_posix()).parts
    if len(parts) < 4 or parts[-3] != "data":
        return None
    return log.parents[2] / INFO


def element_names(info: bytes, file: str) -> dict[str, tuple[str, ...]]:
    """Column -> the names of its elements. StepError for a text that is no such description."""
    try:
        features = json.loads(info)["features"]
        return {name: tuple(_names(of.get("names"))) for name, of in features.items()}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise StepError(f"{INFO} of the data set of {file} has no readable `features`") from None


def _names(stated: object) -> Iterator[str]:
    """Names in their order, whether they are listed or grouped, as in `{motors: [...]}`."""
    if isinstance(stated, str):
        yield stated
    elif isinstance(stated, Mapping):
        for group in stated.values():
            yield from _names(group)
    elif isinstance(stated, list):
        for name in stated:
            yield from _names(name)
