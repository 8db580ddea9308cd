"""Contact masks of several MJCFs in one: each means what it did, and the parts meet each other.

MuJoCo lets two shapes touch when the contype of one meets the conaffinity of the other. Which
bits a source uses for what is its own business, but for the first: that of the floor, and of
whatever else in a world says nothing of masks. So

- within a part the same pairs touch as before: bits that two sources use are told apart;
- to each part the others are things of the world: shapes that the floor touches touch one another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from xml.etree import ElementTree

from assetbuild.errors import RecipeError
from assetbuild.findings import Finding, Rule
from assetbuild.robot.files import SourceControl
from assetbuild.robot.mjcf_only import parsed
from assetbuild.robot.model import Contact, MjcfOnly

FLOOR = 1
"""Both masks of a shape that says nothing of them."""
BITS = 31

Masks = tuple[int, int]
"""contype and conaffinity."""

MASKS = Rule(
    "compose.masks",
    "info",
    "contact masks of two MJCFs used the same bits for different things, or none that make the "
    "parts touch; they were changed",
    "nothing",
)


@dataclass
class _Side:
    prefix: str
    source_control: SourceControl
    moved: int = 0
    """How many bits became others."""
    joined: int = 0
    """How many bits were added."""

    def masks(self) -> set[Masks]:
        """Return the masks of all its shapes; shapes that are made anew get the common ones."""
        control = self.source_control.control
        masks = {
            (c.contype, c.conaffinity) for c in (control.contact, *(c for _, c in control.contacts))
        }
        return masks | {_of_geom(parsed(item)) for item in control.mjcf_only if _is_geom(item)}

    def change(self, function: Callable[[Masks], Masks]) -> None:
        """Other masks for all shapes."""

        def changed(contact: Contact) -> Contact:
            contype, conaffinity = function((contact.contype, contact.conaffinity))
            return contact.model_copy(update={"contype": contype, "conaffinity": conaffinity})

        control = self.source_control.control
        self.source_control = replace(
            self.source_control,
            control=replace(
                control,
                contact=changed(control.contact),
                contacts=tuple((name, changed(contact)) for name, contact in control.contacts),
                mjcf_only=tuple(_changed_item(item, function) for item in control.mjcf_only),
            ),
        )


def meeting_masks(
    sources: list[tuple[str, SourceControl]],
) -> tuple[list[SourceControl], list[Finding]]:
    """The sources, whose masks go together now. sources: by prefix, the base's "" first."""
    sides = [_Side(prefix, source) for prefix, source in sources]
    taken = FLOOR
    for side in sides:
        used = _used(side.masks())
        bits: dict[int, int] = {}
        for bit in _bits(used & taken & ~FLOOR):
            bits[bit] = _free(taken | used | sum(bits.values()), side.prefix)
        if bits:
            side.change(partial(_moved, bits))
            side.moved = len(bits)
        taken |= _used(side.masks())
    for number, side in enumerate(sides):
        later = [other for other in sides[number + 1 :] if _misses(side, other)]
        if later:
            bit = _free(taken, side.prefix)
            taken |= bit
            side.change(partial(_with_bits, bit, 0))
            for other in later:
                other.change(partial(_with_bits, 0, bit))
                other.joined += 1
    return [side.source_control for side in sides], [_told(s) for s in sides if s.moved or s.joined]


def _told(side: _Side) -> Finding:
    what = []
    if side.moved:
        what.append(f"{side.moved} bits mean something else in another part: they became others")
    if side.joined:
        what.append("a bit was added, so that it touches the parts before it")
    return MASKS(
        "recipe compose",
        f"contact masks of the part `{side.prefix}`: " + "; ".join(what),
        "which of its own shapes touch, and which touch the floor, is as before",
        data={"moved": side.moved, "added": side.joined},
    )


def _misses(a: _Side, b: _Side) -> bool:
    return any(
        not touch(one, other)
        for one in a.masks()
        for other in b.masks()
        if _meets_floor(one) and _meets_floor(other)
    )


def touch(a: Masks, b: Masks) -> bool:
    """Whether MuJoCo lets two shapes touch."""
    return bool(a[0] & b[1] or b[0] & a[1])


def _meets_floor(masks: Masks) -> bool:
    return touch(masks, (FLOOR, FLOOR))


def _used(masks: set[Masks]) -> int:
    used = 0
    for contype, conaffinity in masks:
        used |= contype | conaffinity
    return used


def _bits(word: int) -> Iterator[int]:
    return (1 << number for number in range(BITS) if word & 1 << number)


def _free(taken: int, prefix: str) -> int:
    free = next(_bits(~taken), None)
    if free is None:
        raise RecipeError(
            f"the contact masks of the parts need more than {BITS} bits, at `{prefix or 'base'}`",
            hint="state `contact: {contype: .., conaffinity: ..}` in the parts' recipes",
        )
    return free


def _moved(bits: Mapping[int, int], masks: Masks) -> Masks:
    contype, conaffinity = (sum(bits.get(bit, bit) for bit in _bits(word)) for word in masks)
    return contype, conaffinity


def _with_bits(contype: int, conaffinity: int, masks: Masks) -> Masks:
    """More bits for what the floor touches."""
    return (masks[0] | contype, masks[1] | conaffinity) if _meets_floor(masks) else masks


# --- geoms that only MJCF has ---------------------------------------------------------------


def _is_geom(item: MjcfOnly) -> bool:
    return item.place == "body" and item.element.startswith("<geom")


def _of_geom(geom: ElementTree.Element) -> Masks:
    return int(geom.get("contype", FLOOR)), int(geom.get("conaffinity", FLOOR))


def _changed_item(item: MjcfOnly, function: Callable[[Masks], Masks]) -> MjcfOnly:
    if not _is_geom(item):
        return item
    geom = parsed(item)
    before = _of_geom(geom)
    after = function(before)
    if after == before:
        return item
    for key, value in zip(("contype", "conaffinity"), after, strict=True):
        geom.set(key, str(value))
    return replace(item, element=ElementTree.tostring(geom, "unicode"))
