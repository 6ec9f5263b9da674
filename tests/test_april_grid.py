"""Kalibr's AprilGrid: printed as Kalibr prints it, and read at every size, slant and noise with no number wrong."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from testfield.camera.photograph import Photograph
from testfield.detect.observations import MEASURED
from testfield.detect.photograph import detect_in_photograph
from testfield.detect.small_tags import tag_detector
from testfield.detect.target_spec import parse_target
from testfield.detect.touching_tags import read_touching_tags
from testfield.targets.board_pattern import BoardPattern, dictionary

FIRST_OF_36H11 = 0xD5D628584
"""The first word of Kalibr's table and of AprilTag's."""
WIDTH, HEIGHT, FOCAL_PX, FINER = 480, 400, 600.0, 4
TARGET = parse_target("aprilgrid:4x3:54:16.2")
GRID = TARGET.pattern()


def homography(tilt_deg: float, px_a_mm: float, roll_deg: float = 10.0) -> np.ndarray:
    """(3, 3) from the board's mm to px."""
    tilt, roll = np.radians([tilt_deg, roll_deg])
    turned = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    leant = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    R = turned @ leant @ np.diag([1, -1, -1])
    K = np.array([[FOCAL_PX, 0, (WIDTH - 1) / 2], [0, FOCAL_PX, (HEIGHT - 1) / 2], [0, 0, 1]])
    return np.asarray(K @ np.column_stack([R[:, 0], R[:, 1], [0, 0, FOCAL_PX / px_a_mm]]))


def projected(H: np.ndarray, mm: np.ndarray) -> np.ndarray:
    return cv2.perspectiveTransform(mm[None], H)[0]


def drawn(pattern: BoardPattern, H: np.ndarray, noise_dn: float, seed: int = 0) -> np.ndarray:
    """An image (h, w) in bytes: the print averaged over pixels, blurred, with noise."""
    x, y = ((np.arange(n * FINER) + 0.5) / FINER - 0.5 for n in (WIDTH, HEIGHT))
    at = cv2.perspectiveTransform(np.stack(np.meshgrid(x, y), axis=-1), np.linalg.inv(H))
    fine = np.where(pattern.cells.at(at), 30.0, 200.0)
    sharp = fine.reshape(HEIGHT, FINER, WIDTH, FINER).mean(axis=(1, 3))
    noise = np.random.default_rng(seed).normal(0, noise_dn, sharp.shape)
    return np.asarray((cv2.GaussianBlur(sharp, (0, 0), 0.7) + noise).round().clip(0, 255).astype(np.uint8))


def test_the_print_is_kalibrs() -> None:
    mark, pitch, cell = GRID.mark_mm, GRID.pitch_mm, GRID.mark_mm / 10
    lower_left = GRID.tag_middles_mm[0]
    assert np.allclose(lower_left, GRID.tag_middles_mm.min(axis=0))
    assert np.allclose(GRID.tag_middles_mm[1] - lower_left, [pitch, 0])
    # The word is read row by row from the top left, black where a bit is 0, within two cells of black.
    step = (np.arange(10) - 4.5) * cell
    seen = GRID.cells.at(lower_left + np.stack(np.meshgrid(step, step[::-1]), axis=-1))
    assert int("".join("01"[not black] for black in seen[2:-2, 2:-2].ravel()), 2) == FIRST_OF_36H11
    assert seen.sum() - seen[2:-2, 2:-2].sum() == 100 - 36
    # Corners row by row from the lower left, with a black square outwards along the diagonal of each.
    corners = GRID.points_mm.reshape(6, 8, 2)
    assert np.allclose(corners[0, :3] - corners[0, 0], [[0, 0], [mark, 0], [pitch, 0]])
    assert np.allclose(corners[:3, 0, 1] - corners[0, 0, 1], [0, mark, pitch])
    assert np.allclose(GRID.half_mm, corners[-1, -1] + GRID.pitch_mm - mark)
    ways = np.array([[1, 1], [-1, -1], [1, -1], [-1, 1]]) * 0.5 * cell
    black = np.array([GRID.cells.at(GRID.points_mm + way) for way in ways])
    assert (black[0] == black[1]).all() and (black[2] == black[3]).all() and (black[0] != black[2]).all()


