"""Any lens, from pinhole to fisheye, on any sensor: no good mark is discarded, and misread ones are found."""

from dataclasses import replace

import numpy as np
import pytest

from testfield.calibrate.calibration import Calibration
from testfield.camera.interior import Interior
from testfield.camera.plane_image import fit_plane, rough_lens
from testfield.camera.pose import Poses, rotation
from testfield.camera.project import project_camera
from testfield.detect.identify import identify
from testfield.detect.observations import MEASURED, Observations
from testfield.registry import find
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import Marks

SIGMA_PX = 0.03


def lens(width: int, height: int, focal_px: float, model: str, aside: float, *coefficients: float) -> Interior:
    """A camera whose principal point is `aside` of the width and the height off the middle."""
    middle = [(width - 1) / 2 + aside * width, (height - 1) / 2 - aside * height]
    return Interior(width, height, np.array([focal_px, focal_px, *middle, *coefficients]), model)


LENSES = {
    "phone, 640 px": lens(640, 480, 520, "brown", 0.0, 0.1, -0.2, 0, 0, 0),
    "wide, 85 degrees": lens(1280, 960, 700, "brown", 0.005, -0.25, 0.06, -0.004, 0, 0),
    "full frame 20 mm, 60 Mpx": lens(9504, 6336, 5280, "brown", 0.003, -0.1, 0.03, -0.004, 1e-4, -1e-4),
    "150 Mpx, 23 mm": lens(14204, 10652, 6117, "brown", 0.002, -0.06, 0.01, 0, 0, 0),
    "pincushion": lens(4000, 3000, 5200, "brown", 0.0, 0.25, 0.2, 0, 0, 0),
    "shifted by a tenth": lens(6000, 4000, 3600, "brown", 0.1, -0.08, 0.02, 0, 0, 0),
    "moustache": lens(6000, 4000, 3600, "brown", 0.0, -0.16, 0.14, -0.02, 0, 0),
    # Pade's approximation of the arc tangent
    "rational, 120 degrees": lens(1920, 1440, 1150, "rational", 0.0, 55 / 105, *[0] * 4, 90 / 105, 9 / 105, *[0] * 5),
    "equidistant fisheye, 180 degrees": lens(2000, 2000, 636, "fisheye", 0.002, 0, 0, 0, 0),
    "equisolid fisheye, full frame": lens(9504, 6336, 4000, "fisheye", 0.0, -1 / 24, 1 / 1920, -1 / 322560, 0),
    "stereographic fisheye": lens(1280, 1024, 542, "fisheye", 0.0, 0.083333, 0.008333, 0.000843, 0.0000854),
}


def grid(columns: int, rows: int) -> np.ndarray:
    """Marks (n, 2) in mm that fill half a metre, whatever their number."""
    x, y = np.linspace(-260, 260, columns), np.linspace(-200, 200, rows)
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def views(camera: Interior, marks: np.ndarray, count: int = 6, seed: int = 0) -> tuple[Poses, Observations, Field]:
    """Exact observations of one board that fills the image, tilted and turned at random."""
    rng, poses, parts = np.random.default_rng(seed), [], []
    while len(poses) < count:
        turn = rotation(np.array([0, 0, rng.uniform(-np.pi, np.pi)])) @ rotation(
            np.array([np.pi + rng.uniform(-0.7, 0.7), rng.uniform(-0.7, 0.7), 0])
        )
        shift = np.array([*rng.uniform(-100, 100, 2), rng.uniform(0.25, 1.0) * 520 * camera.fx / camera.width_px + 90])
        xyz = np.column_stack([marks, np.zeros(len(marks))]) @ turn.T + shift
        xy = project_camera(camera, xyz)
        inside = np.isfinite(xy).all(axis=1) & (xy > 0).all(axis=1)
        inside &= (xy < [camera.width_px - 1, camera.height_px - 1]).all(axis=1) & (xyz[:, 2] > 20)
        wide = np.ptp(xy[inside], axis=0) if inside.any() else np.zeros(2)
        if inside.sum() < 0.5 * len(marks) or inside.sum() < 8 or (wide < 0.5 * camera.height_px).any():
            continue
        point, n = np.flatnonzero(inside), int(inside.sum())
        parts.append(
            Observations(
                stations=(f"s{len(poses)}",),
                station=np.zeros(n, int),
                xy_px=xy[inside],
                cov_px2=np.tile(SIGMA_PX**2 * np.eye(2), (n, 1, 1)),
                moments_px2=np.tile(9.0 * np.eye(2), (n, 1, 1)),
                code=1 + point,
                board=np.zeros(n, int),
                point=point,
                chi2=np.ones(n),
                status=np.full(n, MEASURED, object),
                centre_of_disc=False,
            )
        )
        poses.append((turn, shift))
    board = NominalBoard("A", Marks(marks, np.full(len(marks), 8.0), 1 + np.arange(len(marks))), 0.0, 0.0)
    names = tuple(f"s{k}" for k in range(count))
    R, t = zip(*poses, strict=True)
    return Poses(np.array(R), np.array(t)), Observations.join(parts, names), Field(14, (board,))


