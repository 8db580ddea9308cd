"""Contact masks of several MJCFs in one: each means what it did, and the parts meet each other.

MuJoCo lets two shapes touch when the contype of one meets the conaffinity of the other. Which
bits a source uses for what is its own business, but for the first: that of the floor, and of
whatever else in a world says nothing of masks. So

- within a part the same pairs touch as before: bits that two sources use are told apart;
- to each part the others are things of the world: shapes that the floor touches touch one another.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
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


def meeting_masks(
    sources: list[tuple[str, SourceControl]],
) -> tuple[list[SourceControl], list[Finding]]:
    """The sources, whose masks go together now. sources: by prefix, the base's "" first."""
    # Of each source its masks, and what becomes of them.
    sides = [{masks: masks for masks in _masks_of(source)} for _, source in sources]
    prefixes = [prefix for prefix, _ in sources]
    moved, joined = dict.fromkeys(prefixes, 0), dict.fromkeys(prefixes, 0)
    taken = FLOOR
    for prefix, side in zip(prefixes, sides, strict=True):
        used = _used(side)
        bits: dict[int, int] = {}
        for bit in _bits(used & taken & ~FLOOR):
            bits[bit] = _free(taken | used | sum(bits.values()), prefix)
        if bits:
            side.update({masks: _moved(bits, masks) for masks in side})
        moved[prefix] = len(bits)
        taken |= _used(side.values())
    for number, (prefix, side) in enumerate(zip(prefixes, sides, strict=True)):
        later = [n for n in range(number + 1, len(sides)) if _misses(side, sides[n])]
        if later:
            bit = _free(taken, prefix)
            taken |= bit
            _add(bit, 0, side)
            for other in later:
                _add(0, bit, sides[other])
                joined[prefixes[other]] += 1
    made = [_with_masks(source, side) for (_, source), side in zip(sources, sides, strict=True)]
    changed = [prefix for prefix in prefixes if moved[prefix] or joined[prefix]]
    return made, [_masks_finding(prefix, moved[prefix], joined[prefix]) for prefix in changed]


def _masks_finding(prefix: str, moved: int, joined: int) -> Finding:
    """moved: how many bits became others; joined: how many were added."""
    return MASKS(
        "recipe compose",
        f"contact masks of the part `{prefix}`: {moved} bits that mean something else in another "
        f"part became others; {joined} were added, so that it touches the parts before it",
        "which of its own shapes touch, and which touch the floor, is as before",
        data={"moved": moved, "added": joined},
    )


def _misses(side: Mapping[Masks, Masks], other: Mapping[Masks, Masks]) -> bool:
    near, far = (list(filter(_meets_floor, masks.values())) for masks in (side, other))
    return not all(touch(a, b) for a in near for b in far)


def touch(a: Masks, b: Masks) -> bool:
    """Whether MuJoCo lets two shapes touch."""
    return bool(a[0] & b[1] or b[0] & a[1])


def _meets_floor(masks: Masks) -> bool:
    return touch(masks, (FLOOR, FLOOR))


def _used(masks: Iterable[Masks]) -> int:
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


def _add(contype: int, conaffinity: int, side: dict[Masks, Masks]) -> None:
    """More bits for what the floor touches."""
    for before, now in side.items():
        if _meets_floor(now):
            side[before] = now[0] | contype, now[1] | conaffinity


# --- the shapes of a source -----------------------------------------------------------------


def _masks_of(source: SourceControl) -> set[Masks]:
    """Return the masks of all its shapes; shapes that are made anew get the common ones."""
    control = source.control
    contacts = (control.contact, *(contact for _, contact in control.contacts))
    masks = {(contact.contype, contact.conaffinity) for contact in contacts}
    return masks | {_of_geom(parsed(item)) for item in control.mjcf_only if _is_geom(item)}


def _with_masks(source: SourceControl, become: Mapping[Masks, Masks]) -> SourceControl:
    """The source with other masks of all its shapes."""
    if all(before == after for before, after in become.items()):
        return source

    def changed(contact: Contact) -> Contact:
        contype, conaffinity = become[contact.contype, contact.conaffinity]
        return contact.model_copy(update={"contype": contype, "conaffinity": conaffinity})

    control = replace(
        source.control,
        contact=changed(source.control.contact),
        contacts=tuple((name, changed(contact)) for name, contact in source.control.contacts),
        mjcf_only=tuple(_changed_item(item, become) for item in source.control.mjcf_only),
    )
    return replace(source, control=control)


def _is_geom(item: MjcfOnly) -> bool:
    return item.place == "body" and item.element.startswith("<geom")


def _of_geom(geom: ElementTree.Element) -> Masks:
    return int(geom.get("contype", FLOOR)), int(geom.get("conaffinity", FLOOR))


def _changed_item(item: MjcfOnly, become: Mapping[Masks, Masks]) -> MjcfOnly:
    if not _is_geom(item):
        return item
    geom = parsed(item)
    before = _of_geom(geom)
    if become[before] == before:
        return item
    for key, value in zip(("contype", "conaffinity"), become[before], strict=True):
        geom.set(key, str(value))
    return replace(item, element=ElementTree.tostring(geom, "unicode"))
