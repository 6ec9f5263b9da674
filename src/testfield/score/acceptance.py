"""What standards would ask of a run: lengths, spacing, flatness, relative accuracy, claims; computed as in them."""

from itertools import combinations, pairwise
from typing import Any

import numpy as np
from scipy.spatial.distance import pdist, squareform
from scipy.stats import chi2, norm

from testfield.calibrate.calibration import Calibration
from testfield.errors import TestfieldError
from testfield.reconstruct.points import Points
from testfield.scene.schema import SceneFile
from testfield.scene.target_parts import CheckGrid
from testfield.scene.world import CHECK, World
from testfield.score.align import aligned_covariance, rigid_basis
from testfield.score.arrangement import arrangement, check_positions
from testfield.score.flatness import flatness, form_error, in_a_row
from testfield.score.length_test import Limit, MeasuredLengths, figures, judge
from testfield.score.points import score_points
from testfield.statistics.consistency import NOTHING, decorrelated, joint_hit_band, nees_band, pit_uniformity

Asked = tuple[str, int, int, float, float]
"""A length: its line, the codes of both ends, calibrated length and its standard uncertainty in mm."""


def acceptance(
    scene: SceneFile, world: World, calibration: Calibration, points: Points, limit: Limit | None = None
) -> tuple[dict[str, Any], MeasuredLengths]:
    """All figures of the page under stable keys, and the lengths themselves; `limit` in the place of the scene's.

    Raises `TestfieldError` where the run measured no test length at all, or states no uncertainty of its points.
    """
    if len(points) and not points.states_u:
        raise TestfieldError(
            "no covariance of the points is stated, and an acceptance test compares errors with it",
            "points.parquet",
            "let the calibrator and the reconstructor state theirs, or compare lengths in scorecard.json",
        )
    asked, rule = test_lengths(world)
    if not asked:
        raise TestfieldError(
            "the scene has no measuring lines, no check bar, and fewer than two check targets, so there is no length "
            "to test",
            f"{scene.name}, measuring_lines",
            "add [[measuring_lines]] or check targets to the scene",
        )
    lengths = measured(points, asked)
    if not len(lengths):
        raise TestfieldError(
            f"none of the {len(asked)} test lengths was measured: their targets are not among the points",
            "points.parquet",
            "look at the report's detection table; make the targets larger or add stations",
        )
    if limit is None and (part := scene.acceptance) is not None:
        limit = Limit(part.a_mm, part.k_ppm, np.inf if part.b_mm is None else part.b_mm)
    stands = arrangement(scene, world)
    card = {
        "scene": world.name,
        "lengths": figures(lengths) | {"rule": rule, "missing": missing(points, asked)},
        "verdict": None
        if limit is None
        else judge(lengths, limit, len(asked) - len(lengths))
        | {"arrangement_met": stands is not None and all(row["met"] for row in stands)},
        "arrangement": stands,
        "adjustment": {
            "scale_bars": [bar.name for bar in world.field.scale_bars if bar.role == "control"],
            "note": "made the scale and are no test lengths",
        },
        "spacing": spacing(world, points),
        "flatness": planes(scene, world, points),
        "points": points_card(world, calibration, points, lengths),
        "rows": lengths.rows(limit),
    }
    return card, lengths


def test_lengths(world: World) -> tuple[list[Asked], str]:
    """The lengths to test, and in words by what rule.

    Measuring lines give the distance of each target from their first; check bars give theirs. A field without
    measuring lines is tested on the true distances between all its check targets. Control bars never take part.
    """
    field = world.field
    bars = [(bar.name, *bar.codes, bar.length_mm, bar.u_length_mm) for bar in field.scale_bars if bar.role == "check"]
    also = f"; the check bar{'s' if len(bars) > 1 else ''} besides" if bars else ""
    if field.measuring_lines:
        on_lines = [
            (line.name, line.codes[0], code, length, line.u_length_mm)
            for line in field.measuring_lines
            for code, length in zip(line.codes[1:], line.length_mm, strict=True)
        ]
        return on_lines + bars, f"calibrated distances of the targets on the measuring lines from the first{also}"
    at = check_positions(world)
    pairs = [(f"from {a}", a, b, float(np.linalg.norm(at[a] - at[b])), 0.0) for a, b in combinations(sorted(at), 2)]
    return pairs + bars, f"no measuring lines: true distances between all pairs of check targets{also}"


