"""The columns of a log that a recipe names: read in pieces, so that no file is too large."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from assetbuild.errors import StepError, did_you_mean
from assetbuild.identify.bags import BAGS, read_bag
from assetbuild.robot.pose import Array

MOST_ROWS = 1_500_000
"""Rows of a log that are kept: 25 minutes at 1 kHz."""
BLOCK = 4_000_000
"""Characters of a CSV file that are read at once."""
CHUNK = 50_000
"""Rows of a Parquet file that are read at once."""
PARQUET = (".parquet", ".pq")
FORMATS = (".csv", ".txt", *PARQUET, *BAGS)


def read_columns(
    path: Path,
    file: str,
    columns: Sequence[str],
    interval: tuple[float, float] | None,
    unit: float,
    elements: Mapping[str, Sequence[str]] = MappingProxyType({}),
    episode: int | None = None,
) -> Array:
    """(rows, columns) of the rows whose time lies in the interval; the first column is the time.

    file: the name for errors. unit: seconds of one unit of time. elements: names of the elements of
    columns of lists; episode: the only one that is read, both of Parquet. StepError for a log that
    has not these columns, or whose numbers are none.
    """
    if file.endswith(PARQUET):
        pieces = _parquet(path, file, columns, elements, episode)
    elif episode is not None:
        raise StepError(f"{file}: only a Parquet file has an `episode`", hint="remove the key")
    else:
        pieces = (read_bag if file.endswith(BAGS) else _csv)(path, file, columns)
    kept, count, row = [], 0, 0
    for piece in pieces:
        piece[:, 0] *= unit
        least, most = interval or (-np.inf, np.inf)
        inside = ~((piece[:, 0] < least) | (piece[:, 0] > most))  # a time of NaN is refused below
        rows = row + np.flatnonzero(inside)
        row, piece = row + len(piece), piece[inside]
        _refuse_gaps_in_numbers(piece, rows, file, columns)
        kept.append(piece)
        count += len(piece)
        if count > MOST_ROWS:
            raise StepError(
                f"{file}: more than {MOST_ROWS:,} rows",
                hint="choose an `interval` of a few minutes",
            )
    if count < 2:
        part = f" between {interval[0]:g} and {interval[1]:g} s" if interval else ""
        raise StepError(f"{file}: {count} rows{part}", hint="check `interval` and `time_unit`")
    return np.concatenate(kept)


def _refuse_gaps_in_numbers(
    piece: Array, rows: NDArray[np.int64], file: str, columns: Sequence[str]
) -> None:
    bad = np.argwhere(~np.isfinite(piece))
    if len(bad):
        row, column = bad[0]
        raise StepError(
            f"{file}: column `{columns[column]}` is not a number in row {int(rows[row]) + 1} of "
            f"the data, and in {len(np.unique(bad[:, 0]))} rows of this part",
            hint="remove the rows from the log, or choose an `interval` without them",
        )


def _missing(file: str, wanted: Sequence[str], known: Sequence[str]) -> StepError:
    lost = [name for name in wanted if name not in known]
    shown = ", ".join(f"`{name}`" for name in lost[:4]) + (" ..." if len(lost) > 4 else "")
    there = ", ".join(f"`{name}`" for name in known[:12]) + (" ..." if len(known) > 12 else "")
    return StepError(
        f"{file} has no column {shown}; it has {there or 'no columns'}",
        hint=did_you_mean(lost[0], known)
        or "is it a log of this robot? `columns` and `names` state how the log calls the joints",
    )


def _csv(path: Path, file: str, columns: Sequence[str]) -> Iterator[Array]:
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        head = lines.readline(BLOCK)
        comma = max(",;\t", key=head.count)
        names = [name.strip() for name in next(csv.reader([head.lstrip("#")], delimiter=comma), [])]
        if not set(columns) <= set(names):
            raise _missing(file, columns, names)
        places = [names.index(name) for name in columns]
        number = 1
        for chunk in _pieces(lines, file):
            _refuse_wide(chunk, comma, len(names), f"{file}:", number + 1)
            try:
                piece = np.loadtxt(chunk, delimiter=comma, usecols=places, ndmin=2, comments=None)
            except ValueError:
                rows = [
                    [_number(cells, place) for place in places]
                    for cells in csv.reader(chunk, delimiter=comma)
                    if cells
                ]
                piece = np.array(rows, float).reshape(len(rows), len(columns))
            number += len(chunk)
            yield piece


def _pieces(lines: TextIO, file: str) -> Iterator[list[str]]:
    """Whole lines, of `BLOCK` characters together, without pieces that are blank."""
    rest = ""
    while block := lines.read(BLOCK):
        whole, newline, rest = (rest + block).rpartition("\n")
        if not newline:
            raise StepError(
                f"{file}: a line of more than {BLOCK:,} characters",
                hint="a log has one line for each sample",
            )
        if whole.strip():
            yield whole.split("\n")
    if rest.strip():
        yield [rest]


def _refuse_wide(chunk: Sequence[str], comma: str, most: int, where: str, first: int) -> None:
    """StepError for a line with more cells than the header: which of them is too many?"""
    for number, line in enumerate(chunk, first):
        if line.rstrip().rstrip(comma).count(comma) >= most and '"' not in line:
            raise StepError(
                f"{where}{number}: {line.count(comma) + 1} cells, but the header names {most}"
            )


def _number(cells: Sequence[str], place: int) -> float:
    """What stands in a cell; NaN where it is empty, missing or no number."""
    try:
        return float(cells[place])
    except (IndexError, ValueError):
        return math.nan


def _parquet(
    path: Path,
    file: str,
    columns: Sequence[str],
    elements: Mapping[str, Sequence[str]],
    episode: int | None,
) -> Iterator[Array]:
    """Columns; `state[3]` is the fourth element of a column of lists, as LeRobot writes them."""
    try:
        import pyarrow.parquet as parquet
    except ImportError:
        raise StepError(
            f"{file}: reading Parquet needs pyarrow", hint="pip install 'assetbuild[logs]'"
        ) from None
    try:
        table = parquet.ParquetFile(path)
    except Exception as error:  # whatever pyarrow makes of a broken file
        raise StepError(f"{file} is not a Parquet file: {error}") from None
    plain = [name.partition("[")[0] for name in columns]
    names = list(table.schema_arrow.names)
    if not set(plain) <= set(names):
        raise _missing(file, [n for n in plain if n not in names] or plain, names)
    places = [_place(name, elements, file) for name in columns]
    wanted = list(dict.fromkeys([*plain, *([EPISODE] if EPISODE in names else [])]))
    seen: set[int] = set()
    for batch in table.iter_batches(CHUNK, columns=wanted):
        piece = np.stack([_element(batch, *place, file) for place in places], axis=1)
        if EPISODE in names:
            of = np.asarray(batch.column(EPISODE).to_numpy(zero_copy_only=False), int)
            seen |= set(map(int, np.unique(of)))
            piece = piece if episode is None else piece[of == episode]
            _refuse_many_episodes(file, seen, episode)
        yield piece
    if episode is not None and episode not in seen:
        held = f"it has {min(seen)}..{max(seen)}" if seen else f"it has no column `{EPISODE}`"
        raise StepError(f"{file} has no episode {episode}; {held}")


def _refuse_many_episodes(file: str, seen: set[int], episode: int | None) -> None:
    if episode is None and len(seen) > 1:
        raise StepError(
            f"{file} holds several episodes, {min(seen)} and more, each with its own clock",
            hint=f"choose one in `logs`: `{{file: {file}, episode: {min(seen)}}}`; an entry of "
            "`logs` may name the same file again with another episode",
        )


def _place(name: str, elements: Mapping[str, Sequence[str]], file: str) -> tuple[str, int | None]:
    """The column and the element of it that `name` stands for."""
    column, _, place = name.partition("[")
    place = place.rstrip("]")
    if not place or place.isdigit():
        return column, int(place) if place else None
    known = list(elements.get(column, ()))
    if place in known:
        return column, known.index(place)
    there = ", ".join(f"`{each}`" for each in known[:12])
    raise StepError(
        f"{file}: column `{column}` has no element `{place}`",
        hint=did_you_mean(place, known)
        or (f"meta/info.json names {there}" if known else "state the number of the element"),
    )


def _element(batch: object, column: str, index: int | None, file: str) -> Array:
    values = batch.column(column)  # type: ignore[attr-defined] # pyarrow's RecordBatch
    if index is None:
        return np.asarray(values.to_numpy(zero_copy_only=False), float)
    try:
        return np.array([row[index] for row in values.to_pylist()], float)
    except (IndexError, TypeError):
        raise StepError(f"{file}: column `{column}` has no element {index}") from None


# --- what a LeRobot data set says of itself ---------------------------------------------------

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
