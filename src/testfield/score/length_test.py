"""Length measurement errors judged as in VDI/VDE 2634 part 1: measured minus calibrated lengths and their limit."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.stats import norm, t

K_TEST = 2.0
"""Coverage factor of the test's own uncertainty, that of the calibrated lengths."""


@dataclass(frozen=True)
class Limit:
    """E = A + K L, but no more than B (`b_mm` infinite for none); K in parts per million."""

    a_mm: float
    k_ppm: float = 0.0
    b_mm: float = np.inf

    def of(self, length_mm: np.ndarray) -> np.ndarray:
        """(n,) the limit E in mm of lengths (n,)."""
        return np.minimum(self.a_mm + 1e-6 * self.k_ppm * np.asarray(length_mm), self.b_mm)


@dataclass(frozen=True)
class MeasuredLengths:
    """n test lengths: `line` name of the line of each; `codes` (n, 2) of the targets at its ends; `calibrated_mm`,
    `u_calibrated_mm`, `measured_mm` (n,); `cov_measured_mm2` (n, n), for the lengths share a calibration and targets.
    """

    line: tuple[str, ...]
    codes: np.ndarray
    calibrated_mm: np.ndarray
    u_calibrated_mm: np.ndarray
    measured_mm: np.ndarray
    cov_measured_mm2: np.ndarray

    def __len__(self) -> int:
        return len(self.line)

    @property
    def dl_mm(self) -> np.ndarray:
        """(n,) length measurement errors: measured minus calibrated."""
        return self.measured_mm - self.calibrated_mm

    @property
    def u_measured_mm(self) -> np.ndarray:
        """(n,) claimed standard uncertainties of the measured lengths."""
        return np.sqrt(np.diag(self.cov_measured_mm2))

    @property
    def cov_dl_mm2(self) -> np.ndarray:
        """(n, n) covariance of the errors, the calibrated lengths' own included."""
        return self.cov_measured_mm2 + np.diag(self.u_calibrated_mm**2)

    @property
    def u_dl_mm(self) -> np.ndarray:
        """(n,) standard uncertainties of the errors."""
        return np.sqrt(np.diag(self.cov_dl_mm2))

    @property
    def en(self) -> np.ndarray:
        """(n,) E_n: errors in units of their expanded uncertainty, k = 2."""
        return self.dl_mm / (2 * self.u_dl_mm)

    def rows(self, limit: Limit | None = None) -> list[dict[str, Any]]:
        """One dict a length: what the table of the test shows."""
        e = [None] * len(self) if limit is None else limit.of(self.calibrated_mm).tolist()
        u_measured, dl, en = self.u_measured_mm, self.dl_mm, self.en
        return [
            {
                "line": self.line[k],
                "codes": [int(code) for code in self.codes[k]],
                "calibrated_mm": float(self.calibrated_mm[k]),
                "u_calibrated_mm": float(self.u_calibrated_mm[k]),
                "measured_mm": float(self.measured_mm[k]),
                "u_measured_mm": float(u_measured[k]),
                "dl_mm": float(dl[k]),
                "en": float(en[k]),
                "limit_mm": e[k],
                "within": None if limit is None else bool(abs(dl[k]) <= e[k]),
            }
            for k in range(len(self))
        ]


def judge(lengths: MeasuredLengths, limit: Limit, missing: int = 0) -> dict[str, Any]:
    """The verdict: `passed` where every |dl| <= E, `failed` where one is not, `incomplete` where lengths of the test
    are `missing` and no other fails.

    `with_test_uncertainty` adds or takes off the expanded uncertainty of the calibrated lengths, as in ISO 14253-1:
    `shown` that all are within their limits, `refuted`, or `open`.
    """
    size, e, U = np.abs(lengths.dl_mm), limit.of(lengths.calibrated_mm), K_TEST * lengths.u_calibrated_mm
    outside = int((size > e).sum())
    if (size - U > e).any():
        shown = "refuted"
    else:
        shown = "shown" if (size + U <= e).all() and not missing else "open"
    worst = int(np.argmax(size - e))
    return {
        "a_mm": limit.a_mm,
        "k_ppm": limit.k_ppm,
        "b_mm": None if np.isinf(limit.b_mm) else limit.b_mm,
        "verdict": "failed" if outside else "incomplete" if missing else "passed",
        "outside": outside,
        "of": len(lengths),
        "missing": missing,
        "worst_codes": [int(code) for code in lengths.codes[worst]],
        "worst_dl_mm": float(lengths.dl_mm[worst]),
        "worst_limit_mm": float(e[worst]),
        "with_test_uncertainty": shown,
    }


