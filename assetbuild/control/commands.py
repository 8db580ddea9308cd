"""The commands of an MJCF's keyframes, for the drives of the MJCF that is written."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from xml.etree import ElementTree

from assetbuild.robot.model import Actuator, Keyframe, MjcfOnly
from assetbuild.robot.source import SourceControl


def commands_of(
    source: SourceControl,
    keyframes: Sequence[Keyframe],
    replaces: Callable[[str], bool],
    has_table: Callable[[str], bool],
) -> Iterator[MjcfOnly]:
    """The commands of each keyframe, by actuator.

    A drive whose joint stands elsewhere now than in the source gets the command of that place.
    replaces: whether the recipe says what drives a joint; has_table: whether it says so of all
    drives where an actuator belongs.
    """
    joint_of = {a.name: a.joint for a in source.control.actuators if a.name}
    before = {key.name: dict(key.joints) for key in source.control.keyframes}
    stated = dict(source.ctrl)
    own = [i for i in source.control.mjcf_only if i.place == "actuator" and i.owner]
    own = [item for item in own if not replaces(item.owner)]
    for key in keyframes:
        now = dict(key.joints)
        holding = (_holding(item, source.control.by_joint[item.owner], now) for item in own)
        commands = dict(filter(None, holding))
        for actuator, value in stated.get(key.name, ()):
            joint = joint_of.get(actuator)
            if joint is None:
                if has_table(actuator):
                    continue
            elif replaces(joint) or _moved(joint, before.get(key.name, {}), now):
                continue
            commands[actuator] = value
        element = ElementTree.Element("key")
        for actuator, value in commands.items():
            ElementTree.SubElement(element, "ctrl", {"actuator": actuator, "value": repr(value)})
        if len(element):
            yield MjcfOnly("keyframe", ElementTree.tostring(element, "unicode"), key.name)


def _holding(item: MjcfOnly, row: Actuator, pose: Mapping[str, float]) -> tuple[str, float] | None:
    """(actuator, its command at rest in a pose) of one that holds positions: see `MjcfOnly`."""
    said = ElementTree.fromstring(item.element)  # noqa: S314 # our own reader wrote it
    if row.model != "pd":
        return None
    gain = float(said.get("gainprm", "").split()[0])
    constant, stiff = (float(word) for word in said.get("biasprm", "").split()[:2])
    length = row.gear * pose.get(row.joint, 0.0)
    return row.name, (0.0 - stiff * length - constant) / gain


def _moved(joint: str, before: Mapping[str, float], now: Mapping[str, float]) -> bool:
    return joint in before and before[joint] != now.get(joint, before[joint])
