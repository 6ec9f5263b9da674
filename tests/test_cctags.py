"""CCTags: the public tables, prints of them, and tags drawn at many sizes, slants and blurs with no number wrong."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.author.prints import Print, print_of
from testfield.camera.photograph import Photograph
from testfield.detect.crown_model import matrix, shape_of
from testfield.detect.crowns import read_crowns
from testfield.detect.noise import estimate_sheet
from testfield.detect.photograph import Found, detect_in_photograph
from testfield.detect.target_spec import parse_target
from testfield.errors import TestfieldError
from testfield.scene.load import parse_scene
from testfield.scene.nominal import nominal_board
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.crowns import crown_radii
from testfield.targets.field import Field

WIDTH, HEIGHT, FOCAL_PX, FINER = 400, 320, 600.0, 5


def homography(tilt_deg: float, px_a_mm: float) -> np.ndarray:
    """(3, 3) from the board's mm to px."""
    tilt = np.radians(tilt_deg)
    R = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]]) @ np.diag([1, -1, -1])
    K = np.array([[FOCAL_PX, 0, (WIDTH - 1) / 2], [0, FOCAL_PX, (HEIGHT - 1) / 2], [0, 0, 1]])
    return np.asarray(K @ np.column_stack([R[:, 0], R[:, 1], [0, 0, FOCAL_PX / px_a_mm]]))


def drawn(pattern: BoardPattern, H: np.ndarray, noise_dn: float, blur_px: float = 0.6, seed: int = 0) -> np.ndarray:
    """An image (h, w) of black tags on white, averaged over pixels, blurred, with noise, in bytes."""
    x, y = ((np.arange(n * FINER) + 0.5) / FINER - 0.5 for n in (WIDTH, HEIGHT))
    at = cv2.perspectiveTransform(np.stack(np.meshgrid(x, y), axis=-1), np.linalg.inv(H))
    discs, ink = pattern.discs, np.zeros(at.shape[:2])
    assert discs is not None
    for k, middle in enumerate(pattern.points_mm):
        rho = np.linalg.norm(at - middle, axis=-1)
        for j in range(2 * pattern.crowns):
            ink += discs.sign[2 * pattern.crowns * k + j] * (rho < discs.radius_mm[2 * pattern.crowns * k + j])
    sharp = 200 - 170 * ink.reshape(HEIGHT, FINER, WIDTH, FINER).mean(axis=(1, 3))
    noise = np.random.default_rng(seed).normal(0, noise_dn, sharp.shape)
    return (cv2.GaussianBlur(sharp, (0, 0), blur_px) + noise).round().clip(0, 255).astype(np.float32)


def seen(image: np.ndarray, crowns: int) -> Found:
    return detect_in_photograph(Photograph("drawn", image, 8, ()), parse_target(f"cctag:{crowns}"))


def test_the_tables_are_those_of_cctag() -> None:
    assert [crown_radii(crowns).shape for crowns in (3, 4)] == [(32, 6), (128, 8)]
    for crowns in (3, 4):
        radii = crown_radii(crowns)
        assert (np.diff(radii, axis=1) < 0).all()
        assert len(np.unique(radii, axis=0)) == len(radii)
    # The first of either, as its generator draws it.
    assert np.allclose(crown_radii(3)[0], [1, 0.9, 0.8, 0.7, 0.6, 0.5])
    assert np.allclose(crown_radii(4)[0], [1, 0.92, 0.84, 0.76, 0.68, 0.6, 0.52, 0.44])


