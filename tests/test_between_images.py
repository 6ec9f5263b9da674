"""What differs from image to image is in the stated uncertainty, and points that err by themselves are left alone."""

from dataclasses import replace

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust, predict
from testfield.adjust.network import Network
from testfield.bench.networks import CAMERA, one_board
from testfield.calibrate.between_images import CHANCE, between_images
from testfield.calibrate.misfit import NO_MISFIT, Misfit, widened, widened_by_images

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


def nees(found: Adjustment) -> float:
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
        honest, misfit, said = widened_by_images(scattered, names, NO_MISFIT, None)
        assert misfit.between > 1
        assert said
        before.append(nees(scattered))
        after.append(nees(honest))
    assert np.mean(before) > 4
    assert 0.4 < np.mean(after) < 2.2


def test_some_of_the_images_take_the_factor_of_all() -> None:
    found = adjusted(1, 0.0)
    wide, misfit, _ = widened_by_images(found, names, NO_MISFIT, Misfit(between=4.0))
    assert misfit.between == 4
    assert np.allclose(np.diag(wide.covariance)[:4], 4 * np.diag(found.covariance)[:4], rtol=0.02)
