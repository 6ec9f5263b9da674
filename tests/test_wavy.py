"""Marks where somebody measured them: a wavy sheet in a scene, and its shape found again from images."""

from dataclasses import replace

import numpy as np
import pytest

from testfield.author.twin_compare import fitted
from testfield.author.twin_shape import shape_of
from testfield.calibrate.calibration import Calibration
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.project import project
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.scene.build import build_world
from testfield.scene.frames import camera_looking
from testfield.scene.schema import SceneFile

COLUMNS, ROWS, PITCH = 6, 5, 25.0
STATION = {"generator": "single", "position_mm": [0, 0, 400], "look_at_mm": [0, 0, 0]}
CAMERA = {"width_px": 640, "height_px": 480, "pixel_pitch_um": 5.0, "focal_length_mm": 8.0, "f_number": 8}


def scene_of(**board: object) -> SceneFile:
    flat = {"name": "a", "size_mm": [300, 250], "position_mm": [0, 0, 0], "normal": [0, 0, 1], "print_sigma_mm": 0}
    return SceneFile.model_validate(
        {
            "name": "wavy",
            "volume": {"size_mm": [300, 250, 10]},
            "u_print_scale_ppm": 0,
            "camera": CAMERA,
            "room": {"ambient_w_m2_sr": 1},
            "boards": [flat | board],
            "stations": [STATION],
        }
    )


CIRCLES = {"kind": "circles", "columns": COLUMNS, "rows": ROWS, "pitch_mm": PITCH, "diameter_mm": 10}


def test_marks_of_a_wavy_sheet_are_where_they_were_measured() -> None:
    off = np.random.default_rng(0).normal(0, 0.3, (COLUMNS * ROWS, 3))
    flat = build_world(scene_of(pattern=CIRCLES)).mark_world_mm
    world = build_world(scene_of(pattern=CIRCLES, marks_off_mm=off.tolist()))
    found = np.linalg.inv(world.world_from_board.R[0]) @ (world.mark_world_mm - flat).T
    assert pytest.approx(off, abs=1e-9) == found.T
    assert world.field.boards[0].marks.xy_mm == pytest.approx(
        build_world(scene_of(pattern=CIRCLES)).field.boards[0].marks.xy_mm
    )
    # No piece reaches through the ground behind it.
    ground, local = world.panels.world_from_panel.t_mm[0], world.panels.world_from_panel
    for k in np.unique(world.marks.panel):
        corners = local.t_mm[k] + (world.panels.size_mm[k] / 2 * [[1, 1], [1, -1], [-1, 1], [-1, -1]]) @ (
            local.R[k][:, :2].T
        )
        assert (corners[:, 2] > ground[2]).all()


def test_another_number_of_places_than_marks_is_refused() -> None:
    with pytest.raises(TestfieldError, match="30"):
        build_world(scene_of(pattern=CIRCLES, marks_off_mm=[[0, 0, 0]]))


def test_dots_and_codes_lie_where_they_are_listed() -> None:
    dots, codes = [[-60, 20], [10, -70]], [[0, 60], [80, 10]]
    world = build_world(
        scene_of(
            extension_zone={"diameter_mm": 8, "places_mm": dots},
            recognition_zone={"diameter_mm": 9, "codes": [5, 7], "places_mm": codes},
        )
    )
    assert world.marks.code.tolist() == [5, 7, 0, 0]
    assert world.marks.xy_mm == pytest.approx(np.array([*codes, *dots], float))


def test_the_shape_of_a_sheet_is_found_from_images_alone() -> None:
    rng = np.random.default_rng(1)
    k = np.arange(COLUMNS * ROWS)
    nominal = PITCH * np.column_stack([k % COLUMNS, k // COLUMNS, 0 * k]).astype(float)
    off, sigma_px = rng.normal(0, [0.2, 0.2, 0.5], (len(k), 3)), 0.005
    interior = Interior(640, 480, np.array([900.0, 900, 320, 240, -0.05, 0.02, 0, 0, 0]))
    middle = nominal.mean(axis=0)
    places = middle + np.array([[-90, -60, -260], [90, -70, -250], [80, 90, -270], [-80, 80, -240], [0, 0, -220]])
    posed = [camera_looking(p, middle, r) for p, r in zip(places, (0, 1.5, 3, 0.7, 2.2), strict=True)]
    stations = Poses(np.array([R for R, _ in posed]), np.array([t for _, t in posed]))
    xy = np.concatenate([project(interior, stations[np.full(len(k), s)], nominal + off) for s in range(len(places))])
    n, names = len(xy), tuple(f"s{i}" for i in range(len(places)))
    observations = Observations(
        stations=names,
        station=np.repeat(np.arange(len(names)), len(k)),
        xy_px=xy + rng.normal(0, sigma_px, (n, 2)),
        cov_px2=np.tile(sigma_px**2 * np.eye(2), (n, 1, 1)),
        moments_px2=np.full((n, 2, 2), np.nan),
        code=np.zeros(n, int),
        board=np.zeros(n, int),
        point=np.tile(k, len(names)),
        chi2=np.ones(n),
        status=np.full(n, MEASURED, object),
        centre_of_disc=False,
    )
    told = Calibration("x", interior, names, stations, (), Poses.identity(0), 1.0, np.zeros((0, 0)), (), 1.0, 1, 0.1, n)
    shape = shape_of(told, observations, nominal, ("k3",))
    assert shape is not None
    # The true places less what no image tells: seven parameters.
    true = fitted(nominal + off, nominal) - nominal
    assert shape.off_mm == pytest.approx(true, abs=0.05)
    assert shape.scatter_px < 3 * sigma_px
    assert shape_of(replace(told, station_names=names[:3]), observations, nominal) is None
