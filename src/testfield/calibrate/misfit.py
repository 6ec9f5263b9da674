"""What an adjustment's model does not follow, as far as residuals show it: the lens, how flat boards are, the size of
what is white."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.network import Network
from testfield.adjust.reliability import global_test
from testfield.calibrate.between_images import between_images
from testfield.calibrate.calibration import Calibration
from testfield.calibrate.lens_misfit import SIGNIFICANT, LensMisfit, lens_misfit, with_lens_misfit
from testfield.calibrate.unflat_boards import unflat, with_heights
from testfield.errors import TestfieldError

ROUNDS = 3
"""How often at most observations are scaled until they scatter as they claim, or the model is asked again."""

Names = Callable[[Network], list[str]]
"""Names of the unknowns of a network."""


@dataclass(frozen=True)
class Misfit:
    """A smooth field of the `lens`, if any; `unflat_mm`, the standard deviation of marks' heights above their boards,
    0 where sheets are right; `variance` by which observations' covariances are multiplied, 1 where claims are;
    `between` by which the variance of what observations do to cameras and stations is multiplied besides, because
    images contradict each other more than points do."""

    lens: LensMisfit | None = None
    unflat_mm: float = 0.0
    variance: float = 1.0
    between: float = 1.0

    @property
    def found(self) -> bool:
        """Whether the model fails in anything."""
        return self.lens is not None or self.unflat_mm > 0

    @property
    def notes(self) -> list[str]:
        """What a reader is told."""
        said = [self.lens.note] if self.lens else []
        if self.unflat_mm:
            said.append(
                f"boards are not flat: their marks stand off by {self.unflat_mm:.2g} mm (standard deviation), which is "
                "found from the residuals and corrected; what is left of it is in all uncertainties"
            )
        return said

    @property
    def card(self) -> dict:
        """The figures under their stable keys; empty where the model fails in nothing."""
        lens = self.lens.card if self.lens else {}
        flat = {"unflat_mm": self.unflat_mm} if self.unflat_mm else {}
        between = {"between_images": self.between} if self.between > 1 else {}
        return lens | flat | ({"widened": self.variance} if self.found else {}) | between

    @staticmethod
    def of(calibration: Calibration) -> "Misfit":
        """What a calibration had found."""
        card, modes = calibration.misfit, calibration.interior.modes_px
        lens = None
        if modes is not None:
            lens = LensMisfit(
                card["s_px"], card["length_px"], card["variance"], card["rise"], modes, card.get("field_between", 1.0)
            )
        return Misfit(lens, card.get("unflat_mm", 0.0), card.get("widened", 1.0), card.get("between_images", 1.0))

    def applied(self, network: Network, names: Names) -> Network:
        """A network with all this in its model, at its new minimum but for second-order terms."""
        wide = replace(network, cov_px2=self.variance * network.cov_px2)
        if self.unflat_mm:
            wide = with_heights(wide, self.unflat_mm)
        return with_lens_misfit(wide, self.lens, names) if self.lens else wide


NO_MISFIT = Misfit()


def misfit_of(adjustment: Adjustment, names: Names, freedom: int) -> Misfit:
    """What residuals show that the model of an adjustment without any misfit does not follow.

    The lens is always asked; boards only where observations scatter more than they claim. Where both fail, the worse
    comes first and the other is asked with the first in the model.
    """
    try:
        return _asked(adjustment, names, freedom)
    except TestfieldError:  # too little is left of the observations to ask for more
        return NO_MISFIT


def _asked(adjustment: Adjustment, names: Names, freedom: int) -> Misfit:
    network = adjustment.network
    excess = excess_of(adjustment)
    base = replace(network, cov_px2=excess * network.cov_px2)
    lens = _lens(base, names, freedom)
    heights = unflat(base, names(base), freedom) if excess > 1 else None
    if heights is None or heights.rise < SIGNIFICANT:
        return _scaled(Misfit(lens), network, names)
    if lens is not None and lens.rise > heights.rise:
        first, scale = _with(Misfit(lens), network, names)
        heights = unflat(first, names(first), freedom)
        if heights is None or heights.rise < SIGNIFICANT:
            return replace(Misfit(lens), variance=scale)
    flat = Misfit(None, heights.s_mm)
    second, _ = _with(flat, network, names)
    return _scaled(replace(flat, lens=_lens(second, names, freedom)), network, names)


def _lens(network: Network, names: Names, freedom: int) -> LensMisfit | None:
    """The lens' field as far as it is the same in all images: what is alike within a mark or an image only, looks like
    a field to a likelihood that takes every observation for white, and images contradict each other in it then."""
    found = lens_misfit(network, names(network), freedom)
    if found is None:
        return None
    white = replace(network, cov_px2=found.variance * network.cov_px2)
    wide = with_lens_misfit(white, found, names)
    seen = between_images(adjust(wide, names(wide)), field=True)
    if seen is None or seen.excess == 1:
        return found
    return lens_misfit(network, names(network), freedom, seen.excess)


def excess_of(adjustment: Adjustment) -> float:
    """By how much more observations scatter than they claim: their variance factor, 1 where that is by chance."""
    test = global_test(adjustment)
    return test.variance if test.variance > max(test.high, 1.0) else 1.0


def widened(adjustment: Adjustment, names: Names) -> tuple[Adjustment, float]:
    """The adjustment with covariances of the observations' scatter where that is larger than claimed, and by which
    factor."""
    factor = 1.0
    for _ in range(ROUNDS):  # what is known beside the observations is not widened with them
        excess = excess_of(adjustment)
        if excess == 1.0:
            break
        factor *= excess
        network = adjustment.network
        adjustment = adjust(replace(network, cov_px2=excess * network.cov_px2), names(network))
    return adjustment, factor


def widened_by_images(
    adjustment: Adjustment, misfit: Misfit, given: Misfit | None, empirical: bool
) -> tuple[Adjustment, Misfit, list[str]]:
    """The adjustment with covariances that hold what differs from image to image, the misfit with that, and what a
    reader is told. Of some of the images the factor of all of them, if it is `given`: few images say little of it.

    What is widened are the unknowns that many observations of an image share, and points as far as they follow them:
    one point has one ray from an image, in whose scatter everything is, and images agree on where it lies. The camera
    is asked where uncertainties are `empirical`; on the lens' field images were asked when it was found."""
    seen = between_images(adjustment) if empirical and not given else None
    factor = given.between if given else max(seen.excess if seen else 1.0, misfit.lens.between if misfit.lens else 1.0)
    if factor > 1:
        adjustment = replace(adjustment, cov=adjustment.cov.widened(adjustment.network, factor))
    said = [
        f"images differ from each other {np.sqrt(factor):.1f} times as much as their points' scatter explains (a "
        "target that bends or moves from image to image, focus): what they share is as uncertain as they show it"
    ]
    return adjustment, replace(misfit, between=factor), said if factor > 1 else []


def _scaled(misfit: Misfit, network: Network, names: Names) -> Misfit:
    return replace(misfit, variance=_with(misfit, network, names)[1]) if misfit.found else misfit


def _with(misfit: Misfit, network: Network, names: Names) -> tuple[Network, float]:
    """An adjusted network with a misfit in its model and covariances of its scatter, and their factor."""
    wide = misfit.applied(network, names)
    found, factor = widened(adjust(wide, names(wide)), names)
    return found.network, factor


def scatter_note(factor: float) -> str:
    """What is said where covariances were multiplied by a factor."""
    return (
        f"observations scatter {np.sqrt(factor):.2f} times as much as detection claims; all uncertainties are "
        "those of their scatter"
    )
