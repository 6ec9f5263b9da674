"""What differs from image to image is in the stated uncertainty, and points that err by themselves are left alone."""

from dataclasses import replace

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust, predict
from testfield.adjust.network import Network
from testfield.bench.networks import CAMERA, free_network, one_board, plain_labels
from testfield.calibrate.between_images import CHANCE, between_images
from testfield.calibrate.lens_misfit import _functions, prior_root
from testfield.calibrate.misfit import NO_MISFIT, Misfit, Names, widened, widened_by_images
from testfield.camera.pose import cross_matrix, nearest_rotation

IMAGES, SIGMA_PX = 8, 0.05


def names(network: Network) -> list[str]:
    return network.labels(tuple(f"s{k}" for k in range(len(network.stations))), ("board",))


def adjusted(draw: int, bow_mm: float) -> Adjustment:
    """What `IMAGES` images tell of a camera, where the board is bowed about an axis of its own in each of them."""
    network, rng = one_board(IMAGES, 9, 7, seed=draw), np.random.default_rng(draw)
    xy = predict(network) + SIGMA_PX * rng.standard_normal(network.xy_px.shape)
    place = network.point_mm[:, :2] - network.point_mm[:, :2].mean(axis=0)
    for image in range(IMAGES):
        angle, size = rng.uniform(0, np.pi), rng.normal(0, bow_mm)
        along = place @ [np.cos(angle), np.sin(angle)]
        height = size * (along / np.abs(along).max()) ** 2
        bowed = replace(network, point_mm=network.point_mm + height[:, None] * [0, 0, 1.0])
        here = network.image == image
        xy[here] += (predict(bowed) - predict(network))[here]
    given = replace(network, xy_px=xy, cov_px2=np.broadcast_to(SIGMA_PX**2 * np.eye(2), network.cov_px2.shape).copy())
    return adjust(given, names(given))


def nees(found: Adjustment, names: Names = names) -> float:
    """Squared errors of the focal lengths over what is stated of them, a degree of freedom."""
    own = [k for k, name in enumerate(names(found.network)) if name in ("fx", "fy")]
    off = np.array([getattr(found.network.interior, n) - getattr(CAMERA, n) for n in ("fx", "fy")])
    return float(off @ np.linalg.solve(found.covariance[np.ix_(own, own)], off)) / 2


def test_images_that_agree_are_taken_for_such() -> None:
    seen = [between_images(adjusted(draw, 0.0)) for draw in range(40)]
    assert all(one is not None for one in seen)
    factors = [one.factor for one in seen if one]
    # Its mean is 1 and its spread that of its degrees of freedom.
    spread = np.sqrt(2 / np.mean([one.nu for one in seen if one]))
    assert abs(np.mean(factors) - 1) < 4 * spread / np.sqrt(len(factors))
    assert 0.6 * spread < np.std(factors) < 1.5 * spread
    assert sum(one.excess > 1 for one in seen if one) <= 4 + CHANCE * len(seen)


def test_what_is_stated_is_true_where_a_board_bends_otherwise_in_every_image() -> None:
    before, after = [], []
    for draw in range(16):
        scattered, _ = widened(adjusted(draw, 1.0), names)
        honest, misfit, said = widened_by_images(scattered, NO_MISFIT, None, True)
        assert misfit.between > 1
        assert said
        before.append(nees(scattered))
        after.append(nees(honest))
    assert np.mean(before) > 4
    assert 0.4 < np.mean(after) < 2.2


def of_loose_points(draw: int, field_px: float) -> tuple[Network, Adjustment]:
    """Truth and adjustment of free points by images whose lens differs from image to image by a smooth field."""
    (truth, start), rng = free_network(8, 60, seed=draw), np.random.default_rng(draw)
    xy = start.xy_px.copy()
    root = prior_root(CAMERA.width_px, CAMERA.height_px, 0.24)
    for image in range(8):
        own = CAMERA.with_modes(np.tensordot(root @ rng.standard_normal(root.shape[1]), _functions(), 1)[None])
        here = truth.image == image
        xy[here] += field_px * own.by_modes(truth.xy_px[here])[:, :, 0]
    return truth, widened(adjust(replace(start, xy_px=xy), plain_labels(start)), plain_labels)[0]


def points_nees(found: Adjustment, truth: Network) -> tuple[float, float]:
    """NEES a degree of freedom of all points after a fit of seven parameters, and of the 200 longest distances."""
    p, q = (n.point_mm - n.point_mm.mean(axis=0) for n in (found.network, truth))
    R = nearest_rotation(p.T @ q)
    error = (p - (p * (q @ R.T)).sum() / (q**2).sum() * q @ R.T).ravel()
    similarity = np.concatenate([np.tile(np.eye(3), (len(p), 1, 1)), -cross_matrix(p), p[:, :, None]], axis=2)
    rest = np.linalg.qr(similarity.reshape(-1, 7), mode="complete")[0][:, 7:]
    C = rest.T @ found.cov.points(np.arange(len(p))) @ rest
    e = rest.T @ error
    i, j = np.triu_indices(len(p), 1)
    length = np.linalg.norm(p[i] - p[j], axis=1)
    far, by = np.argsort(length)[-200:], np.zeros((200, len(p), 3))
    toward = ((p[i] - p[j]) / length[:, None])[far]
    by[np.arange(200), i[far]], by[np.arange(200), j[far]] = toward, -toward
    lengths = by.reshape(200, -1) @ rest
    return float(e @ np.linalg.solve(C, e)) / len(e), float(
        ((lengths @ e) ** 2).sum() / np.einsum("ij,jk,ik->", lengths, C, lengths)
    )


def test_what_is_stated_of_points_and_lengths_is_true_where_the_lens_is_another_in_every_image() -> None:
    camera, points, lengths, factors = [], [], [], []
    for draw in range(8):
        truth, scattered = of_loose_points(draw, 0.05)
        honest, misfit, _ = widened_by_images(scattered, NO_MISFIT, None, True)
        factors.append(misfit.between)
        camera.append((nees(scattered, plain_labels), nees(honest, plain_labels)))
        of_points, of_lengths = points_nees(honest, truth)
        points.append(of_points)
        lengths.append(of_lengths)
    before, after = np.mean(camera, axis=0)
    assert np.mean(factors) > 1.5  # a point's own covariance times this would be as much too large
    assert after < 0.7 * before
    assert 0.9 < np.mean(points) < 1.25
    assert 0.75 < np.mean(lengths) < 1.4


def test_what_was_known_before_is_not_widened_with_the_images() -> None:
    network = replace(one_board(IMAGES, 9, 7), u_scale=0.005)
    found = adjust(network, names(network))
    wide, at = found.cov.widened(found.network, 9.0), names(network).index("scale")
    assert np.isclose(found.covariance[at, at], 0.005**2, rtol=1e-6)  # an exact board has no scale but its own
    assert np.isclose(wide.reduced[at, at], 0.005**2, rtol=1e-6)
    assert np.allclose(np.diag(wide.reduced)[:4], 9 * np.diag(found.covariance)[:4], rtol=1e-6)


def test_some_of_the_images_take_the_factor_of_all() -> None:
    found = adjusted(1, 0.0)
    wide, misfit, _ = widened_by_images(found, NO_MISFIT, Misfit(between=4.0), True)
    assert misfit.between == 4
    assert np.allclose(np.diag(wide.covariance)[:4], 4 * np.diag(found.covariance)[:4], rtol=0.02)
