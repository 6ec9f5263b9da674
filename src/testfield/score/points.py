"""Check points and lengths against the truth, and what was claimed against what is."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import pdist
from scipy.stats import chi2

from testfield.calibrate.calibration import Calibration
from testfield.reconstruct.points import Points
from testfield.scene.world import BAR, CHECK, World
from testfield.score.align import aligned_covariance, rigid_fit
from testfield.score.camera import true_in_datum
from testfield.statistics.consistency import nees

KNOWN = 1e-10
"""Variances below this part of the largest are zero: a fit, or whoever states them, leaves nothing there."""


@dataclass(frozen=True)
class PointScore:
    """Check points.

    `code` (n,), true positions `true_mm`, errors `error_mm` in the datum frame and `fitted_mm` after the rigid fit, all
    (n, 3); `cov_mm2` (3n, 3n) claimed; `anees`, `anees_fitted` whole-network NEES per degree of freedom, without and
    with the fit, NaN where no covariance is stated; `expected` how many check targets the field has. In a free network
    (`free`) there is no true datum to compare in: errors, covariance and figures are those after the fit, and `anees`
    is NaN.
    """

    code: np.ndarray
    true_mm: np.ndarray
    error_mm: np.ndarray
    fitted_mm: np.ndarray
    cov_mm2: np.ndarray
    anees: float
    anees_fitted: float
    diagonal_mm: float
    expected: int
    free: bool = False

    @property
    def u_mm(self) -> np.ndarray:
        """(n, 3) claimed standard uncertainties."""
        return np.sqrt(np.diag(self.cov_mm2)).reshape(self.error_mm.shape)

    def covariance(self, k: int) -> np.ndarray:
        """(3, 3) claimed covariance of one point."""
        n = len(self.code)
        return self.cov_mm2.reshape(n, 3, n, 3)[k, :, k]

    def card(self) -> dict:
        """The figures under their stable keys."""
        n = len(self.code)
        rmse, unfitted = (float(np.sqrt((e**2).mean())) if n else float("nan") for e in (self.fitted_mm, self.error_mm))
        return {
            "expected": self.expected,
            "measured": n,
            "fit": "6 parameters (rotation, translation), no scale",
            "rmse_mm": rmse,
            "rmse_unfitted_mm": None if self.free else unfitted,
            "worst_mm": float(np.linalg.norm(self.fitted_mm, axis=1).max(initial=0)),
            "mean_u_mm": float(np.sqrt((self.u_mm**2).mean())) if n else float("nan"),
            "relative_accuracy": self.diagonal_mm / rmse if rmse != 0 else float("nan"),
            "relative_accuracy_note": "diagonal of the scene's declared volume / RMSE",
            "relative_accuracy_largest_distance": _largest_distance(self.true_mm) / rmse if rmse != 0 else float("nan"),
            "anees": self.anees,
            "anees_band_95": [float(chi2.ppf(p, 3 * n) / (3 * n)) for p in (0.025, 0.975)] if n else None,
            "anees_fitted": self.anees_fitted,
            "anees_note": "whole network, full covariance: e' C^-1 e over its degrees of freedom, "
            + ("after the fit, for the datum is free" if self.free else "without a fit"),
        }


def _largest_distance(points_mm: np.ndarray) -> float:
    return float(pdist(points_mm).max()) if len(points_mm) > 1 else float("nan")


def score_points(world: World, calibration: Calibration, points: Points) -> PointScore:
    """Score the check targets."""
    truth = _true_positions(world, calibration, CHECK)
    rows = np.array([k for k, code in enumerate(points.code) if int(code) in truth], int)
    free = not calibration.board_names
    if free and len(rows) < 3:
        rows = rows[:0]  # too few for a fit, without which nothing can be compared
    true = np.array([truth[int(code)] for code in points.code[rows]]).reshape(len(rows), 3)
    error = points.xyz_mm[rows] - true
    covariance = points.covariance_of(rows)
    fitted, anees, anees_fitted = error, float("nan"), float("nan")
    stated = points.states_u
    if len(rows) and not free and stated:
        anees = nees(error.ravel(), covariance)
    if len(rows) >= 3:
        R, t = rigid_fit(points.xyz_mm[rows], true)
        fitted = points.xyz_mm[rows] @ R.T + t - true
        # Turned as the points are: the datum of a free network may lie any way round.
        turn = np.kron(np.eye(len(rows)), R)
        covariance_there = turn @ covariance @ turn.T
        reduced = aligned_covariance(covariance_there, true)
        if stated:
            inverse = np.linalg.pinv(reduced, rcond=KNOWN, hermitian=True)
            variances = np.linalg.eigvalsh(reduced)
            freedom = int((variances > KNOWN * variances[-1]).sum())
            anees_fitted = float(fitted.ravel() @ inverse @ fitted.ravel() / freedom) if freedom else float("nan")
        if free:
            error, covariance = fitted, reduced
    return PointScore(
        code=points.code[rows],
        true_mm=true,
        error_mm=error,
        fitted_mm=fitted,
        cov_mm2=covariance,
        anees=anees,
        anees_fitted=anees_fitted,
        diagonal_mm=world.field_diagonal_mm,
        expected=len(truth),
        free=free,
    )


def score_lengths(world: World, calibration: Calibration, points: Points) -> dict:
    """Scale bars: measured against true and against certified lengths."""
    truth = _true_positions(world, calibration, BAR)
    bars: list[dict] = []
    for bar in world.field.scale_bars:
        if not set(bar.codes) <= {int(code) for code in points.code}:
            bars.append({"name": bar.name, "role": bar.role, "note": "an end was not reconstructed"})
            continue
        a, b = points.rows(list(bar.codes))
        length, u = points.distance(a, b)
        true = float(np.linalg.norm(truth[bar.codes[0]] - truth[bar.codes[1]]))
        bars.append(
            {
                "name": bar.name,
                "role": bar.role,
                "measured_mm": length,
                "u_measured_mm": u,
                "true_mm": true,
                "certified_mm": bar.length_mm,
                "u_certified_mm": bar.u_length_mm,
                "error_mm": length - true,
                "difference_to_certified_mm": length - bar.length_mm,
                # A control bar made the scale it is measured with; only a check bar says anything independent.
                "en": (length - bar.length_mm) / (2 * np.hypot(u, bar.u_length_mm)) if bar.role == "check" else None,
            }
        )
    check = [bar["error_mm"] for bar in bars if bar["role"] == "check" and "error_mm" in bar]
    return {
        "check_error_mm": float(max(check, key=abs)) if check else None,
        "scale_error_ppm": 1e6 * (calibration.scale - world_scale(world)) if calibration.board_names else None,
        "u_scale_ppm": 1e6 * float(np.sqrt(calibration.covariance[i, i]))
        if (i := _scale_index(calibration)) is not None
        else None,
        "bars": bars,
    }


def world_scale(world: World) -> float:
    """The true common scale of the boards against their sheets, as the marks show it."""
    marks = world.marks
    on = marks.board >= 0
    nominal = np.concatenate([sheet.marks.xy_mm for sheet in world.field.boards])
    start = np.concatenate([[0], np.cumsum([len(sheet.marks) for sheet in world.field.boards])])
    listed = nominal[start[marks.board[on]] + marks.point[on]]
    return float((marks.xy_mm[on] * listed).sum() / (listed**2).sum())


def _scale_index(calibration: Calibration) -> int | None:
    return calibration.labels.index("scale") if "scale" in calibration.labels else None


def _true_positions(world: World, calibration: Calibration, role: int) -> dict[int, np.ndarray]:
    """True positions in the datum frame of the coded marks of one role, by code."""
    datum, _ = true_in_datum(world, calibration.board_names)
    here = np.flatnonzero(world.marks.role == role)
    local = (world.mark_world_mm[here] - datum.t_mm[0]) @ datum.R[0]
    return {int(world.marks.code[k]): xyz for k, xyz in zip(here, local, strict=True)}
