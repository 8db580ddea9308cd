"""What a source's MJCF says of efforts beside the Robot's own limit: `actuatorfrcrange`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from xml.etree import ElementTree

from assetbuild.robot.model import Actuator, MjcfOnly

WORDS: Mapping[str, tuple[str, ...]] = {
    "joint": ("actuatorfrcrange", "actuatorfrclimited"),
    "drive": ("forcerange", "forcelimited", "ctrlrange", "ctrllimited"),
}
"""Attributes that limit the effort of a joint, by the place of `MjcfOnly`."""


def of_same_effort(
    items: Iterable[MjcfOnly], before: Mapping[str, Actuator], now: Mapping[str, Actuator]
) -> Iterator[MjcfOnly]:
    """The items without the old limits of joints whose effort limit is another one now."""
    for item in items:
        old, new = before.get(item.owner), now.get(item.owner)
        if item.place in WORDS and old and (new is None or new.effort != old.effort):
            element = ElementTree.fromstring(item.element)  # noqa: S314 # our own reader wrote it
            kept = {k: v for k, v in element.attrib.items() if k not in WORDS[item.place]}
            if not kept:
                continue
            if len(kept) < len(element.attrib):
                text = ElementTree.tostring(ElementTree.Element(element.tag, kept), "unicode")
                item = MjcfOnly(item.place, text, item.owner)
        yield item


def force_range(item: MjcfOnly) -> tuple[float, float] | None:
    """The `actuatorfrcrange` of a joint that an item states, N m or N."""
    element = ElementTree.fromstring(item.element)  # noqa: S314 # our own reader wrote it
    said = element.get("actuatorfrcrange", "") if item.place == "joint" else ""
    if not said or element.get("actuatorfrclimited") == "false":
        return None
    lower, upper = (float(end) for end in said.split())
    return lower, upper
