"""Tags stuck about, each by itself: what their numbers and their size say of their corners."""

import numpy as np
import pytest

from testfield.calibrate.certified import Certified
from testfield.detect.observations import MEASURED, READ, Observations
from testfield.detect.photograph import Found
from testfield.detect.target_spec import parse_target
from testfield.errors import TestfieldError
from testfield.measure.single_tags import as_coded, odd_sizes, sized
from testfield.reconstruct.points import Points
from testfield.targets.field import ScaleBar


def seen(tags: list[int]) -> Found:
    n = 4 * len(tags)
    return Found(
        Observations(
            stations=("a",),
            station=np.zeros(n, int),
            xy_px=np.arange(2.0 * n).reshape(n, 2),
            cov_px2=np.tile(np.eye(2), (n, 1, 1)),
            moments_px2=np.full((n, 2, 2), np.nan),
            code=np.repeat(tags, 4),
            board=np.full(n, -1),
            point=np.tile(np.arange(4), len(tags)),
            chi2=np.full(n, np.nan),
            status=np.array([MEASURED, MEASURED, READ, MEASURED] * len(tags), object),
            centre_of_disc=False,
        ),
        np.full((n, 2), -1),
        (),
    )


def test_every_corner_has_a_code_also_of_tag_0() -> None:
    (one,), notes = as_coded([seen([0, 12])])
    assert one.observations.code.tolist() == [1, 2, 3, 4, 121, 122, 123, 124]
    assert (one.observations.status == MEASURED).all() and len(notes) == 1
    with pytest.raises(TestfieldError, match="10000"):
        as_coded([seen([10_000])])


def test_a_size_makes_the_scale_no_better_than_one_printer_does() -> None:
    found, _ = as_coded([seen([0, 7, 9])])
    bars = sized(Certified(), found, parse_target("apriltag:36h11:40")).bars
    assert sorted(bar.codes for bar in bars) == [(1, 3), (2, 4), (71, 73), (72, 74), (91, 93), (92, 94)]
    mean = 1 / np.sqrt(sum((bar.length_mm / bar.u_length_mm) ** 2 for bar in bars))
    assert np.isclose(mean, 0.005)
    assert all(np.isclose(bar.length_mm, 40 * 2**0.5) for bar in bars)
    assert sized(Certified(), found, parse_target("apriltag:36h11")).bars == ()
    better = Certified((ScaleBar("rod", "control", (1, 91), 500.0, 0.01),))
    assert sized(better, found, parse_target("apriltag:36h11:40")) == better


def test_a_tag_of_another_size_is_named() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [0, -1, 0.0]])
    xyz = np.concatenate([side * square for side in (40, 40, 44)])
    code = np.array([10 * tag + c for tag in (1, 2, 3) for c in (1, 2, 3, 4)])
    points = Points("self", code, xyz, np.eye(36), np.full(12, 5), np.zeros(12), np.zeros(12, int))
    assert "3 by +10%" in odd_sizes(points, parse_target("aruco:DICT_4X4_50:40"))[0]
    assert "3 by +10%" in odd_sizes(points, parse_target("aruco:DICT_4X4_50"))[0]
