"""Study `wls`: weighted least squares by parametric equations (METHODS section 1) on rendered fields; plan and work.

A case is one exposure of one scene at one noise level. Its frames are exposed and detected anew, and the workshop is
drawn anew too (where the marks were printed, the boards' scale, the bar's length, each as uncertain as its sheet says),
so that the exposures are independent of each other. All check targets of an exposure share its calibration and are not.
Every set of cameras is calibrated in two ways: exactly (the truth with no uncertainty), and as a user would who has
these cameras and the boards: from the same images, by `stitched`.
"""

from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.stats import chi2

from testfield.calibrate.calibration import Calibration
from testfield.chain.run import Run
from testfield.chain.stages import run_stage
from testfield.chain.trials import reexposed
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.evaluate.case import Case
from testfield.measure.pipeline import calibrate, reconstruct
from testfield.measure.recipe import Algorithm, Recipe
from testfield.reconstruct.points import Points
from testfield.scene.world import CHECK, World
from testfield.score.align import aligned_covariance, rigid_fit
from testfield.score.camera import true_in_datum
from testfield.seeds import seed_of
from testfield.targets.field import Field
from testfield.uncertainty.certificates import draw_certificates
from testfield_studies.truth import exact_calibration
from testfield_studies.wls.claims import narrower_claims, of_the_cameras
from testfield_studies.wls.field import field_scene

METHODS = ("midpoint", "dlt", "dlt_p34", "parametric_wls", "gls", "ml", "bundle", "opencv", "colmap")
NOISES = {"low": {"time_ms": 1.5, "read_noise_e": 6.0}, "high": {"time_ms": 0.3, "read_noise_e": 6.0}}
"""White gathers about 1,500 electrons, or 300: centres of dots err by 0.004 to 0.01 px, or 0.01 to 0.025 px."""
WORKSHOP = {"print_mm": 0.02, "scale_ppm": 20.0, "bar_mm": 0.005}
"""Standard deviations of each coordinate of each mark, of the boards' common scale, of the bar's length."""
NUMBERS = (2, 3, 4, 6, 8, 12, 16)
MOST_OF_THEM = 0.75
"""The part of the cameras from which a target must have been measured to be compared."""
EXPOSURES = 26
"""Times 42 check targets: 1,092 points in a cell, twice as many where two sets of cameras make one; with three targets
lost in every exposure there are still more than 1,000."""
KEPT_ERRORS = ("parametric_wls", "gls")
"""Methods of which each point's error is kept, to tell what comes again in every exposure from what scatters."""
QUICK_NUMBERS, QUICK_EXPOSURES = (2, 4, 8), 3
P = 0.95


def cases(quick: bool) -> list[Case]:
    """Exposures of both scenes at both noise levels; the quick ones have the first eight stations only."""
    numbers, exposures = (QUICK_NUMBERS, QUICK_EXPOSURES) if quick else (NUMBERS, EXPOSURES)
    methods = [name for name in METHODS if name != "colmap" or find_spec("pycolmap")]
    return [
        Case(
            {"ranges": ranges, "noise": noise, "exposure": k},
            f"{__name__}:measure",
            field_scene(ranges == "spread", max(numbers)),
            {"numbers": list(numbers), "methods": methods} | NOISES[noise] | WORKSHOP,
        )
        for ranges in ("equal", "spread")
        for k in range(exposures)
        for noise in NOISES
    ]


