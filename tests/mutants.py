"""Every single change of an XML file that could change what it says."""

from __future__ import annotations

from collections.abc import Iterator

from lxml import etree

from assetbuild.facts.reader import Proof


def xml_values(data: bytes) -> Iterator[tuple[str, bytes]]:
    """(what was changed, file) for each number and each text of an attribute."""
    root = etree.fromstring(data)
    for element in root.iter("*"):
        for name, said in dict(element.attrib).items():
            words = str(said).split()
            for index, word in enumerate(words):
                try:
                    value: object = _other(float(word))
                except ValueError:
                    value = _other(word)
                element.set(name, " ".join([*words[:index], str(value), *words[index + 1 :]]))
                where = f"line {element.sourceline}: {element.tag} {name}"
                yield f"{where}: {word} -> {value}", etree.tostring(root)
            element.set(name, said)


def xml_elements(data: bytes) -> Iterator[tuple[str, bytes]]:
    """(what was changed, file) with each element removed, doubled, or with an unknown attribute."""
    for number in range(1, len(list(etree.fromstring(data).iter("*")))):
        for change in ("removed", "doubled", "given an attribute"):
            root = etree.fromstring(data)
            element = list(root.iter("*"))[number]
            what = f"line {element.sourceline}: {element.tag} {change}"
            if change == "given an attribute":
                element.set("unknown", "1")
            elif change == "doubled":
                element.addnext(etree.fromstring(etree.tostring(element)))
            elif (above := element.getparent()) is not None:
                above.remove(element)
            yield what, etree.tostring(root)


def _other(value: object) -> object:
    """One per cent more of a number."""
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case float():
            return value * 1.01 if value else 0.01
        case str():
            return f"{value}x"
    return 1


def is_found(proof: Proof) -> bool:
    """Whether a finding names the subject, the quantity and both values, or a subject as lost."""
    return any(
        f.subject
        and (
            f.rule.endswith((".missing", ".extra"))
            or {"expected", "found"} <= set(f.data or ())
            or "attribute" in (f.data or ())
        )
        for f in proof.findings
    )