test_lengths.__test__ = False  # type: ignore[attr-defined]  # the name begins with "test", and pytest would collect it


def measured(points: Points, asked: list[Asked]) -> MeasuredLengths:
    """Those of the lengths both ends of which are among the points, with their joint covariance."""
    place = {int(code): k for k, code in enumerate(points.code)}
    here = [length for length in asked if length[1] in place and length[2] in place]
    ends = np.array([(place[a], place[b]) for _, a, b, _, _ in here], int).reshape(len(here), 2)
    off = points.xyz_mm[ends[:, 1]] - points.xyz_mm[ends[:, 0]]
    length = np.linalg.norm(off, axis=1)
    gain = np.zeros((len(here), len(points), 3))
    rows, direction = np.arange(len(here)), off / length[:, None]
    gain[rows, ends[:, 1]] += direction
    gain[rows, ends[:, 0]] -= direction
    flat = gain.reshape(len(here), 3 * len(points))
    return MeasuredLengths(
        tuple(line for line, *_ in here),
        np.array([(a, b) for _, a, b, _, _ in here], int).reshape(len(here), 2),
        np.array([value for *_, value, _ in here]),
        np.array([u for *_, u in here]),
        length,
        flat @ points.cov_xyz_mm2 @ flat.T,
    )


def missing(points: Points, asked: list[Asked]) -> list[dict[str, Any]]:
    """The lengths of which an end was not reconstructed."""
    known = {int(code) for code in points.code}
    return [{"line": line, "codes": [a, b]} for line, a, b, *_ in asked if not {a, b} <= known]


def spacing(world: World, points: Points) -> dict[str, Any] | None:
    """Centre-to-centre spacing of targets, in the place of the sphere spacing of parts 2 and 3.

    Of check bars and of neighbours on the measuring lines; of a field that has neither, of each check target and the
    one nearest to it. None where nothing of that was measured.
    """
    field = world.field
    asked: list[Asked] = [
        (bar.name, *bar.codes, bar.length_mm, bar.u_length_mm) for bar in field.scale_bars if bar.role == "check"
    ]
    for line in field.measuring_lines:
        places = (0.0, *line.length_mm)
        for k, (a, b) in enumerate(pairwise(line.codes)):
            u = line.u_length_mm * (1 if k == 0 else np.sqrt(2))
            asked.append((line.name, a, b, places[k + 1] - places[k], float(u)))
    rule = "check bars and neighbours on the measuring lines"
    if not asked:
        rule, asked = "each check target and the one nearest to it", _nearest(check_positions(world))
    found = measured(points, asked)
    if not len(found):
        return None
    worst = int(np.argmax(np.abs(found.dl_mm)))
    return {
        "rule": rule,
        "spacings": len(found),
        "max_abs_mm": float(np.abs(found.dl_mm).max()),
        "worst_codes": [int(code) for code in found.codes[worst]],
        "rms_mm": float(np.sqrt((found.dl_mm**2).mean())),
        "rms_u_mm": float(np.sqrt((found.u_dl_mm**2).mean())),
    }


def planes(scene: SceneFile, world: World, points: Points) -> list[dict[str, Any]]:
    """Flatness error of every plane of targets, four or more: those stuck on one board, and grids one target deep.

    The error is the range of measured less true heights, so that a bent board counts as the form it has; beside it the
    ranges of both about planes of their own. Targets in a straight row span no plane and are left out.
    """
    at, marks = check_positions(world), world.marks
    groups = {
        f"targets on board {world.panels.name[panel]}": [
            int(code) for code in marks.code[(marks.role == CHECK) & (marks.panel == panel)]
        ]
        for panel in np.unique(marks.panel[marks.role == CHECK])
    }
    for part in scene.check_targets:
        if isinstance(part, CheckGrid) and sorted(part.counts)[0] == 1 < sorted(part.counts)[1]:
            n = int(np.prod(part.counts))
            groups[f"grid of targets {part.first_code} to {part.first_code + n - 1}"] = [
                part.first_code + k for k in range(n)
            ]
    known, rows = {int(code) for code in points.code}, []
    for name, codes in groups.items():
        here = [code for code in codes if code in known]
        true = np.array([at[code] for code in here]).reshape(len(here), 3)
        if len(here) < 4 or in_a_row(true):
            continue
        found = points.xyz_mm[points.rows(here)]
        rows.append(
            {
                "plane": name,
                "targets": len(here),
                "measured_mm": flatness(found),
                "true_mm": flatness(true),
                "error_mm": form_error(found, true),
            }
        )
    return rows


