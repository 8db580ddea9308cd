"""How a bundle was written: the key `written` of `report/robot.json`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from assetbuild.engine.digest import canonical_json, digest_bytes

KEY = "written"


@dataclass(frozen=True)
class Written:
    """What must be the same, so that the bundle's files can be written again.

    meshes: file of a mesh or picture -> its SHA-256. writers: target -> digest of its code.
    """

    meshes: Mapping[str, str]
    writers: Mapping[str, str]


def sign(text: str, written: Written) -> str:
    """`robot.json` with the key `written`, which holds a digest of the whole file."""
    robot: dict[str, Any] = json.loads(text)  # Any: plain JSON
    robot[KEY] = {"meshes": dict(written.meshes), "writers": dict(written.writers)}
    robot[KEY]["digest"] = _digest(robot)
    return json.dumps(robot, separators=(",", ":")) + "\n"


def read_signed(bundle: Path) -> tuple[Written, str, str] | None:
    """Return the record, its stated digest and the computed one; None for an earlier version."""
    robot = json.loads((bundle / "report/robot.json").read_bytes())
    signature = robot.get(KEY)
    if not isinstance(signature, dict):
        return None
    parts = [signature.get(name) for name in ("meshes", "writers")]
    meshes, writers = (part if isinstance(part, dict) else {} for part in parts)
    return Written(meshes, writers), str(signature.get("digest")), _digest(robot)


def code_digest(modules: Mapping[str, str]) -> str:
    """One digest for the modules that a step computes with. modules: name -> digest."""
    return digest_bytes(canonical_json(dict(modules)))


def _digest(robot: Mapping[str, Any]) -> str:  # Any: plain JSON
    """The digest of all parts but itself; the parts may come in any order, not what is in them."""
    parts = {name: value for name, value in robot.items() if name != KEY}
    parts[KEY] = {name: value for name, value in robot[KEY].items() if name != "digest"}
    digests = {name: digest_bytes(json.dumps(part).encode()) for name, part in parts.items()}
    return digest_bytes(canonical_json(digests))