def calibrated(camera: Interior, rows: Observations, field: Field) -> Calibration:
    hold = ("k2", "k3", "k6", "s1", "s2", "s3", "s4") if camera.model == "rational" else ()
    return find("calibrators", "zhang")(rows, field, camera.width_px, camera.height_px, camera.model, hold)


@pytest.mark.parametrize("name", LENSES)
def test_exact_observations_through_any_lens_are_all_used_and_give_the_truth(name: str) -> None:
    camera = LENSES[name]
    poses, rows, field = views(camera, grid(9, 7))
    found = calibrated(camera, rows, field)
    assert not found.rejected
    at = Poses(poses.R, poses.t_mm)[rows.station].apply(
        np.column_stack([field.boards[0].marks.xy_mm[rows.point], np.zeros(len(rows))])
    )
    assert np.abs(project_camera(found.interior, at) - rows.xy_px).max() < 1e-6


@pytest.mark.parametrize(
    "name, size",
    [(name, (6, 5)) for name in LENSES] + [("moustache", (16, 12)), ("equidistant fisheye, 180 degrees", (16, 12))],
)
def test_exchanged_numbers_and_misread_codes_are_found_through_any_lens(name: str, size: tuple[int, int]) -> None:
    camera = LENSES[name]
    _, rows, field = views(camera, grid(*size))
    marks, middle = field.boards[0].marks.xy_mm, camera.corners_px.mean(axis=0)
    rng, seen, wrong = np.random.default_rng(1), [], []
    for s in range(len(rows.stations)):
        here = rows.take(rows.station == s)
        plane, image = marks[here.point], here.xy_px.copy()
        bad = np.zeros(len(image), bool)
        a = int(rng.integers(len(image)))
        b = int(np.argsort(np.linalg.norm(plane - plane[a], axis=1))[1])
        image[[a, b]], bad[[a, b]] = image[[b, a]], True
        if len(image) > 20:  # and a code read as another one
            c = int(rng.integers(len(image)))
            if not bad[c]:
                image[c], bad[c] = image[c] + 0.2 * camera.width_px * np.array([1, -0.5]), True
        seen.append((plane, image))
        wrong.append(bad)
    rough = rough_lens(seen, middle)
    good = [fit_plane((plane, image), rough)[1] for plane, image in seen]
    assert (np.concatenate(good) == ~np.concatenate(wrong)).all()


def test_what_is_discarded_is_named_with_its_board_image_and_number() -> None:
    camera = LENSES["full frame 20 mm, 60 Mpx"]
    _, rows, field = views(camera, grid(9, 7))
    xy = rows.xy_px.copy()
    a, b = np.flatnonzero(rows.station == 3)[[0, 1]]
    xy[[a, b]] = xy[[b, a]]
    found = calibrated(camera, replace(rows, xy_px=xy), field)
    assert sorted((r["station"], r["board"]) for r in found.rejected) == [("s3", "A"), ("s3", "A")]
    assert any("'A'" in note and "'s3' (2)" in note for note in found.notes)


@pytest.mark.parametrize("name", ["full frame 20 mm, 60 Mpx", "equidistant fisheye, 180 degrees", "phone, 640 px"])
def test_codes_and_dots_of_a_board_are_named_through_any_lens(name: str) -> None:
    camera = LENSES[name]
    _, rows, field = views(camera, grid(13, 10))
    coded = np.arange(130) % 3 == 0
    marks = replace(field.boards[0].marks, code=np.where(coded, 1 + np.arange(130), 0))
    field = replace(field, boards=(replace(field.boards[0], marks=marks),))
    for s in range(len(rows.stations)):
        here = rows.take(rows.station == s)
        code = marks.code[here.point].copy()
        a, b = np.flatnonzero(code)[[2, 3]]
        code[[a, b]] = code[[b, a]]
        unknown = np.full((len(here), 2, 2), np.nan)
        board, point, reason = identify(here.xy_px, code, unknown, field, camera.corners_px.mean(axis=0))
        wrong = np.isin(np.arange(len(here)), [a, b])
        assert (board[wrong] == -1).all()
        assert set(reason[wrong]) == {"code contradicts its board's layout"}
        assert (point[~wrong] == here.point[~wrong]).mean() > 0.9
        assert (point[(board == 0) & ~wrong] == here.point[(board == 0) & ~wrong]).all()
