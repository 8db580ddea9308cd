"""Columns of a ROS 2 bag, an MCAP file or a ROS 1 bag, read message by message.

A column is a topic and a field, `/joint_states.position[3]`. In the brackets stands a number, or a
name that the message's own `name` or `joint_names` lists. The rows are the messages of the topic
of the second column, the position; of other topics a row has the last value before it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any  # Any: messages, whose types the bag defines

import numpy as np

from assetbuild.errors import StepError, did_you_mean
from assetbuild.robot.pose import Array

BAGS = (".mcap", ".db3", ".bag")
STAMP, RECEIVED = "stamp", "received"
"""The columns of time: of the message's header, or when the recorder got it."""
NAMES = ("name", "joint_names")
CHUNK = 50_000
_FIELD = re.compile(r"(?P<topic>[^.\[\]]+)\.(?P<path>[^\[\]]+)(\[(?P<place>[^\[\]]+)\])?")


@dataclass(frozen=True)
class _Column:
    """`/topic.path[place]`."""

    name: str
    topic: str
    path: tuple[str, ...]
    place: str | None


def read_bag(path: Path, file: str, columns: Sequence[str]) -> Iterator[Array]:
    """(rows, columns) in pieces, the time in s first. file: the name for errors.

    Raises StepError for a bag that cannot be read, and for a topic or field that it lacks.
    """
    try:
        from rosbags.highlevel import AnyReader
    except ImportError:
        hint = "pip install 'assetbuild[logs]'"
        raise StepError(f"{file}: reading bags needs rosbags", hint=hint) from None
    wanted = [_column(file, name) for name in columns[1:]]
    clock = columns[0]
    if clock not in (STAMP, RECEIVED):
        hint = f"`columns: {{time: {STAMP}}}` for the headers of the messages, or `{RECEIVED}`"
        raise StepError(f"{file}: a bag has no column `{clock}`", hint=hint)
    with TemporaryDirectory() as folder:
        link = Path(folder) / f"log{Path(file).suffix}"  # the reader goes by the ending
        link.symlink_to(path.resolve())
        try:
            with AnyReader([link]) as bag:
                yield from _rows(bag, file, wanted, clock)
        except StepError:
            raise
        except Exception as error:  # whatever rosbags and its decoders make of a broken file
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise StepError(f"{file} cannot be read as a bag: {reason}") from None


def _column(file: str, name: str) -> _Column:
    match = _FIELD.fullmatch(name)
    if match is None:
        hint = "write `/topic.field`, or `/topic.field[{joint}]` for a list"
        raise StepError(f"{file}: `{name}` is no field of a topic", hint=hint)
    return _Column(name, match["topic"], tuple(match["path"].split(".")), match["place"])


def _rows(bag: Any, file: str, wanted: Sequence[_Column], clock: str) -> Iterator[Array]:
    topics = sorted({connection.topic for connection in bag.connections})
    for column in wanted:
        if column.topic not in topics:
            there = ", ".join(f"`{topic}`" for topic in topics[:12]) or "none"
            raise StepError(
                f"{file} has no topic `{column.topic}`; it has {there}",
                hint=did_you_mean(column.topic, topics) or "state the topics in `columns`",
            )
    leading = wanted[0].topic
    of_topic = {c.topic: [i for i, w in enumerate(wanted) if w.topic == c.topic] for c in wanted}
    latest: list[float | None] = [None] * len(wanted)
    kept: list[list[float]] = []
    chosen = [connection for connection in bag.connections if connection.topic in of_topic]
    for connection, received, raw in bag.messages(connections=chosen):
        message = bag.deserialize(raw, connection.msgtype)
        for index in of_topic[connection.topic]:
            latest[index] = _value(file, message, wanted[index])
        if connection.topic == leading and None not in latest:
            time = _stamp(file, message, leading) if clock == STAMP else received * 1e-9
            kept.append([time, *(value for value in latest if value is not None)])
        if len(kept) == CHUNK:
            yield np.array(kept, float)
            kept = []
    yield np.array(kept, float).reshape(len(kept), len(wanted) + 1)


def _value(file: str, message: Any, column: _Column) -> float:
    value = message
    try:
        for part in column.path:
            value = getattr(value, part)
        if column.place is None:
            return float(value)
        return float(value[_place(message, column.place)])
    except (AttributeError, IndexError, TypeError, ValueError):
        raise StepError(
            f"{file}: a message of `{column.topic}` has no number `{column.name}`",
            hint=_what_it_has(message),
        ) from None


def _place(message: Any, place: str) -> int:
    """The number in the brackets, or where the message lists that name."""
    if place.isdigit():
        return int(place)
    names = next((getattr(message, key) for key in NAMES if hasattr(message, key)), ())
    return list(names).index(place)


def _what_it_has(message: Any) -> str:
    names = next((list(getattr(message, key)) for key in NAMES if hasattr(message, key)), [])
    fields = [name for name in getattr(message, "__dataclass_fields__", {}) if name[:1] != "_"]
    listed = f", of the joints {', '.join(map(str, names[:12]))}" if names else ""
    return f"it has the fields {', '.join(fields)}{listed}"


def _stamp(file: str, message: Any, topic: str) -> float:
    header = getattr(message, "header", None)
    if header is None:
        hint = f"`columns: {{time: {RECEIVED}}}` takes the recorder's clock"
        raise StepError(f"{file}: messages of `{topic}` have no header", hint=hint)
    return float(header.stamp.sec) + float(header.stamp.nanosec) * 1e-9