@pytest.mark.parametrize(
    ("crowns", "px_a_mm", "tilt_deg", "blur_px"),
    [(3, 1.0, 0, 0.6), (3, 0.7, 40, 1.0), (4, 1.1, 45, 0.6), (4, 0.7, 0, 1.2)],
)
def test_tags_are_named_and_their_centres_measured(
    crowns: int, px_a_mm: float, tilt_deg: float, blur_px: float
) -> None:
    pattern = BoardPattern("cctag", 3, 2, 90.0, 66.0, first_tag=9 * crowns - 21, crowns=crowns)
    H = homography(tilt_deg, px_a_mm)
    found = seen(drawn(pattern, H, 2.0, blur_px), crowns).observations
    assert sorted(found.code) == pattern.tags.tolist()
    true = cv2.perspectiveTransform(pattern.points_mm[None], H)[0][found.code - pattern.first_tag]
    error = found.xy_px - true
    assert np.sqrt((error**2).mean()) < 0.015
    assert 0.2 < np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.cov_px2), error).mean() / 2 < 4


def test_tags_on_bent_paper_have_their_numbers_and_their_centres() -> None:
    """By 2.6 px at the tags' edges, as the paper of AliceVision's photographs is; misfits there are 0.055."""
    pattern, H = BoardPattern("cctag", 2, 1, 92.0, 80.0, first_tag=15, crowns=3), homography(25, 1.3)
    image = drawn(pattern, H, 1.5, 1.7)
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    true = cv2.perspectiveTransform(pattern.points_mm[None], H)[0]
    bend = sum(2.6 * ((x - middle) / 50) ** 2 * (abs(x - middle) < 60) for middle in true[:, 0])
    bent = cv2.remap(image, x, (y + bend).astype(np.float32), cv2.INTER_CUBIC).clip(0, 255)
    found = seen(bent, 3).observations
    assert sorted(found.code) == pattern.tags.tolist()
    assert np.abs(found.xy_px - true[found.code - 15]).max() < 1.0


def test_a_slanted_tag_is_read_wherever_in_the_image_it_lies() -> None:
    pattern, H = BoardPattern("cctag", 1, 1, 90.0, 66.0, first_tag=16, crowns=3), homography(50, 1.6)
    image = drawn(pattern, H, 1.0)
    far = np.full((700, 2400), image[0, 0], np.float32)
    far[-HEIGHT:, -WIDTH:] = image
    here, there = seen(image, 3).observations, seen(far, 3).observations
    assert here.code.tolist() == there.code.tolist() == [16]
    shift = [2400 - WIDTH, 700 - HEIGHT]
    assert np.allclose(there.xy_px, here.xy_px + shift, atol=0.005)
    assert np.allclose(there.moments_px2, here.moments_px2, rtol=1e-3)
    moved = np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1]]) @ H
    moved = moved / moved[2, 2]
    same = np.linalg.inv(moved) @ matrix(shape_of(moved))  # a turn about the tag's centre
    assert np.allclose(same @ same.T, np.eye(3), atol=1e-9)


def test_a_camera_that_moves_during_the_exposure_hides_neither_numbers_nor_centres() -> None:
    """A path of 5 px along a diagonal; the model of a blur that is alike all around leaves 11 % of the contrast."""
    pattern, H = BoardPattern("cctag", 3, 2, 90.0, 66.0, first_tag=9, crowns=3), homography(20, 1.0)
    path = np.zeros((5, 5))
    path[np.arange(5), np.arange(5)] = 0.2
    found = seen(cv2.filter2D(drawn(pattern, H, 1.0), -1, path).round(), 3).observations
    assert sorted(found.code) == pattern.tags.tolist()
    true = cv2.perspectiveTransform(pattern.points_mm[None], H)[0][found.code - pattern.first_tag]
    assert np.linalg.norm(found.xy_px - true, axis=1).max() < 0.04


def test_a_tag_whose_white_ends_with_the_image_is_read() -> None:
    pattern, H = BoardPattern("cctag", 1, 1, 90.0, 66.0, first_tag=22, crowns=3), homography(0, 2.0)
    image = drawn(pattern, H, 0.5)
    assert seen(image, 3).observations.code.tolist() == [22]
    row, column = (np.flatnonzero((image < 100).any(axis=axis)) for axis in (1, 0))
    tight = image[row[0] - 4 : row[-1] + 5, column[0] - 4 : column[-1] + 5]
    assert seen(np.ascontiguousarray(tight), 3).observations.code.tolist() == [22]


