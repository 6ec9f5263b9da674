"""Stated uncertainty where the true lens is richer than the model, and where boards are less flat than their sheets."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from testfield.adjust.bundle import Adjustment, adjust, predict
from testfield.adjust.network import Images, Network
from testfield.bench.networks import CAMERA, one_board
from testfield.bench.residual_field import KINDS, scene_of, trial
from testfield.calibrate.calibration import Calibration
from testfield.calibrate.lens_misfit import LENGTHS, SIGNIFICANT, _most_likely, _seen, lens_misfit, prior_root
from testfield.calibrate.misfit import NO_MISFIT, Misfit, excess_of, misfit_of
from testfield.calibrate.unflat_boards import unflat
from testfield.camera.interior import Interior
from testfield.camera.project import camera_jacobian, directions, project_camera
from testfield.reconstruct.points import Points
from testfield.scene.build import build_world
from testfield.scene.load import parse_scene
from testfield.score.camera import imaging_score
from testfield.uncertainty.halves import LEAST_IMAGES, SPLITS, compare_halves, random_halves

SCENES = Path(__file__).parents[1] / "scenes"
DRAWS = 20


def names(network: Network) -> list[str]:
    return network.labels(tuple(f"s{k}" for k in range(len(network.stations))), ("board",))


def field(rms_px: float, draw: int) -> Interior:
    """The networks' camera with the residual field of a scene."""
    table = scene_of("dots", rms_px, draw, SCENES)
    true = build_world(parse_scene(tomli_w.dumps(table), "field", Path())).interior
    return replace(CAMERA, residual_px=true.residual_px)


def observed(rms_px: float, draw: int, images: int = 10) -> tuple[Interior, Adjustment]:
    """A true camera, and the adjustment of what it sees of a board by the lens model alone."""
    network, true = one_board(images, 9, 7, seed=draw), field(rms_px, draw)
    network = replace(network, xy_px=network.xy_px + true.displacement(network.xy_px))
    return true, adjust(network, names(network))


def followed(plain: Adjustment, misfit: Misfit) -> Adjustment:
    network = misfit.applied(plain.network, names)
    return adjust(network, names(network))


def beyond_noise_px(plain: Adjustment) -> float:
    """What residuals show beyond noise: the part of a field that the lens did not take up."""
    noise_px2 = np.trace(plain.network.cov_px2, axis1=1, axis2=2).sum()
    shown_px2 = (plain.residual_px**2).sum() * plain.residual_px.size / plain.freedom
    return float(np.sqrt((shown_px2 - noise_px2) / len(plain.residual_px)))


def as_calibration(found: Adjustment) -> Calibration:
    network = found.network
    stations = tuple(f"s{k}" for k in range(len(network.stations)))
    return Calibration(
        method="test",
        interior=network.interior,
        station_names=stations,
        stations=network.stations,
        board_names=("board",),
        boards=network.boards,
        scale=1.0,
        covariance=found.covariance,
        labels=tuple(names(network)),
        sigma0=found.sigma0,
        freedom=found.freedom,
        reprojection_rms_px=0.0,
        used=len(network.xy_px),
        residual_at_px=network.xy_px,
        residual_px=found.residual_px,
    )


def test_a_camera_with_smooth_fields_is_projected_inverted_and_differentiated_alike() -> None:
    rng = np.random.default_rng(1)
    modes = rng.normal(0, 0.3, (5, 2, 4, 4))
    blank = CAMERA.with_modes(modes)
    camera = blank.with_parameters(np.concatenate([CAMERA.parameters, rng.normal(0, 1, 5)]))
    rays = np.column_stack([rng.uniform(-0.35, 0.35, (40, 2)), np.ones(40)])
    uv = project_camera(camera, rays)
    assert np.abs(uv - project_camera(CAMERA, rays)).max() > 0.1
    assert np.allclose(directions(camera, uv), rays, rtol=0, atol=1e-10)
    at, by_interior, by_ray = camera_jacobian(camera, rays)
    assert np.allclose(at, uv, rtol=0, atol=1e-10)
    for k in range(len(camera.parameters)):
        step = 1e-4 * max(1e-3, abs(camera.parameters[k]))
        moved = camera.with_parameters(camera.parameters + step * (np.arange(len(camera.parameters)) == k))
        numeric = (project_camera(moved, rays) - uv) / step
        assert np.allclose(by_interior[:, :, k], numeric, rtol=1e-3, atol=1e-3 * np.abs(numeric).max() + 1e-9)
    for k in range(3):
        numeric = (project_camera(camera, rays + 1e-6 * np.eye(3)[k]) - uv) / 1e-6
        assert np.allclose(by_ray[:, :, k], numeric, rtol=1e-3, atol=1.0)
    back = Interior.from_json(json.loads(json.dumps(camera.to_json())))
    assert np.array_equal(project_camera(back, rays), uv)
    assert camera.without_modes.names == CAMERA.names


