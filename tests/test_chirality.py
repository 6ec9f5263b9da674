"""No board is seen from its back: mirrored images and exchanged coordinates are told, whatever the method."""

from dataclasses import replace

import numpy as np
import pytest

from testfield.calibrate.chirality import refuse_mirrored_points
from testfield.calibrate.edges import board_edges, front_only
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, rotation
from testfield.camera.project import project
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.registry import find
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import Marks

CAMERA = Interior(2448, 2048, np.array([2600, 2604, 1236, 1015, -0.1, 0.08, 0.0, 3e-4, -2e-4]))
MIDDLE = np.array([2447, 2047]) / 2
GRID = np.stack(np.meshgrid(np.linspace(-200, 200, 5), np.linspace(-150, 150, 4)), -1).reshape(-1, 2)
PLACES = ([-250.0, 0, 0], [250.0, 0, 40])
SHEET = Field(
    14,
    tuple(
        NominalBoard(name, Marks(GRID, np.full(20, 9.0), 1 + 20 * b + np.arange(20)), 0, 0)
        for b, name in enumerate("AB")
    ),
)
METHODS = ("zhang", "stitched", "tsai", "opencv", "opencv_ro", "self")


def seen() -> Observations:
    """Two boards from six stations, exactly."""
    xyz = np.vstack([np.column_stack([GRID, np.zeros(20)]) + place for place in PLACES])
    tilt = [[0.3, 0, 0], [-0.3, 0.2, 0], [0, 0.4, 0], [0, -0.4, 0.3], [0.3, 0.3, -0.2], [-0.25, -0.3, 1.5]]
    R = rotation(np.array(tilt)) @ rotation(np.array([np.pi, 0, 0]))
    poses = Poses(R, np.tile([0.0, 0, 1400], (6, 1)))
    s, k = (v.ravel() for v in np.meshgrid(np.arange(6), np.arange(40), indexing="ij"))
    xy = project(CAMERA, poses[s], xyz[k])
    n = len(s)
    return Observations(
        stations=tuple(f"s{i}" for i in range(6)),
        station=s,
        xy_px=xy,
        cov_px2=np.tile(9e-4 * np.eye(2), (n, 1, 1)),
        moments_px2=np.tile(9 * np.eye(2), (n, 1, 1)),
        code=1 + k,
        board=k // 20,
        point=k % 20,
        chi2=np.ones(n),
        status=np.full(n, MEASURED, object),
        centre_of_disc=False,
    )


def mirrored(rows: Observations, which: np.ndarray) -> Observations:
    xy = rows.xy_px.copy()
    xy[which, 0] = 2 * MIDDLE[0] - xy[which, 0]
    return replace(rows, xy_px=xy)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("how", ["exchanged", "mirrored"])
def test_a_mirrored_world_is_an_error_for_every_method(method: str, how: str) -> None:
    rows = seen()
    rows = replace(rows, xy_px=rows.xy_px[:, ::-1]) if how == "exchanged" else mirrored(rows, np.ones(len(rows), bool))
    with pytest.raises(TestfieldError, match="'A'"):
        find("calibrators", method)(rows, SHEET, 2448, 2448, "brown", ())


@pytest.mark.parametrize("method", ["stitched", "opencv", "zhang"])
def test_one_mirrored_image_is_left_out_by_its_name(method: str) -> None:
    rows = seen()
    found = find("calibrators", method)(mirrored(rows, rows.station == 2), SHEET, 2448, 2048, "brown", ())
    assert any("'s2'" in note for note in found.notes)
    assert "s2" not in found.station_names
    assert {r["station"] for r in found.rejected} == {"s2"}
    assert np.abs(found.interior.parameters - CAMERA.parameters).max() < 1e-2


def test_one_mirrored_sheet_is_left_out_by_its_name() -> None:
    marks = replace(SHEET.boards[1].marks, xy_mm=GRID[:, ::-1])
    field = replace(SHEET, boards=(SHEET.boards[0], replace(SHEET.boards[1], marks=marks)))
    edges, why, notes = board_edges(seen(), field, MIDDLE)
    assert set(edges.board.tolist()) == {0}
    assert (why[seen().board == 1] != "").all()
    assert (why[seen().board == 0] == "").all()
    assert any("'B'" in note for note in notes)


def test_what_is_seen_from_its_front_and_a_symmetric_grid_are_left_alone() -> None:
    rows = seen()
    _, why, notes = board_edges(rows, SHEET, MIDDLE)
    assert (why == "").all()
    assert not notes
    assert (front_only(rows, SHEET, MIDDLE)[0].status == MEASURED).all()
    circles = BoardPattern("circles", 5, 4, 100.0, 9.0)
    field = replace(SHEET, boards=tuple(replace(b, pattern=circles, size_mm=(600.0, 500.0)) for b in SHEET.boards))
    _, why, notes = board_edges(mirrored(rows, np.ones(len(rows), bool)), field, MIDDLE)
    assert (why == "").all()
    assert not notes


def test_points_certified_in_a_left_handed_frame_are_refused_and_flat_ones_are_not() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (9, 3)) * [800, 500, 200]
    turned = 0.4 * points @ rotation(np.array([0.4, -1, 2])).T + [10, 20, 30]
    refuse_mirrored_points(turned, points)
    refuse_mirrored_points(turned, np.vstack([points[:-1], points[-1] + 300]))  # one of them wrong
    with pytest.raises(TestfieldError):
        refuse_mirrored_points(turned, points * [1, -1, 1])
    flat = points * [1, 1, 0]
    refuse_mirrored_points(flat @ rotation(np.array([0.4, -1, 2])).T, flat * [1, -1, 1])
