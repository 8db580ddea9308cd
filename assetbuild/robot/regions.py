"""Places on a link that collision geometry must respect."""

from __future__ import annotations

from pydantic import Field

from assetbuild.quantities import Length, Model, Real

Point = tuple[Real, Real, Real]


class Region(Model):
    """A place in the frame of the link: a ball, or a capsule from one point to another."""

    from_: Point = Field(alias="from", description="x, y, z in the frame of the link, m")
    to: Point | None = Field(None, description="the other end, m; without it a ball at `from`")
    radius: Length = Field(0.0, description="about the line, `2 mm` or m; 0: the line itself")

    @property
    def ends(self) -> tuple[Point, Point]:
        """Both ends of its axis, m."""
        return self.from_, self.to or self.from_


class ToleranceRegion(Region):
    """A place where collision must follow the mesh more closely."""

    max_outside: Length = Field(description="most that collision may stick out there, `1 mm` or m")
