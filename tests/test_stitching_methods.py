"""Check values of METHODS sections 4.2 and 4.3: what homographies of boards in one image tell of boards and camera."""

import numpy as np
import pytest

from testfield.calibrate.homography import focal_length, plane_homography, plane_pose
from testfield.camera.pose import Poses, rotation
from testfield_studies.stitching.scenes import sub_board_marks_mm

MATRIX = np.array([[1780.0, 0, 799.5], [0, 1780.0, 599.5], [0, 0, 1]])
MIDDLE = MATRIX[:2, 2]
CAMERA = Poses(rotation(np.array([0.5, -0.4, 0.2]))[None], np.array([[-100.0, 60.0, 2400.0]]))
"""Camera from the plane of the first board."""


def _homography(board: Poses, k1: float = 0.0) -> np.ndarray:
    """Of a board at a pose in the first board's frame, seen through a lens with distortion `k1`."""
    xy = sub_board_marks_mm()
    pose = CAMERA.after(board)
    seen = np.column_stack([xy, np.zeros(len(xy))]) @ pose.R[0].T + pose.t_mm[0]
    ideal = seen[:, :2] / seen[:, 2:]
    bent = ideal * (1 + k1 * (ideal**2).sum(axis=1, keepdims=True))
    return plane_homography(xy, bent * MATRIX[0, 0] + MIDDLE)


def _board(turn_rad: list[float], shift_mm: list[float]) -> Poses:
    return Poses(rotation(np.array(turn_rad))[None], np.array([shift_mm]))


FIRST = _board([0, 0, 0], [0, 0, 0])


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """S_ab of section 4.2.5."""
    S = np.linalg.solve(a, b)
    return S / S[2, 2]


def _turn(S: np.ndarray) -> float:
    return float(np.arctan2(S[1, 0] - S[0, 1], S[0, 0] + S[1, 1]))


def _scale_error(S: np.ndarray) -> float:
    return float(np.sqrt(np.linalg.det(S[:2, :2])) - 1)


def test_coplanar_boards_differ_by_a_turn_and_a_shift_without_knowing_the_camera() -> None:
    S = _between(_homography(FIRST), _homography(_board([0, 0, 0.7], [450, -80, 0])))
    cos, sin = np.cos(0.7), np.sin(0.7)
    np.testing.assert_allclose(S, [[cos, -sin, 450], [sin, cos, -80], [0, 0, 1]], atol=1e-3)
    assert _turn(S) == pytest.approx(0.7, abs=1e-6)
    assert abs(_scale_error(S)) < 1e-6 and abs(S[2, :2]).max() < 1e-8


@pytest.mark.parametrize(
    ("turn_rad", "shift_mm", "k1"),
    [([0, 0, 0.7], [450, -80, 30], 0.0), ([0.03, 0, 0.7], [450, -80, 0], 0.0), ([0, 0, 0.7], [450, -80, 0], -0.1)],
    ids=["a board that lies higher", "a board that leans", "a lens that distorts"],
)
def test_scale_and_last_row_notice_what_is_not_flat_or_distorts(
    turn_rad: list[float], shift_mm: list[float], k1: float
) -> None:
    S = _between(_homography(FIRST, k1), _homography(_board(turn_rad, shift_mm), k1))
    assert abs(_scale_error(S)) > 2e-3 or abs(S[2, :2]).max() > 1e-5
    # A person who trusts the shortcut all the same is wrong in the turn or in the shift.
    assert abs(_turn(S) - 0.7) > 1e-4 or np.linalg.norm(S[:2, 2] - [450, -80]) > 1


def _rank(homographies: list[np.ndarray]) -> int:
    """Rank of Zhang's constraints on the image of the absolute conic (section 4.2.2)."""

    def row(h: np.ndarray, i: int, j: int) -> np.ndarray:
        a, b = h[:, i], h[:, j]
        return np.array(
            [
                a[0] * b[0],
                a[0] * b[1] + a[1] * b[0],
                a[1] * b[1],
                a[2] * b[0] + a[0] * b[2],
                a[2] * b[1] + a[1] * b[2],
                a[2] * b[2],
            ]
        )

    to_unit = np.linalg.inv([[1000.0, 0, MIDDLE[0]], [0, 1000.0, MIDDLE[1]], [0, 0, 1]])
    rows = []
    for homography in homographies:
        h = to_unit @ homography
        h = h / np.linalg.norm(h[:, 0])
        rows += [row(h, 0, 1), row(h, 0, 0) - row(h, 1, 1)]
    return int(np.linalg.matrix_rank(np.array(rows), tol=1e-4))


COPLANAR = [
    FIRST,
    _board([0, 0, 0.7], [450, -80, 0]),
    _board([0, 0, -1.2], [-420, 90, 0]),
    _board([0, 0, 2.0], [60, 400, 0]),
]
TILTED = [FIRST, _board([0.45, 0.1, 0], [450, -80, 20]), _board([-0.2, 0.5, 0.3], [-420, 90, -30])]


def test_four_coplanar_boards_in_one_image_give_rank_two_and_three_tilted_ones_rank_five() -> None:
    assert _rank([_homography(FIRST)]) == 2
    assert _rank([_homography(board) for board in COPLANAR]) == 2
    parallel = [_board([0, 0, 0.3 * k], [200 * k, 0, 60 * k]) for k in range(4)]
    assert _rank([_homography(board) for board in parallel]) == 2
    assert _rank([_homography(board) for board in TILTED[:2]]) == 4
    assert _rank([_homography(board) for board in TILTED]) == 5


@pytest.mark.parametrize("boards", [COPLANAR, TILTED], ids=["coplanar", "tilted"])
def test_with_the_principal_point_given_one_image_gives_focal_length_and_poses(boards: list[Poses]) -> None:
    homographies = np.array([_homography(board) for board in boards])
    focal = focal_length(homographies, MIDDLE)
    assert focal == pytest.approx(1780, rel=1e-5)
    for board, homography in zip(boards, homographies, strict=True):
        R, t = plane_pose(homography, focal, MIDDLE)
        pose = CAMERA.after(board)
        np.testing.assert_allclose(R, pose.R[0], atol=1e-5)
        np.testing.assert_allclose(t, pose.t_mm[0], atol=2e-2)
