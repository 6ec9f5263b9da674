"""The certificate's geometry: the reference is worth its name, and a renderer that is wrong is found out."""

from dataclasses import replace

import numpy as np
import pytest

from testfield.camera.pose import rotation
from testfield.certify.geometry import (
    STRIP_PX,
    Sample,
    bent,
    certify_geometry,
    judge,
    judge_bent,
    render_targets,
    strewn,
)
from testfield.certify.reference import ink_in_pixels
from testfield.scene.world import World

PINHOLE = np.array([3000.0, 3000.0, 500.0, 400.0, 0, 0, 0, 0, 0])
BROWN = np.array([3000.0, 3001.0, 500.0, 400.0, -0.12, 0.05, -0.01, 1e-3, -8e-4])
FACING = np.diag([1.0, -1.0, -1.0])
ASLANT = rotation(np.array([0.8, 0.7, 0.3])) @ FACING
WORD = 0b11010010110001
ENOUGH_CELLS = 6
"""With so many the closed forms of one cell, which take edges for straight and corners for square, are good enough."""


@pytest.mark.parametrize("radius_px", [2.0, 5.3, 20.0])
def test_an_untilted_dot_without_distortion_has_the_area_of_its_circle(radius_px: float) -> None:
    window = ink_in_pixels(PINHOLE, FACING, np.array([3.3, 4.7, 3000.0]), radius_px, 0, 14)
    assert window.values.sum() == pytest.approx(np.pi * radius_px**2, rel=1e-9)
    assert window.values.min() > -1e-12
    assert window.values.max() < 1 + 1e-12
    # The middle of the bounding box of a disc is the disc's.
    assert window.left_px + (window.values.shape[1] - 1) / 2 == pytest.approx(503.3, abs=0.51)


def test_a_ring_has_the_area_of_its_segments() -> None:
    window = ink_in_pixels(PINHOLE, FACING, np.array([3.3, 4.7, 3000.0]), 10.0, WORD, 14)
    share = WORD.bit_count() / 14
    assert window.values.sum() == pytest.approx(np.pi * 100 * (1 + (9 - 4) * share), rel=1e-9)


@pytest.mark.parametrize("word", [0, WORD])
@pytest.mark.parametrize("radius_px", [2.0, 20.0])
def test_the_reference_has_converged_to_1e_7(radius_px: float, word: int) -> None:
    at = BROWN, ASLANT, np.array([800.3, 904.7, 3000.0]), radius_px, word, 14
    coarse, fine = (ink_in_pixels(*at, knots=knots).values for knots in (8192, 16384))
    assert np.abs(coarse - fine).max() < 1e-7
    assert np.abs(coarse - fine).max() > 0


def test_the_reference_agrees_with_points_traced_back_to_the_plane() -> None:
    """Another way to the same pixels: undistort a fine raster, meet the plane, ask whether there is ink."""
    t_mm = np.array([800.3, 904.7, 3000.0])
    window = ink_in_pixels(BROWN, ASLANT, t_mm, 4.0, WORD, 14)
    rows, columns = window.values.shape
    fine = 40
    x, y = np.meshgrid(
        window.left_px - 0.5 + (np.arange(columns * fine) + 0.5) / fine,
        window.top_px - 0.5 + (np.arange(rows * fine) + 0.5) / fine,
    )
    fx, fy, cx, cy, k1, k2, k3, p1, p2 = BROWN
    goal_u, goal_v = (x - cx) / fx, (y - cy) / fy
    u, v = goal_u.copy(), goal_v.copy()
    for _ in range(60):  # a fixed point, slow and plain
        s = u**2 + v**2
        bulge = 1 + k1 * s + k2 * s**2 + k3 * s**3
        u, v = (
            (goal_u - 2 * p1 * u * v - p2 * (s + 2 * u**2)) / bulge,
            (goal_v - p1 * (s + 2 * v**2) - 2 * p2 * u * v) / bulge,
        )
    ray = np.stack([u, v, np.ones_like(u)], axis=-1)
    hit = ray * ((ASLANT[:, 2] @ t_mm) / (ray @ ASLANT[:, 2]))[..., None] - t_mm
    px, py = hit @ ASLANT[:, 0], hit @ ASLANT[:, 1]
    radius = np.hypot(px, py) / 4.0
    segment = np.floor(np.mod(np.arctan2(-py, px), 2 * np.pi) / (2 * np.pi) * 14).astype(int)
    ink = (radius < 1) | ((radius > 2) & (radius < 3) & (WORD >> (13 - segment) & 1 == 1))
    counted = ink.reshape(rows, fine, columns, fine).mean(axis=(1, 3))
    assert np.abs(counted - window.values).max() < 0.02
    assert np.sqrt(np.mean((counted - window.values) ** 2)) < 0.002
    assert abs(counted.sum() - window.values.sum()) < 1e-3 * window.values.sum()


def test_the_quick_certificate_names_eight_figures() -> None:
    verdicts = certify_geometry(True, ENOUGH_CELLS)
    assert len(verdicts) == len({verdict.name for verdict in verdicts}) == 8
    for verdict in verdicts:
        assert verdict.passed, verdict


def test_the_quick_certificate_passes_with_three_cells() -> None:
    for verdict in certify_geometry(True, 3):
        assert verdict.passed, verdict


@pytest.mark.slow
def test_the_whole_certificate_passes_with_the_cells_a_scene_has_by_default() -> None:
    for verdict in certify_geometry(False, 3):
        assert verdict.passed, verdict


def test_panels_do_not_hide_each_other_or_leave_the_image() -> None:
    """Every reference window lies within the image and holds ink of its own target alone."""
    sample = render_targets(strewn(3478.0, STRIP_PX), 2)
    for rendered, true in zip(sample.rendered, sample.true, strict=True):
        assert rendered.shape == true.values.shape
        assert np.abs(rendered - true.values).max() < 0.05


def test_a_renderer_shifted_by_a_hundredth_of_a_pixel_fails() -> None:
    def shift(world: World) -> World:
        parameters = world.interior.parameters + 0.01 * np.eye(9)[2]
        return replace(world, interior=world.interior.with_parameters(parameters))

    sample: Sample = render_targets(strewn(3478.0, STRIP_PX), ENOUGH_CELLS, shift)
    for code in (False, True):
        assert not any(verdict.passed for verdict in judge([sample], code))
    assert sample.centre_errors_px().mean(axis=0) == pytest.approx([0.01, 0.0], abs=5e-4)


def test_a_renderer_that_takes_bent_panels_for_flat_fails() -> None:
    def flatten(world: World) -> World:
        return replace(world, panels=replace(world.panels, curvature_per_mm=None))

    world = bent(strewn(3478.0, STRIP_PX))
    assert judge_bent(render_targets(world, 3)).passed
    assert not judge_bent(render_targets(world, 3, flatten)).passed
