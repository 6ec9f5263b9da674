"""The ruler's own error: what the images may err by the certificate, and which figures stand above it."""

from dataclasses import dataclass
from typing import Any

from testfield.evaluate.metrics import Metric

UNKNOWN, ABOVE, BELOW, NONE = "not certified", "above", "below", ""


@dataclass(frozen=True)
class Floor:
    """`px`, rms of what centres in the images may be off, None where nothing is certified; `um` the same in space at
    the targets; `sentence` for a page."""

    px: float | None
    um: float | None
    sentence: str

    @staticmethod
    def of(certificate: dict[str, Any] | None, ground_um_per_px: float) -> "Floor":
        """The floor by a certificate as `floor_of` gives it, None for none."""
        if certificate is None or certificate["centre_floor_px"] is None:
            return Floor(
                None,
                None,
                "No certificate lies beside this comparison's folder: what the images themselves may err is not known "
                "here. testfield certify writes one.",
            )
        px = float(certificate["centre_floor_px"])
        um = px * ground_um_per_px if ground_um_per_px == ground_um_per_px else None
        doubt = "" if certificate["valid"] else " It was made with another version of the renderer."
        space = "" if um is None else f", which is {um:.3g} um at the targets"
        return Floor(
            px,
            um,
            f"Centres in these images are true to {px:.5f} px rms by the certificate beside this folder{space}.{doubt}",
        )

    def side(self, metric: Metric, value: float) -> str:
        """Whether a figure, or a difference, of a metric stands above the floor; nothing is said of counts."""
        if not metric.floor or value != value:
            return NONE
        floor = {"px": self.px, "um": self.um}.get(metric.unit)
        if floor is None:
            return UNKNOWN
        return ABOVE if abs(value) > floor else BELOW