def test_nothing_changes_where_the_lens_model_is_true() -> None:
    for draw in range(5):
        _, plain = observed(0.0, draw)
        assert misfit_of(plain, names, plain.freedom) == NO_MISFIT


def test_a_false_alarm_is_as_rare_as_is_said() -> None:
    _, plain = observed(0.0, 1)
    seen = _seen(plain.network, names(plain.network))
    values, axes = np.linalg.eigh(seen.S)
    there = values > 1e-9 * values[-1]
    root, rank, rng = axes[:, there] * np.sqrt(values[there]), int(there.sum()), np.random.default_rng(4)
    roots = [prior_root(CAMERA.width_px, CAMERA.height_px, part) for part in LENGTHS]
    alarms, trials = 0, 150
    for _ in range(trials):
        white = rng.standard_normal(rank)
        chi2 = float(white @ white + rng.chisquare(plain.freedom - rank))
        drawn = replace(seen, t=root @ white, chi2=chi2)
        alarms += max(_most_likely(drawn, one, plain.freedom)[0] for one in roots) > SIGNIFICANT
    assert alarms <= 2  # a quarter of one is expected


def test_a_field_of_a_tenth_of_a_pixel_is_found_and_what_is_left_of_it_is_stated() -> None:
    with_it, without = [], []
    for draw in range(6):
        true, plain = observed(0.1, draw)
        misfit = misfit_of(plain, names, plain.freedom)
        assert misfit.lens is not None
        assert not misfit.unflat_mm  # a board is not taken for what the lens does
        assert 0.8 * beyond_noise_px(plain) < misfit.lens.rms_px < 0.25
        without.append(imaging_score(true, as_calibration(plain)))
        with_it.append(imaging_score(true, as_calibration(followed(plain, misfit))))
    assert 0.5 < np.mean([s["imaging_anees"] for s in with_it]) < 1.7  # of 6 draws; the slow test takes 20
    assert np.mean([s["imaging_anees"] for s in without]) > 5
    errors = [np.mean([s["imaging_error_px"] for s in scores]) for scores in (with_it, without)]
    assert errors[0] < 0.7 * errors[1]


def test_a_board_that_is_not_flat_is_not_taken_for_a_lens() -> None:
    rng = np.random.default_rng(2)
    network = one_board(8, 9, 7)
    heights = 0.4 * rng.standard_normal(len(network.point_mm))
    bent = replace(network, point_mm=network.point_mm + heights[:, None] * [0, 0, 1.0])
    noise = 0.05 * rng.standard_normal(network.xy_px.shape)
    plain = adjust(replace(network, xy_px=predict(bent) + noise), names(network))
    misfit = misfit_of(plain, names, plain.freedom)
    assert misfit.lens is None
    assert misfit.unflat_mm == pytest.approx(0.4, rel=0.4)
    found = followed(plain, misfit)
    assert np.corrcoef(found.network.point_mm[:, 2], heights)[0, 1] > 0.9
    _, flat = observed(0.0, 3)
    seen = unflat(flat.network, names(flat.network), flat.freedom)
    assert seen is None or seen.rise < SIGNIFICANT


