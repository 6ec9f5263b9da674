"""Cameras, sensors and light of a twin: as the calibration and the photographs tell them."""

from typing import Any

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.measure.seen import Seen
from testfield.sensor.expose import Sensor

PITCH_UM, F_NUMBER, TIME_MS, WAVELENGTH_NM, EFFICIENCY = 3.45, 8.0, 10.0, 550.0, 0.5
"""What no image tells, and what cancels: light is made such that the electrons are those seen."""
WHITE, LEAST_BLACK, MOST_WALL = 0.85, 0.005, 0.9
"""Albedo of white, which no image tells either, and the limits of what is black and of the wall."""
MOST_FIELD_PX, MOST_BLUR_PX = 5.0, 5.0
"""What a scene takes."""


def cameras(calibration: Calibration, seen: tuple[Seen, ...], notes: list[str]) -> dict[str, Any]:
    """The camera of a scene, or its several cameras, each with the sensor and the exposure that its `seen` asks for."""
    field_px = calibration.misfit.get("rms_px", 0.0)
    if field_px:
        notes.append("what the lens model did not follow is a smooth field of the same size, but drawn anew")
    if field_px > MOST_FIELD_PX:
        notes.append(
            f"that field has {field_px:.2g} px rms; the twin's has {MOST_FIELD_PX:g} px, as scenes allow no more"
        )
    for one in seen:
        if one.blur_px > MOST_BLUR_PX:
            notes.append(f"blur of {one.blur_px:.2g} px is {MOST_BLUR_PX:g} px in the twin, as scenes allow no more")
    parts = [_camera(calibration, k, one) for k, one in enumerate(seen)]
    if not calibration.more_cameras:
        return {"camera": parts[0], "sensor": _sensor(seen[0]), "exposure": {"time_ms": TIME_MS}}
    brightest = _ambient(seen[0])
    named = [
        part
        | {
            "name": calibration.camera_names[k],
            "sensor": _sensor(seen[k]),
            "exposure": {"time_ms": TIME_MS * _ambient(seen[k]) / brightest},
        }
        for k, part in enumerate(parts)
    ]
    return {"cameras": named}


def light(
    seen: Seen, normal: np.ndarray, offset: float, extent: float, calibration: Calibration, notes: list[str]
) -> dict[str, Any]:
    """Even light in which white is as bright as it was, black as dark, and a wall behind a flat field as the images."""
    bright, dark = max(seen.ink_dn, seen.ground_dn), min(seen.ink_dn, seen.ground_dn)
    room: dict[str, Any] = {"ambient_w_m2_sr": _ambient(seen)}
    if (calibration.stations.origin_mm @ normal > offset).all():
        wall = float(np.clip(WHITE * seen.elsewhere_dn / bright, 0.02, MOST_WALL))
        room["surfaces"] = [
            {
                "name": "behind",
                "size_mm": [20 * extent] * 2,
                "position_mm": (normal * (offset - 0.06 * extent)).tolist(),
                "normal": normal.tolist(),
                "albedo": wall,
            }
        ]
    else:
        notes.append("no wall is behind the field: it would hide it from a station")
    black = float(np.clip(WHITE * dark / bright, LEAST_BLACK, WHITE * 0.98))
    return {"paint": {"white": WHITE, "black": black, "white_on_black": seen.white_on_black}, "room": room}


def _camera(calibration: Calibration, k: int, seen: Seen) -> dict[str, Any]:
    inner = calibration.interiors[k].without_modes
    middle = ((inner.width_px - 1) / 2, (inner.height_px - 1) / 2)
    given = dict(zip(inner.names[4:], (float(v) for v in inner.coefficients), strict=True))
    camera: dict[str, Any] = {
        "width_px": inner.width_px,
        "height_px": inner.height_px,
        "pixel_pitch_um": PITCH_UM,
        "focal_length_mm": float(inner.fx) * PITCH_UM / 1000,
        "aspect": float(inner.fy / inner.fx),
        "principal_point_offset_px": [float(inner.cx) - middle[0], float(inner.cy) - middle[1]],
        "lens": inner.model,
        **{key: value for key, value in given.items() if value},
        "f_number": F_NUMBER,
        "psf_sigma_px": float(min(seen.blur_px, MOST_BLUR_PX)),
    }
    if calibration.misfit.get("rms_px"):
        camera["residual_field"] = {"rms_px": float(min(calibration.misfit["rms_px"], MOST_FIELD_PX)), "seed": k}
    return camera


def _sensor(seen: Seen) -> dict[str, Any]:
    return {
        "bits": int(max(seen.bits, 8)),
        "quantum_efficiency": EFFICIENCY,
        "wavelength_nm": WAVELENGTH_NM,
        "full_well_e": float(seen.full_dn * seen.gain_e_per_dn),
        "read_noise_e": float(seen.read_noise_e),
        "gain_e_per_dn": float(seen.gain_e_per_dn),
        "black_level_dn": 0.0,
    }


def _ambient(seen: Seen) -> float:
    """Radiance of even light in W/(m^2 sr) under which white is as bright as it was, exposed for `TIME_MS`."""
    full_well_e = seen.full_dn * seen.gain_e_per_dn
    sensor = Sensor(
        PITCH_UM, F_NUMBER, TIME_MS, WAVELENGTH_NM, EFFICIENCY, full_well_e, 0.0, seen.gain_e_per_dn, 0.0, seen.bits
    )
    bright = max(seen.ink_dn, seen.ground_dn)
    return float(bright * seen.gain_e_per_dn / (WHITE * sensor.electrons_per_radiance))