def points_card(
    world: World, calibration: Calibration, points: Points, lengths: MeasuredLengths
) -> dict[str, Any] | None:
    """Check points: relative accuracy by both definitions, external over internal accuracy, coverage, NEES, E_n, and
    the law of the errors over their uncertainties, decorrelated by the full covariance and coordinate by coordinate.

    Internal accuracy is the claimed sigma, external the RMSE, both after the same fit of six parameters, of which
    points in a straight row see five (`fitted_parameters`). None of fewer than three check points, which allow no fit.
    """
    score = score_points(world, calibration, points)
    n = len(score.code)
    lengths_en = lengths.en
    of_zeta, _ = pit_uniformity(2 * lengths_en)
    of_lengths = {
        "en_worst": float(lengths_en[np.argmax(np.abs(lengths_en))]),
        "en_within_1": float((np.abs(lengths_en) <= 1).mean()),
        "covered_95": float((np.abs(lengths.dl_mm) <= norm.ppf(0.975) * lengths.u_dl_mm).mean()),
        "zeta_worst": 2 * float(lengths_en[np.argmax(np.abs(lengths_en))]),
        "zeta_within_2": float((np.abs(lengths_en) <= 1).mean()),
        "zeta_pit_distance": of_zeta,
        "lengths": len(lengths),
    }
    if n < 3:
        return {"check_points": n, "of_lengths": of_lengths}
    sigma = float(np.sqrt(np.trace(aligned_covariance(score.cov_mm2, score.true_mm)) / (3 * n)))
    rmse, largest = float(np.sqrt((score.fitted_mm**2).mean())), float(pdist(score.true_mm).max())
    # A free network has no datum to compare in: its claims are judged after the fit, and where that leaves nothing of a
    # direction (three points always meet their plane), there is nothing to judge.
    fitted = rigid_basis(score.true_mm).shape[1]
    anees, freedom = (score.anees_fitted, 3 * n - fitted) if score.free else (score.anees, 3 * n)
    each = [decorrelated(score.error_mm[k], score.covariance(k)) for k in range(n)]
    hits = sum(float(z @ z) <= chi2.ppf(0.95, len(z)) for z in each)
    left = score.u_mm**2 > NOTHING * score.u_mm.max() ** 2
    en = score.error_mm[left] / (2 * score.u_mm[left])
    z = decorrelated(score.error_mm.ravel(), score.cov_mm2)
    (distance, p), (of_coordinates, _) = pit_uniformity(z), pit_uniformity(2 * en)
    return {
        "check_points": n,
        "expected": score.expected,
        "fitted_parameters": fitted,
        "rmse_mm": rmse,
        "sigma_mm": sigma,
        "external_over_internal": rmse / sigma,
        "largest_distance_mm": largest,
        "diagonal_mm": world.field_diagonal_mm,
        "relative_accuracy_sigma": largest / sigma,
        "relative_accuracy_rmse": largest / rmse,
        "relative_accuracy_sigma_diagonal": world.field_diagonal_mm / sigma,
        "relative_accuracy_rmse_diagonal": world.field_diagonal_mm / rmse,
        "anees": anees,
        "anees_band_95": list(nees_band(freedom)),
        "after_fit": score.free,
        "coverage_95": hits / n,
        "coverage_band_99": [hits_of / n for hits_of in joint_hit_band(score.cov_mm2, 3)],
        "en_worst": float(en[np.argmax(np.abs(en))]),
        "en_within_1": float((np.abs(en) <= 1).mean()),
        "pit": {"distance": distance, "p": p, "values": len(z), "distance_of_coordinates": of_coordinates},
        "of_lengths": of_lengths,
    }


def _nearest(at: dict[int, np.ndarray]) -> list[Asked]:
    codes = sorted(at)
    if len(codes) < 2:
        return []
    apart = squareform(pdist(np.array([at[code] for code in codes])))
    np.fill_diagonal(apart, np.inf)
    pairs = {tuple(sorted((k, int(np.argmin(row))))) for k, row in enumerate(apart)}
    return [(f"{codes[a]} to {codes[b]}", codes[a], codes[b], float(apart[a, b]), 0.0) for a, b in sorted(pairs)]
