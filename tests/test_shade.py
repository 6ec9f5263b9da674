"""The shade that one card throws upon another moves no centre."""

from pathlib import Path

import numpy as np
import pytest
import tomli_w

from testfield.camera.images import Frame, Radiance, SensorSheet
from testfield.chain.run import Run, begin
from testfield.chain.stages import run_stage
from testfield.detect import centre_ring
from testfield.detect.detect import detect
from testfield.scene.exposure import sensor_of
from testfield_studies.wls.field import AMBIENT_W_M2_SR

PITCH_MM, STEP_MM = 134.4, 25.0
FINE = 16
"""Steps of the converter in one of the sensor's: what is left of its rounding is far below any noise."""


@pytest.fixture(scope="module")
def staircase(tmp_path_factory: pytest.TempPathFactory) -> tuple[Frame, Run]:
    """Three cards edge to edge, each nearer than the last, in light from all sides; a frame without noise."""
    scene = {
        "name": "staircase",
        "seed": 5,
        "volume": {"size_mm": [500, 200, 200]},
        "camera": {
            "width_px": 640,
            "height_px": 400,
            "pixel_pitch_um": 4.5,
            "focal_length_mm": 9.0,
            "f_number": 5.6,
            "psf_sigma_px": 0.6,
        },
        "exposure": {"time_ms": 8.0},
        "room": {"ambient_w_m2_sr": AMBIENT_W_M2_SR},
        "boards": [
            {
                "name": "A",
                "size_mm": [450, 360],
                "position_mm": [0, 60, -400],
                "normal": [0, -1, 0],
                "extension_zone": {"columns": 3, "rows": 3, "pitch_mm": 110, "diameter_mm": 32, "centre_mm": [70, 0]},
                "recognition_zone": {
                    "columns": 1,
                    "rows": 3,
                    "pitch_mm": 120,
                    "diameter_mm": 32,
                    "centre_mm": [-155, 0],
                    "first_code": 1,
                },
            }
        ],
        "check_targets": [
            {
                "code": 61 + k,
                "position_mm": [(k - 1) * PITCH_MM, -k * STEP_MM, 0.0],
                "normal": [0, -1, 0.05],
                "diameter_mm": 32.0,
            }
            for k in range(3)
        ],
        "stations": [
            {"name": f"s{k}", "position_mm": [700.0 * (k - 1), -3200, 0], "look_at_mm": [0, 0, 0]} for k in (1, 2)
        ],
    }
    folder: Path = tmp_path_factory.mktemp("staircase")
    (folder / "scene.toml").write_text(tomli_w.dumps(scene))
    run, _ = begin(folder / "scene.toml", folder / "run", None, 1)
    run_stage(run, "render")
    light, sensor = Radiance.load(run.folder / "radiance/s1.exr"), sensor_of(run.scene)
    dn = light.values * sensor.electrons_per_radiance / sensor.gain_e_per_dn + sensor.black_level_dn
    s = sensor.sheet
    sheet = SensorSheet(s.gain_e_per_dn / FINE, s.read_noise_e, s.black_level_dn * FINE, 16, s.full_well_e, None)
    return Frame("s1", np.rint(dn * FINE).astype(np.uint16), sheet), run


def _worst_px(staircase: tuple[Frame, Run]) -> float:
    frame, run = staircase
    found = detect(frame, run.field, "forward_model", 4.0).measured
    true = {int(code): xy for code, xy in zip(run.world.marks.code, run.views.disc_px[0], strict=True)}
    seen = {int(code): xy for code, xy in zip(found.code, found.xy_px, strict=True)}
    return max(float(np.abs(seen[code] - true[code]).max()) for code in (61, 62, 63))


def test_the_shade_of_a_nearer_card_moves_no_centre(staircase: tuple[Frame, Run]) -> None:
    assert _worst_px(staircase) < 0.0015


def test_light_that_may_only_slope_and_bend_would_move_it(
    staircase: tuple[Frame, Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(centre_ring, "MOST_TWISTED", 1e-9)
    assert _worst_px(staircase) > 0.003
