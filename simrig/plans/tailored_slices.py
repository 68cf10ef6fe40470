"""Slices placed for the highlights that one picture shows (thesis section 3.1.5)."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from simrig.core.errors import SimrigError
from simrig.core.options import Option, numbers_of
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement, optimal_placement
from simrig.plans.protocol import THETA_MAX, largest_theta_deg

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

# polar angle and azimuth steps, finest first: anisotropy calls for azimuths before polar angles
_STEPS = ((14.0, 36.0), (16.0, 36.0), (20.0, 36.0), (20.0, 60.0), (28.0, 60.0))
_CROSSINGS = 0.8  # of the samples, at most: the others follow f_r along the slices


class TailoredSlices(SlicePlan):
    """Makes a ``SlicePlan``, as which it is measured and stored.

    Thesis Table 5.1 places slices for all materials alike, isotropic ones with them, and leaves
    steps of azimuth wide. Where a picture shows highlights, these are the finest azimuth steps
    whose crossings leave samples to adapt; where it shows none, Table 5.1 holds.
    """

    name: ClassVar[str] = "tailored-slices"
    about: ClassVar[str] = "slices placed for highlights that one picture under the reflector shows"
    options: ClassVar[tuple[Option, ...]] = (
        Option("samples", int, "Distinct direction pairs.", 8911, least=1, short="-n"),
        Option("axes", str, "Azimuths of the highlights, degrees, with commas; 'none' of none."),
        THETA_MAX,
    )

    @classmethod
    def for_material(  # type: ignore[override]
        cls,
        material: Brdf | None = None,
        *,
        samples: int = 8911,
        axes: str | None = None,
        theta_max_deg: float | None = None,
    ) -> SlicePlan:
        """Return the plan that options give.

        Raises:
            SimrigError: no axes, too few samples, or what cannot be.
        """
        if axes is None:
            raise SimrigError(
                "plan 'tailored-slices' needs --axes, the azimuths of the highlights, or 'none': "
                "'simrig reflector analyse' finds them in a picture"
            )
        end = largest_theta_deg(material, theta_max_deg)
        placement = optimal_placement(samples, end)
        if axes != "none" and numbers_of(axes, "axes", float):
            finer = (SlicePlacement.from_degrees(min(e, end), a, end) for e, a in _STEPS)
            fitting = (own for own in finer if own.intersections <= _CROSSINGS * samples)
            own = next(fitting, placement)
            placement = min(placement, own, key=lambda p: p.azimuth_step)
        return SlicePlan(placement, samples)