def test_the_centre_of_a_slanted_tag_is_not_that_of_its_ellipse() -> None:
    """Feed the ellipse's centre in, and the error is a hundred times larger."""
    pattern, H = BoardPattern("cctag", 1, 1, 90.0, 80.0, first_tag=4, crowns=3), homography(45, 1.2)
    found = seen(drawn(pattern, H, 2.0), 3).observations
    true = cv2.perspectiveTransform(pattern.points_mm[None], H)[0][0]
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    circle = cv2.perspectiveTransform(40 * np.column_stack([np.cos(angle), np.sin(angle)])[None], H)[0]
    ellipse = np.array(cv2.fitEllipseDirect(circle.astype(np.float32))[0])
    assert np.linalg.norm(found.xy_px[0] - true) < 0.02
    assert np.linalg.norm(ellipse - true) > 1


@pytest.mark.parametrize(
    "rows, tags", [((160,), (3,)), pytest.param((60, 160, 260), (3, 4), marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_other_circles_have_no_number(rows: tuple[int, ...], tags: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    image = np.full((HEIGHT, WIDTH), 200.0)
    for x in (60, 160, 260, 350):  # rings within rings whose radii are no tag's, dots in rings, plain dots
        for y in rows:
            radii = np.sort(rng.uniform(0.15, 1, rng.integers(1, 6)))[::-1] * 38
            for k, radius in enumerate([38, *radii]):
                level = (200.0 if k % 2 else 30.0,)
                cv2.circle(image, (x * 16, y * 16), int(radius * 16), level, -1, cv2.LINE_8, 4)
    image = (cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0, 2, image.shape)).round().clip(0, 255)
    for crowns in tags:
        assert len(seen(image.astype(np.float32), crowns).observations) == 0


def _painted(circles: list[tuple[int, int, np.ndarray]]) -> np.ndarray:
    """(h, w) an image of discs one within the other, black and white in turn, radii in px."""
    x, y = ((np.arange(3 * n) + 0.5) / 3 - 0.5 for n in (WIDTH, HEIGHT))
    fine = np.full((len(y), len(x)), 200.0)
    for middle_x, middle_y, radii in circles:
        rho = np.hypot(x - middle_x, y[:, None] - middle_y)
        for k, radius in enumerate(radii):
            fine[rho < radius] = 200.0 if k % 2 else 30.0
    sharp = fine.reshape(HEIGHT, 3, WIDTH, 3).mean(axis=(1, 3))
    return cv2.GaussianBlur(sharp, (0, 0), 0.7)


@pytest.mark.parametrize("crowns", [pytest.param(3, marks=pytest.mark.slow), 4])
def test_edges_a_little_beside_those_of_a_tag_are_no_tag(crowns: int) -> None:
    """The rings of a tag with one edge in the middle of two that a table knows, or one crown too many or too few."""
    rng, table = np.random.default_rng(crowns), crown_radii(crowns)
    circles = []
    for k, (x, y) in enumerate((x, y) for x in (70, 200, 330) for y in (80, 230)):
        radii = table[rng.integers(len(table))].copy()
        if k % 3 == 0:
            radii[1 + k % (len(radii) - 1)] += 0.025
        elif k % 3 == 1:
            radii = radii[:-2]
        else:
            radii = np.append(radii, [0.6 * radii[-1], 0.3 * radii[-1]])
        circles.append((x, y, 44 * radii))
    image = (_painted(circles) + rng.normal(0, 2, (HEIGHT, WIDTH))).round().astype(np.float32)
    assert len(seen(image, crowns).observations) == 0


def test_a_tag_that_is_cut_or_hidden_in_part_has_its_own_number_or_none() -> None:
    pattern, H = BoardPattern("cctag", 2, 2, 92.0, 80.0, first_tag=9, crowns=3), homography(25, 0.95)
    image, true = drawn(pattern, H, 2.0), cv2.perspectiveTransform(pattern.points_mm[None], H)[0]
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    hidden = image.copy()
    for k, (level, part) in enumerate([(30, 0.03), (120, 0.1), (200, 0.3), (120, 0.01)]):
        hidden[((x - true[k, 0]) > 38 * (1 - 2 * part)) & (np.abs(y - true[k, 1]) < 45) & (x < true[k, 0] + 42)] = level
    top = int(true[:, 1].min()) - 20
    for shown in (hidden, np.ascontiguousarray(image[top:])):
        found = seen(shown, 3).observations
        at = true - [0, top if shown is not hidden else 0]
        nearest = np.linalg.norm(found.xy_px[:, None] - at, axis=2).argmin(axis=1)
        assert (found.code == pattern.tags[nearest]).all()
        assert np.abs(found.xy_px - at[nearest]).max(initial=0) < 0.1


@pytest.mark.parametrize("crowns", [3, pytest.param(4, marks=pytest.mark.slow)])
def test_tags_in_a_jpeg_of_quality_70_are_named_and_measured(crowns: int) -> None:
    pattern, H = BoardPattern("cctag", 4, 3, 92.0, 80.0, first_tag=12, crowns=crowns), homography(25, 0.95)
    done, bytes_ = cv2.imencode(".jpg", drawn(pattern, H, 2.0).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 70])
    assert done
    found = seen(cv2.imdecode(bytes_, cv2.IMREAD_GRAYSCALE).astype(np.float32), crowns).observations
    assert sorted(found.code) == pattern.tags.tolist()
    true = cv2.perspectiveTransform(pattern.points_mm[None], H)[0][found.code - 12]
    assert np.abs(found.xy_px - true).max() < 0.03


def test_a_tag_of_four_crowns_is_none_of_three() -> None:
    pattern = BoardPattern("cctag", 3, 2, 90.0, 70.0, crowns=4)
    image = drawn(pattern, homography(20, 1.1), 2.0)
    found, unread = read_crowns(image, [image.astype(np.uint8)], estimate_sheet(image, 8), 3)
    assert not found
    assert unread >= 6


def test_the_print_has_every_crown() -> None:
    scene = parse_scene(BOARD, "test", Path())
    sheet = Field(14, (nominal_board(scene.boards[0], 14, 0),))
    one: Print = print_of(sheet.boards[0], sheet)
    ink = sum(np.pi * (s.outer_mm**2 - s.inner_mm**2) / 2 for s in one.sectors)
    radii = crown_radii(3)[4:10] * 30
    assert ink == pytest.approx(np.pi * (radii[:, ::2] ** 2 - radii[:, 1::2] ** 2).sum())
    assert one.finest_mm == pytest.approx((radii[:, ::2] - radii[:, 1::2]).min())


BOARD = """
name = "own"
[[boards]]
name = "B"
size_mm = [320, 240]
position_mm = [0, 0, 500]
pattern = { kind = "cctag", columns = 3, rows = 2, pitch_mm = 80, diameter_mm = 60, first_tag = 4 }
[[stations]]
generator = "grid"
counts = [2, 1, 2]
low_mm = [-210, -480, 360]
high_mm = [230, -480, 720]
look_at_mm = [0, 0, 500]
"""


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ("pitch_mm = 70, diameter_mm = 60", "too little white"),
        ("pitch_mm = 80, diameter_mm = 60, crowns = 3, first_tag = 27", "end at 31"),
    ],
)
def test_boards_that_cannot_be_are_refused_in_a_sentence(fields: str, word: str) -> None:
    with pytest.raises(TestfieldError, match=word):
        parse_scene(BOARD.replace("pitch_mm = 80, diameter_mm = 60, first_tag = 4", fields), "test", Path())