def camera_sets(stations: int, numbers: list[int]) -> list[tuple[int, int, slice]]:
    """(n, which set, its stations): of each number the first n stations, and n others as far as there are so many."""
    sets = [(n, 0, slice(0, n)) for n in numbers]
    others = [(n, 1, slice(start, start + n)) for n in numbers if (start := min(stations // 2, stations - n)) > 0]
    return sorted(sets + others, key=lambda item: item[:2])


def measure(case: Case, run: Run | None) -> list[dict[str, Any]]:
    """All methods on all sets of cameras, under both calibrations: a row each, summed over the points."""
    assert run is not None
    options, name = case.options, "/".join(str(value) for value in case.labels.values())
    run_stage(run, "render")
    scene = run.scene
    exposed = scene.model_copy(
        update={
            "exposure": scene.exposure.model_copy(update={"time_ms": options["time_ms"]}),
            "sensor": scene.sensor.model_copy(update={"read_noise_e": options["read_noise_e"]}),
        }
    )
    observations = reexposed(replace(run, scene=exposed), seed_of(scene.seed, f"study/wls/{name}/noise"))
    exact = exact_calibration(run.world)
    sheet = _sheet(run.field, options)
    workshop = seed_of(scene.seed, f"study/wls/{name}/workshop")
    observations, sheet = draw_certificates(observations, exact, sheet, workshop)
    rows = []
    for n, which, part in camera_sets(len(run.stations), options["numbers"]):
        seen = observations_of(observations, run.stations[part])
        for kind in ("exact", "estimated"):
            labels = {"cameras": n, "set": which, "calibration": kind}
            try:
                calibration = exact if kind == "exact" else calibrate(seen, sheet, Recipe())
            except TestfieldError as error:
                rows.append(labels | {"method": "", "points": 0, "why": error.sentence()})
                continue
            rows += [labels | row for row in compared(seen, calibration, sheet, run.world, n, options["methods"])]
    return rows


def observations_of(observations: Observations, stations: tuple[str, ...]) -> Observations:
    """Only what these stations saw."""
    place = np.array([stations.index(s) if s in stations else -1 for s in observations.stations], int)
    here = observations.take(place[observations.station] >= 0)
    return replace(here, stations=stations, station=place[here.station])


def compared(
    seen: Observations, calibration: Calibration, sheet: Field, world: World, n: int, methods: list[str]
) -> list[dict[str, Any]]:
    """A row each method, over those check targets that all methods have from most of the n cameras; a method that
    fails, or gives no three of them, has a row that says why, and the others are compared without it."""
    here = np.flatnonzero(world.marks.role == CHECK)
    checks = set(world.marks.code[here].tolist())
    found: dict[str, Points] = {}
    lost: dict[str, str] = {}
    for method in methods:
        try:
            points = reconstruct(seen, calibration, sheet, Recipe(reconstructor=Algorithm(method)))
        except TestfieldError as error:
            lost[method] = error.sentence()
            continue
        if len(checks & measured(points, n)) < 3:
            lost[method] = FEWER
        else:
            found[method] = points
    codes = sorted(checks.intersection(*(measured(points, n) for points in found.values()))) if found else []
    if len(codes) < 3:
        lost |= dict.fromkeys(found, FEWER)
        found = {}
    answer = {method: {"method": method, "points": 0, "why": why} for method, why in lost.items()}
    if found:
        datum, _ = true_in_datum(world, calibration.board_names)
        place = {int(world.marks.code[k]): k for k in here}
        true = (world.mark_world_mm[[place[code] for code in codes]] - datum.t_mm[0]) @ datum.R[0]
        common = of_the_cameras(seen, calibration, sheet, codes, true)
        normal = common.pop("normal")
        narrow = narrower_claims(seen, calibration, sheet, set(found))
        answer |= {
            method: {"method": method}
            | scored(points, codes, true, calibration.method != "exact", narrow.get(method))
            | (_across(points, codes, true, normal) if n == 2 else {})
            | common
            for method, points in found.items()
        }
    return [answer[method] for method in methods]


FEWER = "fewer than three points were measured"


def measured(points: Points, n: int) -> set[int]:
    """Codes that a method has from most of n cameras, with a finite place and a finite covariance."""
    finite = np.isfinite(points.xyz_mm).all(axis=1)
    finite &= np.isfinite(np.diag(points.cov_xyz_mm2)).reshape(-1, 3).all(axis=1)
    return {int(code) for code in points.code[finite & (points.rays >= MOST_OF_THEM * n)]}


def scored(
    points: Points, codes: list[int], true_mm: np.ndarray, fit: bool, narrow_mm2: tuple[np.ndarray, np.ndarray] | None
) -> dict[str, Any]:
    """Errors and claims of one method.

    `square_mm2` sums the squared errors of all coordinates and `claimed_mm2` what the sandwich predicts of it: in the
    frame of the first board, or after a rigid fit of six parameters (`fit`), for the frame's own error is every
    method's; `nees` is that of all points together per degree of freedom, `nees_points` the mean over points taken one
    by one, and `hits` how many lie in their 95 % region.

    In the frame of the first board in any case, as METHODS section 1.6 has it: `frame_mm2` and `claimed_frame_mm2`,
    `nees_points_frame` under the sandwich, and `nees_narrow` and `narrow_mm2` under the narrower claim (codes,
    (n, 3, 3)) where there is one. That claim is of single points: it says nothing of what points share, so what a fit
    leaves of it cannot be told.

    Of methods in `KEPT_ERRORS` also `error_mm`, the errors in `square_mm2`, point after point, and `codes`.
    """
    rows = points.rows(codes)
    error, covariance = points.xyz_mm[rows] - true_mm, points.covariance_of(rows)
    in_frame = _squared(error, _blocks(covariance))
    answer: dict[str, Any] = {
        "points": len(codes),
        "rejected": int(points.rejected.sum()),
        "frame_mm2": float((error**2).sum()),
        "claimed_frame_mm2": float(np.trace(covariance)),
        "nees_points_frame": float(in_frame.mean() / 3),
    }
    if narrow_mm2 is not None:
        own = dict(zip(narrow_mm2[0].tolist(), narrow_mm2[1], strict=True))
        blocks = np.array([own[code] for code in codes])
        answer["nees_narrow"] = float(_squared(error, blocks).mean() / 3)
        answer["narrow_mm2"] = float(np.trace(blocks, axis1=1, axis2=2).sum())
    freedom = error.size
    if fit:
        R, t = rigid_fit(points.xyz_mm[rows], true_mm)
        error, covariance = points.xyz_mm[rows] @ R.T + t - true_mm, aligned_covariance(covariance, true_mm)
        freedom -= 6
    whole = np.linalg.pinv(covariance, rcond=1e-10, hermitian=True)
    single = _squared(error, _blocks(covariance))
    answer |= {
        "square_mm2": float((error**2).sum()),
        "claimed_mm2": float(np.trace(covariance)),
        "nees": float(error.ravel() @ whole @ error.ravel() / freedom),
        "nees_points": float(single.mean() / 3),
        "hits": int((single <= chi2.ppf(P, 3)).sum()),
    }
    if points.method in KEPT_ERRORS:
        answer |= {"error_mm": error.ravel().astype(np.float32), "codes": np.array(codes, np.int16)}
    return answer


def _across(points: Points, codes: list[int], true_mm: np.ndarray, normal: np.ndarray) -> dict[str, float]:
    """Squared errors and their prediction along the normals of both rays' planes, in the frame of the first board."""
    rows = points.rows(codes)
    error = points.xyz_mm[rows] - true_mm
    claimed = np.einsum("ni,nij,nj->n", normal, _blocks(points.covariance_of(rows)), normal)
    along = np.einsum("ni,ni->n", normal, error)
    return {"square_normal_mm2": float((along**2).sum()), "claimed_normal_mm2": float(claimed.sum())}


def _blocks(cov_mm2: np.ndarray) -> np.ndarray:
    """(n, 3, 3) of a joint covariance (3n, 3n)."""
    n = len(cov_mm2) // 3
    return cov_mm2.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n)]


def _squared(error_mm: np.ndarray, cov_mm2: np.ndarray) -> np.ndarray:
    """(n,) squared errors in units of covariances (n, 3, 3)."""
    return np.einsum("ni,ni->n", error_mm, np.linalg.solve(cov_mm2, error_mm[..., None])[..., 0])


def _sheet(field: Field, options: dict[str, Any]) -> Field:
    """The field sheet with what the workshop is said to be good for."""
    u = options["print_mm"]
    boards = tuple(replace(board, u_xy_mm=u, u_z_mm=u) for board in field.boards)
    bars = tuple(replace(bar, u_length_mm=options["bar_mm"]) for bar in field.scale_bars)
    return replace(field, boards=boards, scale_bars=bars, u_scale=1e-6 * options["scale_ppm"])
