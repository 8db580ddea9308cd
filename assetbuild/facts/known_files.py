"""Files that hold what the robot's own hold, because they have the same bytes.

The robot's meshes and pictures are measured once in a build. A copy of one in a format's folder
needs no second reading: its bytes are compared instead. `validate` knows no bytes and reads all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from assetbuild.engine.digest import digest_bytes
from assetbuild.facts.surface import Surface


@dataclass(frozen=True)
class KnownFiles:
    """surfaces, pixels: what the robot's files hold, by the digest of their bytes.

    A surface is in the frame of its file; pixels are the digest of a picture's pixels.
    """

    surfaces: Mapping[str, Surface] = field(default_factory=dict)
    pixels: Mapping[str, str] = field(default_factory=dict)

    def surface(self, data: bytes) -> Surface | None:
        """The mesh in a file with these bytes; None of other bytes than the robot's."""
        return self.surfaces.get(digest_bytes(data)) if self.surfaces else None

    def picture(self, data: bytes) -> str | None:
        """The digest of the pixels in a file with these bytes; None as above."""
        return self.pixels.get(digest_bytes(data)) if self.pixels else None
