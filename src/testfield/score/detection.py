"""Detections against the truth: expected, found, missed and why, false, wrong; and the centres' errors."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.scene.truth import Views
from testfield.scene.world import World

EXPECTED_PX = 8.0
"""Fully visible targets of at least this diameter must be found."""
LEAST_REACH_PX = 2.0
"""Within which an observation belongs to what it claims to be; within half its width, where that is more."""


@dataclass(frozen=True)
class DetectionScore:
    """`station`, `mark` (k,) of each rightly identified observation; `row` (k,) its place among the observations;
    `error_px` (k, 2) measured minus true; `nees` (k,) squared error in units of the claimed covariance, NaN where none
    is stated.
    `expected`, `found`, `dirty` (stations, marks) booleans, the last of targets that would be expected but for dirt;
    `missed` why, counted; `wrong_code` and `false` row indices."""

    station: np.ndarray
    mark: np.ndarray
    row: np.ndarray
    error_px: np.ndarray
    nees: np.ndarray
    expected: np.ndarray
    found: np.ndarray
    missed: dict[str, int]
    wrong_code: np.ndarray
    wrong_dot: np.ndarray
    false: np.ndarray
    dirty: np.ndarray

    def card(self) -> dict:
        """The figures under their stable keys."""
        expected, found = int(self.expected.sum()), int(self.found[self.expected].sum())
        any_px = self.error_px if len(self.error_px) else np.full((1, 2), np.nan)
        bias = any_px.mean(axis=0)
        stated = self.nees[np.isfinite(self.nees)]
        return {
            "expected": expected,
            "found": found,
            "found_fraction": found / expected if expected else 1.0,
            "missed": expected - found,
            "missed_reasons": dict(sorted(self.missed.items())),
            "dirty": int(self.dirty.sum()),
            "dirty_found": int(self.found[self.dirty].sum()),
            "false": len(self.false),
            "wrong_code": len(self.wrong_code),
            "wrong_dot": len(self.wrong_dot),
            "measured": len(self.row),
            "centre_rms_px": float(np.sqrt((any_px**2).mean())),
            "centre_bias_px": float(np.hypot(*bias)),
            "centre_bias_x_px": float(bias[0]),
            "centre_bias_y_px": float(bias[1]),
            "centre_worst_px": float(np.abs(self.error_px).max(initial=0)),
            "centre_anees": float(stated.mean() / 2) if len(stated) else float("nan"),
        }


def score_detection(world: World, views: Views, observations: Observations) -> DetectionScore:
    """Match every observation to the truth, by what it claims to be and by where it is."""
    marks = world.marks
    by_code = {int(c): k for k, c in enumerate(marks.code)}
    by_point = {(int(b), int(p)): k for k, (b, p) in enumerate(zip(marks.board, marks.point, strict=True)) if b >= 0}
    true_px = views.disc_px if observations.centre_of_disc else views.centre_px
    expected = (views.visible == 1) & (views.diameter_px >= EXPECTED_PX)
    clean = np.broadcast_to(views.clean, expected.shape)
    dirty = (clean < 1) & (clean > 0) & (views.visible == clean) & (views.diameter_px >= EXPECTED_PX)
    found = np.zeros(expected.shape, bool)
    number = {name: k for k, name in enumerate(world.station_name)}
    unknown = sorted(set(observations.stations) - set(number))
    if unknown:
        raise TestfieldError(
            f"station '{unknown[0]}' is not in the scene", "observations.parquet", f"known are {', '.join(number)}"
        )
    station = np.array([number[name] for name in observations.stations])[observations.station]

    rows, match, wrong_code, wrong_dot, false = [], [], [], [], []
    measured = observations.status == MEASURED
    reach = np.fmax(0.5 * observations.diameter_px, LEAST_REACH_PX)
    told = np.isfinite(observations.diameter_px)
    # A blob near a mark that nobody can see there is a false one.
    in_sight = views.visible > 0
    trees = [cKDTree(px[seen]) for px, seen in zip(true_px, in_sight, strict=True)]
    for row in np.flatnonzero(measured):
        s, xy = station[row], observations.xy_px[row]
        code, board, point = (int(getattr(observations, name)[row]) for name in ("code", "board", "point"))
        claimed = by_code.get(code) if code > 0 else by_point.get((board, point))
        near = reach[row] if told[row] or claimed is None else max(0.5 * views.diameter_px[s, claimed], LEAST_REACH_PX)
        if claimed is not None and in_sight[s, claimed] and np.linalg.norm(xy - true_px[s, claimed]) <= near:
            rows.append(row)
            match.append(claimed)
            found[s, claimed] = True
        elif code > 0:
            wrong_code.append(row)
        elif claimed is not None:
            wrong_dot.append(row)
        elif trees[s].query(xy)[0] > reach[row]:
            false.append(row)

    index, mark = np.array(rows, int), np.array(match, int)
    error = observations.xy_px[index] - true_px[station[index], mark]
    stated = observations.states_u[index]
    root = np.linalg.cholesky(np.where(stated[:, None, None], observations.cov_px2[index], np.eye(2)))
    white = np.linalg.solve(root, error[..., None])[..., 0]
    return DetectionScore(
        station=station[index],
        mark=mark,
        row=index,
        error_px=error,
        nees=np.where(stated, (white**2).sum(axis=1), np.nan),
        expected=expected,
        found=found,
        missed=_why_missed(expected & ~found, true_px, views, observations, station),
        wrong_code=np.array(wrong_code, int),
        wrong_dot=np.array(wrong_dot, int),
        false=np.array(false, int),
        dirty=dirty,
    )


def _why_missed(
    missed: np.ndarray, true_px: np.ndarray, views: Views, observations: Observations, station: np.ndarray
) -> dict[str, int]:
    """The status of whatever was looked at where a missed target is."""
    reasons: Counter[str] = Counter()
    for s in np.flatnonzero(missed.any(axis=1)):
        here = np.flatnonzero(station == s)
        for mark in np.flatnonzero(missed[s]):
            distance = np.linalg.norm(observations.xy_px[here] - true_px[s, mark], axis=1)
            if not len(here) or distance.min() > views.diameter_px[s, mark]:
                reasons["no blob there"] += 1
            else:
                status = str(observations.status[here[np.argmin(distance)]])
                reasons["not identified" if status == MEASURED else status] += 1
    return dict(reasons)