def limit_of(verdict: dict[str, Any]) -> Limit:
    """The limit that a verdict was given by."""
    return Limit(verdict["a_mm"], verdict["k_ppm"], np.inf if verdict["b_mm"] is None else verdict["b_mm"])


def figures(lengths: MeasuredLengths) -> dict[str, Any]:
    """Largest, mean and rms error; the mean relative error; the slope of the errors over length; the envelopes."""
    dl = lengths.dl_mm
    return {
        "lengths": len(lengths),
        "shortest_mm": float(lengths.calibrated_mm.min()),
        "longest_mm": float(lengths.calibrated_mm.max()),
        "max_abs_dl_mm": float(np.abs(dl).max()),
        "mean_dl_mm": float(dl.mean()),
        "rms_dl_mm": float(np.sqrt((dl**2).mean())),
        "rms_u_dl_mm": float(np.sqrt((lengths.u_dl_mm**2).mean())),
        "mean_relative_ppm": float(1e6 * (dl / lengths.calibrated_mm).mean()),
        "slope": slope(lengths),
        "envelope": smallest_envelope(lengths),
    }


def slope(lengths: MeasuredLengths) -> dict[str, float] | None:
    """Straight line dl = a + b L by least squares; None where the lengths do not differ.

    `slope_ppm` b and `offset_mm` a; `ci_low_ppm`, `ci_high_ppm` 95 % by what was claimed (the full covariance of all
    lengths), and `scatter_low_ppm`, `scatter_high_ppm` by the scatter about the line alone, as if the lengths were
    independent.
    """
    length, dl, n = lengths.calibrated_mm, lengths.dl_mm, len(lengths)
    if n < 3 or np.ptp(length) < 1e-6 * length.max():
        return None
    X = np.column_stack([np.ones(n), length])
    gain = np.linalg.solve(X.T @ X, X.T)
    offset, b = gain @ dl
    u = float(np.sqrt(gain[1] @ lengths.cov_dl_mm2 @ gain[1]))
    left = dl - X @ [offset, b]
    scatter = float(np.sqrt(left @ left / (n - 2) * (gain[1] @ gain[1])))
    half, of_scatter = float(norm.ppf(0.975)) * u, float(t.ppf(0.975, n - 2)) * scatter
    ppm = {
        "slope": b,
        "u_slope": u,
        "ci_low": b - half,
        "ci_high": b + half,
        "scatter_low": b - of_scatter,
        "scatter_high": b + of_scatter,
    }
    return {f"{name}_ppm": float(1e6 * value) for name, value in ppm.items()} | {"offset_mm": float(offset)}


def smallest_a(lengths: MeasuredLengths, k_ppm: np.ndarray) -> np.ndarray:
    """(m,) the smallest A in mm for each K (m,) with which every |dl| <= A + K L."""
    over = np.abs(lengths.dl_mm)[None] - 1e-6 * np.asarray(k_ppm)[:, None] * lengths.calibrated_mm[None]
    return np.maximum(over.max(axis=1), 0)


def smallest_envelope(lengths: MeasuredLengths) -> dict[str, float]:
    """The pair A, K whose limit is lowest at the mean length; beside it A where K = 0, and K in ppm where A = 0."""
    size, length = np.abs(lengths.dl_mm), lengths.calibrated_mm
    # In units of the errors and lengths themselves, or the solver's tolerance would be larger than a micrometre.
    unit, reach = max(size.max(), 1e-12), length.max()
    found = linprog(
        [1, length.mean() / reach],
        A_ub=-np.column_stack([np.ones(len(size)), length / reach]),
        b_ub=-size / unit,
        bounds=[(0, None), (0, None)],
    )
    k_ppm = 1e6 * unit * float(found.x[1]) / reach
    return {
        "a_mm": float(smallest_a(lengths, np.array([k_ppm]))[0]),
        "k_ppm": float(k_ppm),
        "a_without_k_mm": float(size.max()),
        "k_without_a_ppm": float(1e6 * (size / length).max()),
    }
