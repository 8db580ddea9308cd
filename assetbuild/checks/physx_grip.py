"""Does each gripper hold objects in PhysX as well?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Self

from assetbuild.engine.step import Files, Limits
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, RecipeView, write_figures
from assetbuild.simulators import mujoco, physx
from assetbuild.simulators.mujoco_grip import hands_of, named, tries_of, with_object
from assetbuild.simulators.physx_grip import grips

LOST = Rule(
    "physx.grip",
    "warning",
    "a gripper loses an object in PhysX, or lets it slip",
    "more effort, collision pieces that do not fill the space between the fingers",
)


class PhysxGripping(Check):
    """Does in PhysX what `grip` does in MuJoCo, whose model says where the objects lie.

    Figures by palm: of each object the slip in m.
    """

    usual_s = 60.0
    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    reads: ClassVar[tuple[str, ...]] = ()
    requires: ClassVar[Mapping[str, str]] = physx.REQUIRES
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = physx.PRELOAD
    limits: ClassVar[Limits] = Limits(wall_s=1200.0, memory_mb=16384)

    engines: ClassVar[tuple[str, ...]] = ("physx",)
    told: ClassVar[Mapping[str, str]] = {
        key: f"validate.grip.{key}" for key in ("masses", "slip", "keyframes")
    }

    robot: str
    masses: tuple[float, ...] = (0.1, 0.5)
    """kg."""
    slip: float = 0.002
    """m."""
    keyframes: tuple[str, str] | None = None

    @classmethod
    def configure(cls, recipe: RecipeView) -> Self | None:
        """Only where `grip` is wanted."""
        return super().configure(recipe) if recipe.value("validate.grip") else None

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjcf/<robot>.xml` and `usd/<robot>.usda`."""
        main = files.inputs / f"usd/{self.robot}.usda"
        figures: dict[str, object] = {}
        try:
            with mujoco.caught_warnings():
                model = with_object(files.inputs / f"mjcf/{self.robot}.xml")
                hands = hands_of(model, self.keyframes)
        except StepError as error:
            write_figures(files, {"skipped": error.message})  # `grip.hand` says why
            return
        for hand in hands:
            palm = mujoco.name_of(model, "body", hand.palm)
            tries = tries_of(model, hand, self.masses)
            held = grips(main, model, hand, tries, self.limits.wall_s / 2.0)
            rows, failed = [], []
            for (place, mass), one in zip(tries, held, strict=True):
                slip = one.slip_m if one.held else None
                seat = one.seat_m if one.held else None
                rows.append({"shape": place.shape, "mass_kg": mass, "slip_m": slip, "seat_m": seat})
                if slip is None or slip > self.slip:
                    did = f"slips by {1e3 * slip:.3g} mm" if slip is not None else "is lost"
                    failed.append(f"{named(place, mass)} {one.failure or did}")
            figures[palm] = rows
            if failed:
                yield LOST(
                    f"link {palm}",
                    f"PhysX: of {len(tries)} objects its gripper does not hold {len(failed)}: "
                    + ", ".join(failed),
                    data={"failed": len(failed), "of": len(tries), "limit_m": self.slip},
                )
        write_figures(files, figures, {"slip_m": self.slip})
