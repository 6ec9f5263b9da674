"""CCTags measure as ring codes do: free points with a number each, of which the camera and the places are found."""

import numpy as np
from scipy.spatial.distance import pdist
from test_self_calibration import scene

from testfield.detect.crown_boards import observed
from testfield.detect.crown_model import ALL, BLUR, CONTRAST, FittedCrowns
from testfield.detect.crowns import Crown
from testfield.detect.photograph import Found
from testfield.detect.target_spec import parse_target
from testfield.measure.photographs import measure
from testfield.score.align import rigid_fit
from testfield.targets.field_file import field_of_target


def crown(number: int, xy_px: np.ndarray, sigma_px: float) -> Crown:
    theta = np.zeros(ALL)
    theta[[0, 2]], theta[3:5], theta[BLUR], theta[CONTRAST] = 30.0, xy_px, 0.8, 150.0
    return Crown(number, FittedCrowns(theta, xy_px, sigma_px**2 * np.eye(2), 1.0, 0.01), np.zeros((16, 2)))


def test_places_of_free_tags_are_found_with_number_0_among_them() -> None:
    truth, sigma_px = scene(), 0.02
    rng, names, found = np.random.default_rng(2), [], []
    for s in range(len(truth.stations)):
        rows = np.flatnonzero(truth.image == s)
        xy = truth.xy_px[rows] + rng.normal(0, sigma_px, (len(rows), 2))
        tags = [crown(int(p), at, sigma_px) for p, at in zip(truth.point[rows], xy, strict=True)]
        none = np.full(len(tags), -1)
        o = observed(f"s{s}", tags, none, np.zeros(len(tags), int), codes=True)
        names.append(f"s{s}")
        found.append(Found(o, np.full((len(o), 2), -1), ()))
    target = parse_target("cctag:3")
    result = measure(tuple(names), found, (4096, 3000), field_of_target("cctag:3"), target)
    coded = result.points.code > 0
    assert coded.sum() == len(truth.point_mm) - 1  # the number 0 is a point without a code
    assert len(result.points.code) == len(truth.point_mm)
    true = truth.point_mm[result.points.code[coded]]
    # Nothing certifies a length.
    scaled = result.points.xyz_mm[coded] * np.median(pdist(true) / pdist(result.points.xyz_mm[coded]))
    R, t = rigid_fit(scaled, true)
    error = scaled @ R.T + t - true
    assert np.sqrt((error**2).mean()) < 0.1
