"""Whether photographs fit the model that explains them: what fails no test, and must stand beside the verdict."""

from testfield.calibrate.settled import NOT_CONVERGED
from testfield.measure.photographs import Measurement
from testfield.registry import names
from testfield.uncertainty.halves import NAMES, TOO_FAR

LARGEST_SIGMA0 = 3.0
"""Residuals over claims from which on they are more than a little too bold: the model misses something."""
LARGEST_FIELD_PX = 1.0
"""What lenses do beside their model is less than a pixel; a larger field stands for a model of another kind, and trades
with the focal length."""
LEAST_JOINED = 0.75
"""The part of the photographs below which what was left out says as much as what was used."""


def doubts_of(result: Measurement) -> tuple[str, ...]:
    """Sentences on what makes a measurement doubtful though nothing failed; empty where nothing does."""
    c, given = result.calibration, (*result.observations.stations, *result.unread)
    said = []
    if any(note.startswith(NOT_CONVERGED) for note in c.notes):
        said.append(
            f"{NOT_CONVERGED}: what it gives is no least-squares solution, and its uncertainties are of no worth"
        )
    if (field_px := float((c.misfit or {}).get("rms_px", 0.0))) > LARGEST_FIELD_PX:
        others = ", ".join(name for name in names("lenses") if name != c.interior.model)
        said.append(
            f"the lens model '{c.interior.model}' misses the images by {field_px:.1f} px: the field that makes up for "
            f"it trades with the focal length; try another one (--lens {others})"
        )
    if c.sigma0 > LARGEST_SIGMA0:
        said.append(
            f"residuals are {c.sigma0:.1f} times what detection claims: something is not in the model (a target that "
            "bends or moves, focus, motion, wrong places on the sheet); uncertainties are those of this scatter"
        )
    if far := [one for one in result.halves.differences if one.ratio > TOO_FAR]:
        worst = max(far, key=lambda one: one.ratio)
        said.append(
            f"halves of the photographs differ by {worst.ratio:.1f} times what is stated ({NAMES[worst.quantity]}): "
            "what is stated is too small"
        )
    left = [name for name in given if name not in c.station_names]
    if len(c.station_names) < LEAST_JOINED * len(given):
        said.append(
            f"{len(left)} of {len(given)} photographs are not used ({', '.join(left[:5])}{', ...' * (len(left) > 5)}): "
            "too little in common with the others, by another camera, zoomed, or not readable"
        )
    return tuple(said)