@pytest.mark.parametrize(("px_a_mm", "tilt_deg"), [(0.4, 0), (0.4, 30), (0.6, 50), (1.2, 0), (1.2, 50)])
def test_every_corner_is_named_and_measured_to_a_hundredth_of_a_pixel(px_a_mm: float, tilt_deg: float) -> None:
    H = homography(tilt_deg, px_a_mm)
    image = drawn(GRID, H, 2.0)
    found = detect_in_photograph(Photograph("drawn", image.astype(np.float32), 8, ()), TARGET).observations
    assert len(np.unique(found.point)) == len(found) >= 0.9 * len(GRID.points_mm)
    error = found.xy_px - projected(H, GRID.points_mm)[found.point]
    assert np.abs(error).max() < 0.5
    good = found.status == MEASURED
    assert good.mean() > 0.8
    assert np.sqrt((error[good] ** 2).mean()) < 0.02


def test_a_border_of_one_cell_is_noticed() -> None:
    H = homography(20, 1.0)
    found = detect_in_photograph(
        Photograph("drawn", drawn(replace(GRID, border_cells=1), H, 2.0).astype(np.float32), 8, ()), TARGET
    )
    assert len(found.observations) == 48
    assert any("border of one cell" in note for note in found.notes)
    assert np.abs(found.observations.xy_px - projected(H, GRID.points_mm)[found.observations.point]).max() < 0.1


def test_a_board_seen_from_behind_and_clutter_give_no_number() -> None:
    mirrored = drawn(GRID, homography(0, 1.2), 2.0)[:, ::-1]
    assert len(read_touching_tags(np.ascontiguousarray(mirrored), GRID.names, 2)[0]) == 0
    rng = np.random.default_rng(4)
    for seed in range(6):  # random words in borders: what is most like a tag
        words = np.ones((10, 10))
        words[2:-2, 2:-2] = rng.integers(0, 2, (6, 6))
        tile = np.pad(words, 3, constant_values=0)
        clutter = np.kron(np.block([[tile, tile.T], [tile[::-1], tile[:, ::-1]]]), np.ones((8, 8)))
        image = cv2.GaussianBlur((200 - 170 * clutter), (0, 0), 0.7) + rng.normal(0, 3, clutter.shape)
        assert len(read_touching_tags(image.clip(0, 255).astype(np.uint8), GRID.names, 2)[0]) == 0, seed


def _by_opencv(image: np.ndarray) -> list[tuple[int, np.ndarray]]:
    detector = tag_detector(dictionary(GRID.names))
    settings = detector.getDetectorParameters()
    settings.markerBorderBits = GRID.border_cells
    detector.setDetectorParameters(settings)
    quads, numbers, _ = detector.detectMarkers(image)
    return [] if numbers is None else [(int(n), q.reshape(4, 2)) for n, q in zip(numbers.ravel(), quads, strict=True)]


def _by_aprilgrid(image: np.ndarray) -> list[tuple[int, np.ndarray]]:
    package = pytest.importorskip("aprilgrid")
    return [(int(tag.tag_id), tag.corners.reshape(4, 2)) for tag in package.Detector("t36h11").detect(image)]


@pytest.mark.slow
@pytest.mark.parametrize("peer", [_by_opencv, _by_aprilgrid])
def test_more_tags_are_read_and_corners_are_better_than_by_others(peer: Callable) -> None:
    """24 frames of 12 tags: four sizes, three slants, two levels of noise. A tag that is 6 px off is a wrong one."""
    ours: list[np.ndarray] = []
    theirs: list[np.ndarray] = []
    wrong = 0
    for px_a_mm in (0.4, 0.6, 0.9, 1.2):
        for tilt_deg in (0.0, 30.0, 50.0):
            for noise_dn in (2.0, 6.0):
                H = homography(tilt_deg, px_a_mm)
                image = drawn(GRID, H, noise_dn, int(100 * px_a_mm + tilt_deg))
                found = detect_in_photograph(Photograph("drawn", image.astype(np.float32), 8, ()), TARGET).observations
                ours.append(found.xy_px - projected(H, GRID.points_mm)[found.point])
                for number, quad in peer(image):
                    true = (
                        projected(H, GRID.tag_corners_mm[number]) if number < len(GRID.tags) else np.full((4, 2), 1e6)
                    )
                    gap = np.linalg.norm(quad[:, None] - true, axis=2)
                    if gap.min(axis=1).max() > 6:
                        wrong += 1
                    else:
                        theirs.append(quad - true[gap.argmin(axis=1)])
    (n, rms_px), (m, others_px) = ((len(np.concatenate(e)), _rms(np.concatenate(e))) for e in (ours, theirs))
    print(f"of 288 tags {n / 4:.0f} read, corners {rms_px:.4f} px")
    print(f"{peer.__name__}: {m / 4:.0f}, {others_px:.4f} px, {wrong} wrong")
    assert np.abs(np.concatenate(ours)).max() < 3
    assert n > 1.1 * m
    assert rms_px < 0.3 * others_px


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))