def of_squares(network: Network, draw: int, own_px: float) -> Adjustment:
    """The lens model's adjustment where every four neighbours of a board of 12 x 12, in each image, err alike."""
    rng, k = np.random.default_rng(draw), np.arange(144)
    square = (k // 12 // 2) * 6 + k % 12 // 2
    images = len(network.stations)
    own = own_px * rng.standard_normal((images, 36, 2))[network.image, square[network.point]]
    return adjust(replace(network, xy_px=network.xy_px + own), names(network))


def test_errors_of_each_square_are_not_taken_for_a_field_and_do_not_hide_one() -> None:
    network = one_board(5, 12, 12, seed=5)
    plain = of_squares(network, 5, 0.1)
    base = replace(plain.network, cov_px2=excess_of(plain) * plain.network.cov_px2)
    white = lens_misfit(base, names(base), plain.freedom)
    assert white is not None  # as if all four corners were observations of their own
    assert misfit_of(plain, names, plain.freedom).lens is None
    bent = replace(network, xy_px=network.xy_px + field(0.2, 5).displacement(network.xy_px))
    plain = of_squares(bent, 5, 0.05)
    assert misfit_of(plain, names, plain.freedom).lens is not None


def test_halves_tell_a_true_uncertainty_from_one_that_is_too_small() -> None:
    network = one_board(12, 9, 7, seed=5)

    def measure(images: np.ndarray, factor: float = 1.0) -> tuple[Calibration, Points]:
        rows = np.isin(network.image, images)
        half = replace(network.take(rows), stations=network.stations[images])
        half = replace(half, image=np.searchsorted(images, half.image), images=Images.one_camera(len(images)))
        found = as_calibration(adjust(half, names(half)))
        return replace(found, covariance=found.covariance / factor**2), NO_POINTS

    right = compare_halves(12, measure)
    wrong = compare_halves(12, lambda images: measure(images, 10.0))
    assert right.splits == SPLITS and not right.note and "too small" in wrong.note
    assert [d.quantity for d in right.differences] == ["fx", "cx", "cy"]
    ratio = np.sqrt(np.mean([d.ratio**2 for d in right.differences]))
    assert 0.3 < ratio < 2.0
    assert np.mean([d.ratio for d in wrong.differences]) == pytest.approx(
        10 * np.mean([d.ratio for d in right.differences])
    )
    few = compare_halves(2 * LEAST_IMAGES - 1, measure)
    assert few.splits == 0
    assert few.note
    a, b = random_halves(7, 0)
    assert sorted([*a, *b]) == list(range(7))


def test_a_widened_field_is_known_no_worse_than_before_and_halves_may_share_it() -> None:
    _, plain = observed(0.1, 1, images=5)
    found, factor = followed(plain, misfit_of(plain, names, plain.freedom)), 9.0
    wide = found.cov.widened(found.network, factor).reduced
    amounts = np.array([name.startswith("field:") for name in names(found.network)])
    across = wide[np.ix_(~amounts, amounts)]
    assert np.linalg.eigvalsh(wide[np.ix_(amounts, amounts)]).max() < factor * (1 + 1e-9)
    left = wide[np.ix_(~amounts, ~amounts)] - across @ across.T / factor
    size = np.sqrt(np.diag(wide)[~amounts])
    assert np.linalg.eigvalsh(left / np.outer(size, size)).min() > -1e-9


def test_too_few_residuals_are_not_asked() -> None:
    _, plain = observed(0.3, 0)
    assert lens_misfit(plain.network, names(plain.network), 10) is None


@pytest.mark.slow
@pytest.mark.parametrize("rms_px", [0.0, 0.02, 0.1, 0.3])
@pytest.mark.parametrize("kind", KINDS)
def test_stated_uncertainty_is_true_whatever_the_lens_does_beside_its_model(kind: str, rms_px: float) -> None:
    found = [trial(kind, rms_px, draw, SCENES) for draw in range(DRAWS)]
    # 20 draws of a mean over places that hang together scatter by a tenth or more about their expectation.
    least, most = (0.8, 1.3) if rms_px else (0.7, 1.4)
    for figure in ("points", "imaging"):
        assert least < np.mean([f[figure] for f in found]) < most, figure
    share = np.mean([f["s_px"] > 0 for f in found])
    assert share <= 0.1 if rms_px == 0 else share == 1


NO_POINTS = Points(
    method="none",
    code=np.zeros(0, int),
    xyz_mm=np.zeros((0, 3)),
    cov_xyz_mm2=np.zeros((0, 0)),
    rays=np.zeros(0, int),
    residual_rms_px=np.zeros(0),
    rejected=np.zeros(0, int),
)
