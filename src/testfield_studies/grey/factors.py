"""What is varied to find what drives accuracy: eleven factors, one dummy, and the scene that they change.

The scene is small, so that hundreds of it can be rendered: a board, a control bar and ten check targets before half a
megapixel, none of them ever before another. Its true lens is a pinhole but for what two of the factors add, and
calibration holds all distortion at zero: what they add is left uncorrected. Boards are printed exactly and the bar is
as long as its certificate says, because every run has noise and a workshop of its own: where the marks were printed,
the boards' scale and the bar's length are drawn anew (`testfield_studies.grey.runs`). The sensor's well is deep, so
that shot noise is not most of it.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Factor:
    """A factor from `low` to `high`. `more_is_worse` is what a practitioner would say beforehand.

    `pictures` tells whether it changes what is rendered.
    """

    name: str
    low: float
    high: float
    more_is_worse: bool = True
    pictures: bool = True
    whole: bool = False

    def level(self, unit: np.ndarray | float) -> Any:
        """Levels at places from 0 to 1."""
        if self.whole:  # every number has the same share
            return np.clip(np.floor(self.low + np.asarray(unit) * (self.high - self.low + 1)), self.low, self.high)
        return self.low + np.asarray(unit) * (self.high - self.low)


DUMMY = "dummy"
FACTORS = (
    Factor("image noise, e", 20, 500, pictures=False),
    Factor("target diameter, mm", 14, 22, more_is_worse=False),
    Factor("blur, px", 0.5, 1.3),
    Factor("light from one side, share", 0, 0.8),
    Factor("stations", 4, 8, more_is_worse=False, whole=True),
    Factor("half convergence, deg", 15, 40, more_is_worse=False),
    Factor("distance, mm", 1750, 2500),
    Factor("radial distortion, 1e-3", 0, 2),
    Factor("tangential distortion, 1e-4", 0, 3),
    Factor("scale bar, mm", 300, 700, more_is_worse=False),
    Factor("bow of the board, um", 0, 80),
    Factor(DUMMY, 0, 1, pictures=False),
)
NAMES = tuple(factor.name for factor in FACTORS)
WORKSHOP = {"print_mm": 0.003, "scale_ppm": 100.0, "bar_mm": 0.01}
"""Standard deviations of each coordinate of each mark, of the boards' common scale, of the bar's length. The boards'
scale is so uncertain that a measurement's scale is the bar's."""


def levels_of(unit: np.ndarray) -> dict[str, float]:
    """The factors' levels at a place (12,) of the unit cube."""
    return {factor.name: float(factor.level(u)) for factor, u in zip(FACTORS, unit, strict=True)}


def scene_of(levels: dict[str, float]) -> dict[str, Any]:
    """The scene with some levels, as a plain table. Image noise and the dummy change nothing in it."""
    diameter, share = levels["target diameter, mm"], levels["light from one side, share"]
    lights = (
        []
        if share == 0
        else [
            {
                "kind": "area",
                "size_mm": [300, 300],
                "position_mm": [-1000, -700, 700],
                "normal": [1, 0.7, 0],
                "radiance_w_m2_sr": 8.8 * share,
            }
        ]
    )
    return {
        "name": "grey",
        "seed": 3,
        "u_print_scale_ppm": 0.0,
        "volume": {"size_mm": [900, 300, 700]},
        "camera": {
            "width_px": 800,
            "height_px": 640,
            "pixel_pitch_um": 4.8,
            "focal_length_mm": 6.5,
            "f_number": 5.6,
            "psf_sigma_px": levels["blur, px"],
            "k1": -1e-3 * levels["radial distortion, 1e-3"],
            "p1": 1e-4 * levels["tangential distortion, 1e-4"],
        },
        "sensor": {"full_well_e": 104000, "gain_e_per_dn": 26, "read_noise_e": 20.0},
        "exposure": {"time_ms": 80.0},
        "room": {"ambient_w_m2_sr": 1.1 * (1 - share), "lights": lights},
        "boards": [
            {
                "name": "A",
                "size_mm": [640, 460],
                "position_mm": [0, 60, 600],
                "normal": [0, -1, 0],
                "bow_mm": 1e-3 * levels["bow of the board, um"],
                "print_sigma_mm": 0.0,
                "extension_zone": {
                    "columns": 5,
                    "rows": 4,
                    "pitch_mm": 90,
                    "diameter_mm": diameter,
                    "centre_mm": [100, 0],
                },
                "recognition_zone": {
                    "columns": 2,
                    "rows": 3,
                    "pitch_mm": 120,
                    "diameter_mm": diameter,
                    "centre_mm": [-205, 0],
                    "first_code": 1,
                },
            }
        ],
        "scale_bars": [
            {
                "name": "bar",
                "role": "control",
                "length_mm": levels["scale bar, mm"],
                "u_length_mm": 0.0,
                "codes": [101, 102],
                "diameter_mm": diameter,
                "position_mm": [0, -150, 265],
            }
        ],
        "check_targets": [
            {"generator": "single", "code": 201 + k, "position_mm": list(place), "diameter_mm": diameter}
            for k, place in enumerate(CHECK_MM)
        ],
        "stations": _stations(
            int(levels["stations"]), math.radians(levels["half convergence, deg"]), levels["distance, mm"]
        ),
        "render": {"cells": 2, "light_paths": 256, "light_spacing_mm": 200},
        "measure": {"hold": ["k1", "k2", "k3", "p1", "p2"], "smallest_diameter_px": 4.0},
    }


CHECK_MM = (
    (-280, -120, 865),
    (-140, -90, 870),
    (0, -80, 865),
    (140, -100, 870),
    (280, -130, 865),
    (-280, 30, 385),
    (-140, 0, 380),
    (0, -20, 385),
    (140, -10, 380),
    (280, 20, 385),
)
MIDDLE_MM = (0.0, 0.0, 577.0)


def _stations(count: int, half: float, distance_mm: float) -> list[dict[str, Any]]:
    """Stations from left to right, high and low in turn, each turned by a quarter against the one before."""
    found = []
    for k in range(count):
        azimuth, elevation = half * (2 * k / (count - 1) - 1), math.radians(18 if k % 2 else -12)
        off = (
            math.cos(elevation) * math.sin(azimuth),
            -math.cos(elevation) * math.cos(azimuth),
            math.sin(elevation),
        )
        found.append(
            {
                "generator": "single",
                "look_at_mm": list(MIDDLE_MM),
                "roll_deg": [90 * (k % 4)],
                "position_mm": [round(m + distance_mm * o, 6) for m, o in zip(MIDDLE_MM, off, strict=True)],
            }
        )
    return found
