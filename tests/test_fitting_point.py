"""The fitted point: check values of METHODS section 3, its claims by Monte Carlo, and what it cannot see."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from testfield.errors import TestfieldError
from testfield.reconstruct.points import Points
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.statistics.consistency import hit_band
from testfield.study.finding import Outcome
from testfield.study.page import as_html, drawn, write_page
from testfield.study.study import Extent, run_study
from testfield.uncertainty.fitting_point import FittedPoint, fit_point, without_correlation
from testfield_studies.fitting_point.experiment import ALL, LAYOUTS, VERTEX, cases, fits, true_positions
from testfield_studies.fitting_point.page import STUDY, read
from testfield_studies.fitting_point.renders import alike_table, mean_bias, render_table
from testfield_studies.fitting_point.tables import block_table

SCENES = Path(__file__).parents[1] / "scenes"
ICOSAHEDRON = np.array(
    [v for a in (1, -1) for b in (1, -1) for v in ((0, a, b * 1.618), (a, b * 1.618, 0), (b * 1.618, 0, a))]
)


def rig(lengths_mm: np.ndarray, one_sided: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """End points (m, 3) around a vertex (3,): the icosahedron's, or those of its corners on one side."""
    V = np.array([100.0, -200.0, 300.0])
    n = ICOSAHEDRON / np.linalg.norm(ICOSAHEDRON, axis=1, keepdims=True)
    if one_sided:
        n = n[n @ n[0] > 0]
    return V + np.resize(lengths_mm, len(n))[:, None] * n, V


def exact(ends: np.ndarray, vertex: np.ndarray, weights: str = "equal", off: np.ndarray | float = 0.0) -> FittedPoint:
    """A fit with point covariances of 0.01 mm, and lengths that are `off` from the true ones."""
    m = len(ends)
    lengths = np.linalg.norm(vertex - ends, axis=1) + off
    return fit_point(ends, lengths, vertex, 1e-4 * np.eye(3 * m + 3), np.full(m, 0.005), weights)  # type: ignore[arg-type]


# ------------------------------------------------------------------ check values
def test_the_deterministic_vector_to_all_digits() -> None:
    Q = np.array([[0, 0, 0], [2000, 0, 0], [0, 2000, 0], [0, 0, 2000.0]])
    found = exact(Q, np.array([500, 600, 700.0]), off=np.array([0.05, -0.03, 0.02, 0.04]))
    for values, digits in (
        (found.xyz_mm, (500.06317366, 600.02088627, 700.00690690)),
        (found.residual_mm, (0.00332366, 0.01395606, 0.01562850, 0.01682832)),
        (found.s0, 0.02707878),
        (found.dop, (0.94784109, 0.88435533, 0.82733832)),
        (found.dispersion, (0.02566638, 0.02394727, 0.02240332)),
    ):
        assert values == pytest.approx(digits, abs=6e-9)
    assert found.s_sys_mm == found.s0


def test_what_is_exact_is_fitted_exactly() -> None:
    for weights in ("equal", "covariance"):
        for one_sided in (False, True):
            found = exact(*rig(np.array([400.0, 500, 600]), one_sided), weights)
            assert np.abs(found.bias_mm).max() < 1e-9 and np.abs(found.residual_mm).max() < 1e-9


def test_isotropic_end_points_give_the_closed_form() -> None:
    """s_P = s sqrt(3 / m), which shrinks with m, while s_sys does not."""
    ends, V = rig(np.array([500.0]))
    m, s = len(ends), 0.02
    cov = np.zeros((3 * m + 3, 3 * m + 3))
    cov[: 3 * m, : 3 * m] = s**2 * np.eye(3 * m)
    found = fit_point(ends, np.linalg.norm(V - ends, axis=1), V, cov, np.zeros(m))
    assert np.sqrt(np.diag(found.cov_mm2)) == pytest.approx(s * np.sqrt(3 / m), rel=1e-3)
    assert found.dop == pytest.approx(np.sqrt(3 / m), rel=1e-3)
    assert found.expected_s_sys_mm == pytest.approx(s, rel=1e-6)


def test_covariance_weights_claim_their_cofactors() -> None:
    rng = np.random.default_rng(1)
    ends, V = rig(np.array([400.0, 500, 600]), True)
    A = rng.standard_normal((3 * len(ends) + 3,) * 2)
    found = fit_point(
        ends, np.linalg.norm(V - ends, axis=1), V, 1e-4 * A @ A.T, np.full(len(ends), 0.005), "covariance"
    )
    assert np.diag(found.cov_mm2) == pytest.approx(found.dop**2, rel=1e-9)


def test_the_bands_of_the_confidence_test() -> None:
    assert hit_band(1000, 0.95) == (931, 967) and hit_band(500, 0.95) == (462, 487)
    assert hit_band(88, 0.05) == (0, 10) and hit_band(88, 0.01) == (0, 4)
    from scipy.stats import binom

    for p, expected, one_or_none in ((0.05, 4.4, 0.062), (0.01, 0.88, 0.78), (0.0027, 0.24, 0.976)):
        assert 88 * p == pytest.approx(expected, abs=0.005)
        assert binom.cdf(1, 88, p) == pytest.approx(one_or_none, abs=1e-3)


# ------------------------------------------------------------------ what it sees of scale
def test_mirror_images_are_blind_to_scale_and_one_side_is_not() -> None:
    q = 1e-3
    for one_sided in (False, True):
        ends, V = rig(np.array([1000.0]), one_sided)
        true = np.linalg.norm(V - ends, axis=1)
        m = len(ends)
        found = fit_point((1 + q) * ends, true, (1 + q) * V, 1e-4 * np.eye(3 * m + 3), np.full(m, 0.005))
        assert found.bias_mm == pytest.approx(found.scale_bias_mm(q, true), abs=2e-3 * 1.0)
        if one_sided:
            assert np.linalg.norm(found.bias_mm) > 1.0  # more than a millimetre of 1 m x 1e-3: seen
            assert abs(found.mean_relative) < 0.5 * q  # and so missing in the residuals
        else:
            assert np.abs(found.bias_mm).max() < 1e-9
            assert found.residual_mm == pytest.approx(-q * true, abs=1e-6)
            assert np.sqrt((found.residual_mm**2).mean()) == pytest.approx(1.0, abs=1e-6)
            assert found.mean_relative == pytest.approx(-q, abs=1e-9)


def test_end_points_in_a_plane_with_the_vertex_are_named() -> None:
    ends = np.array([[1000, 0, 0], [0, 1000, 0], [-900, 100, 0], [200, -800, 0], [700, 700, 0.0]])
    with pytest.raises(TestfieldError, match=r"unobservable along its normal \([+-]0.000, [+-]0.000, [+-]1.000\)"):
        exact(ends, np.zeros(3))
    with pytest.raises(TestfieldError, match="four or more"):
        exact(ends[:3], np.array([0, 0, 500.0]))
    found = exact(ends, np.array([0, 0, 500.0]))  # in one half-space: determined, though worse
    assert np.abs(found.bias_mm).max() < 1e-9 and found.dop[2] > found.dop[0]


# ------------------------------------------------------------------ its claims
@pytest.mark.parametrize("weights", ["equal", "covariance"])
def test_claims_of_point_and_bias_are_true_where_points_are_correlated(weights: str) -> None:
    """With errors drawn from a covariance in which a shared calibration moves, turns and scales everything."""
    rng = np.random.default_rng(3)
    ends, V = rig(np.array([400.0, 500, 600]), True)
    everything = np.vstack([ends, V])
    n, trials = len(everything), 800
    shared = np.zeros((n, 3, 7))
    for k, axis in enumerate(np.eye(3)):
        shared[:, :, k], shared[:, :, 3 + k] = axis, np.cross(axis, everything) / 1000
    shared[:, :, 6] = everything / 1000
    G = 0.02 * shared.reshape(3 * n, 7)
    cov = 0.01**2 * np.eye(3 * n) + G @ G.T
    root, true = np.linalg.cholesky(cov), np.linalg.norm(V - ends, axis=1)
    u, m = np.full(len(ends), 0.005), len(ends)
    chi = {"bias": 0.0, "point": 0.0, "alone": 0.0, "s0": 0.0, "mean": 0.0}
    hits = 0
    for _ in range(trials):
        noisy = everything + (root @ rng.standard_normal(3 * n)).reshape(n, 3)
        lengths = true + u * rng.standard_normal(m)
        found = fit_point(noisy[:-1], lengths, noisy[-1], cov, u, weights)  # type: ignore[arg-type]
        off = found.xyz_mm - V
        chi["bias"] += found.bias_chi2 / 3
        hits += found.bias_chi2 <= 7.8147
        chi["point"] += off @ np.linalg.solve(found.cov_mm2, off) / 3
        chi["mean"] += (found.mean_relative / found.u_mean_relative) ** 2
        chi["s0"] += (found.s_sys_mm / found.expected_s_sys_mm if weights == "equal" else found.s0) ** 2
        bold = fit_point(noisy[:-1], lengths, noisy[-1], without_correlation(cov), u, weights)  # type: ignore[arg-type]
        off = bold.xyz_mm - V
        chi["alone"] += off @ np.linalg.solve(bold.cov_mm2, off) / 3
    # Three components in 800 trials: 0.09 is three times sqrt(2 / 2400).
    assert all(chi[name] / trials == pytest.approx(1, abs=0.09) for name in ("bias", "point")), chi
    assert all(chi[name] / trials == pytest.approx(1, abs=0.17) for name in ("s0", "mean")), chi
    low, high = hit_band(trials, 0.95, 0.999)
    assert low <= hits <= high
    assert chi["alone"] / trials > 1.5  # without the correlations the claim is too bold


# ------------------------------------------------------------------ the study
def test_the_rig_is_symmetric_and_the_truth_gives_zeros() -> None:
    world = build_world(load_scene(SCENES / "fitting_point.toml"))
    true = true_positions(world, ("A",))
    for a, b in zip(LAYOUTS["one-sided"], LAYOUTS["symmetric"][6:], strict=True):
        assert true[a] + true[b] == pytest.approx(2 * true[VERTEX], abs=1e-9)
    codes = np.array(sorted(true))
    n = len(codes)
    cov = 0.01**2 * (np.eye(3 * n) + np.kron(np.ones((n, n)), np.eye(3)))
    for q in (0.0, 1e-3):
        xyz = (1 + q) * np.array([true[int(code)] for code in codes])
        points = Points(
            method="true",
            code=codes,
            xyz_mm=xyz,
            cov_xyz_mm2=cov,
            rays=np.full(n, 5),
            residual_rms_px=np.zeros(n),
            rejected=np.zeros(n, int),
        )
        table = pd.DataFrame(fits(points, world, ("A",), np.zeros(len(ALL)), q))
        size = np.sqrt(sum(table[f"bias_{axis}_mm"] ** 2 for axis in "xyz"))
        blind = (table["layout"] == "symmetric").to_numpy()
        assert size[blind].max() < 1e-9  # alike weights keep the symmetry
        assert (size[~blind] > 0.5).all() if q else size.max() < 1e-9
        assert table["mean_relative_ppm"][blind].to_numpy() == pytest.approx(-1e6 * q, abs=0.01)


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    """Rows of trials made here, without pictures: claims are true, and points share an error. Three seeds of 88 trials
    with a right bar, and twenty trials with a wrong one."""
    rng, world = np.random.default_rng(77), build_world(load_scene(SCENES / "fitting_point.toml"))
    true = true_positions(world, ("A",))
    codes = np.array(sorted(true))
    n, at = len(codes), np.array([true[code] for code in sorted(true)])
    shared = 0.02 * np.tile(np.eye(3), (n, 1))
    cov = 0.01**2 * np.eye(3 * n) + shared @ shared.T
    root, rows = np.linalg.cholesky(cov), []
    for bar, trials, q in (("right", 264, 0.0), ("wrong", 20, 1e-3)):
        for k in range(trials):
            xyz = (1 + q) * (at + (root @ rng.standard_normal(3 * n)).reshape(n, 3))
            points = Points(
                method="drawn",
                code=codes,
                xyz_mm=xyz,
                cov_xyz_mm2=cov,
                rays=np.full(n, 5),
                residual_rms_px=np.zeros(n),
                rejected=np.zeros(n, int),
            )
            labels = {"bar": bar, "seed": 88 + k // 88, "first": 0, "trial": k % 88}
            rows += [labels | row for row in fits(points, world, ("A",), rng.standard_normal(len(ALL)), q)]
    return pd.DataFrame(rows)


HOLDS, FAILS, OPEN = Outcome.HOLDS, Outcome.FAILS, Outcome.OPEN
LIMITS = ("limit_symmetric", "limit_one_sided")


def _outcomes(table: pd.DataFrame, *names: str) -> list[Outcome]:
    results = read(table)
    return [results[name].outcome for name in names]


def test_a_study_of_drawn_trials_accepts_true_claims_and_refuses_bold_ones(table: pd.DataFrame, tmp_path: Path) -> None:
    found = read(table)
    assert STUDY.verdict(found) == HOLDS and found["blind"].outcome == HOLDS
    scale = found["blind"].quantities
    assert scale["flagged_one_sided"].value == 1 and scale["flagged_symmetric"].value < 0.3
    assert len(block_table(table[table["bar"] == "right"])) == 2 * 3
    bold = table.assign(bias_chi2=table["bias_chi2"] * 2.0)
    assert STUDY.verdict(read(bold)) == FAILS and _outcomes(bold, *LIMITS) == [FAILS, FAILS]
    for layout in ("symmetric", "one_sided"):  # bias and dispersion, and beside them what METHODS 3.3 asks for
        q = {name: quantity.value for name, quantity in found[f"unseen_{layout}"].quantities.items()}
        assert 0 < q["dispersion"] < q["s_sys"] < 20 and q["bias"] > 0 and abs(q["mean_residual"]) < 10
    write_page(STUDY, found, Extent(cases=6, done=6, failures=[], quick=True), tmp_path)
    assert "the limits hold in both layouts" in (tmp_path / "report.html").read_text()


SO_FAR = {
    "nothing": lambda t: t[:0],
    "labels alone": lambda t: t[["bar", "seed", "first"]][:3],
    "a wrong bar alone": lambda t: t[t["bar"] == "wrong"],
    "a right bar alone": lambda t: t[t["bar"] == "right"],
    "no one-sided layout": lambda t: t[t["layout"] == "symmetric"],
    "no symmetric layout": lambda t: t[t["layout"] == "one-sided"],
    "no one-sided layout with a wrong bar": lambda t: t[(t["layout"] == "symmetric") | (t["bar"] == "right")],
    "one trial": lambda t: t[(t["trial"] == 0) & (t["seed"] == 88)],
    "a trial of each render": lambda t: t[t["trial"] == 0],
    "one render": lambda t: t[t["seed"] == 88],
    "equal weights alone": lambda t: t[t["way"] == "equal"],
    "no equal weights": lambda t: t[t["way"] != "equal"],
}


@pytest.mark.parametrize("rows", SO_FAR)
def test_of_what_is_not_measured_yet_nothing_is_said(table: pd.DataFrame, rows: str) -> None:
    so_far = SO_FAR[rows](table)
    found = read(so_far)
    assert "nan" not in " ".join(STUDY.concluded(found))
    own = so_far[(so_far["bar"] == "right") & (so_far["way"] == "covariance")] if "way" in so_far else so_far[:0]
    there = set(own["layout"]) if len(own) else set()
    for layout in LAYOUTS:
        key = layout.replace("-", "_")
        assert (found[f"limit_{key}"].outcome == OPEN) == (layout not in there)
        assert found[f"common_bias_{key}"].measured == (layout in there and own["seed"].nunique() > 1)
    for drawing in found.plots:
        drawn(drawing)
    assert all("nan" not in as_html(shown) for shown in found.tables)


def test_findings_follow_the_counts(table: pd.DataFrame) -> None:
    """What carries a finding, contradicts it, and leaves it open."""
    wrong, right = (table["bar"] == bar for bar in ("wrong", "right"))
    own = right & (table["way"] == "covariance")
    first = own & (table["seed"] == 88)

    def with_chi2(where: pd.Series, chi2: "np.ndarray | float", base: pd.DataFrame = table) -> pd.DataFrame:
        return base.assign(bias_chi2=base["bias_chi2"].where(~where, chi2))

    within = with_chi2(own, 1.0)
    for beyond, outcome in ((1, OPEN), (4, OPEN), (5, HOLDS), (10, HOLDS), (60, FAILS)):
        found = read(with_chi2(first & (table["trial"] < beyond), 50.0, within))["count"]
        assert found.outcome == outcome and found.quantities["most_beyond"].value == beyond

    mirrored = wrong & (table["layout"] == "symmetric") & (table["way"] == "equal")
    one_sided = wrong & (table["layout"] == "one-sided") & (table["way"] == "equal")
    assert _outcomes(with_chi2(mirrored, 1.0), "blind") == [HOLDS]
    assert _outcomes(with_chi2(mirrored & (table["trial"] < 16), 50.0), "blind") == [FAILS]  # 80 % flagged
    assert _outcomes(with_chi2(mirrored | one_sided, 1.0), "blind") == [OPEN]


def test_correlations_and_dispersion_are_found_as_they_are(table: pd.DataFrame) -> None:
    names = ("ignored_symmetric", "cancels_symmetric", "unseen_symmetric")
    assert _outcomes(table, *names) == [HOLDS, HOLDS, HOLDS]
    alone = table["way"] == "alone"
    other = table.assign(
        point_chi2=table["point_chi2"].where(~alone, 1.0 + 0.01 * table["trial"] / 88),
        bias_chi2=table["bias_chi2"].where(~alone, 9.0 + table["trial"]),
    )
    assert _outcomes(other, *names) == [FAILS, FAILS, HOLDS]
    wide = {f"dispersion_{axis}_mm": 100 * table[f"dispersion_{axis}_mm"] for axis in "xyz"}
    assert _outcomes(table.assign(**wide), *names) == [HOLDS, HOLDS, FAILS]


def test_renders_that_differ_are_told_and_a_common_bias_is_only_claimed_where_it_is(table: pd.DataFrame) -> None:
    right = table[table["bar"] == "right"]
    names = ("alike_symmetric", "alike_one_sided")
    assert (alike_table(right)["p"] > 1e-3).all() and len(alike_table(right)) == 4
    assert _outcomes(table, *names) == [HOLDS, HOLDS]
    by_render = render_table(right)
    assert by_render["trials"].tolist() == [88] * 6
    assert by_render["within"].sum() == sum(read(table)[name].quantities["within_limit"].value for name in LIMITS)

    # Each render has a bias of its own: they differ, and what they have in common does not differ from zero.
    own = table["seed"].map({88: -0.02, 89: 0.0, 90: 0.02})
    moved = table.assign(bias_x_mm=table["bias_x_mm"] + own)
    p = alike_table(moved[moved["bar"] == "right"]).set_index(["layout", "what"])["p"]
    assert (p[:, "mean bias"] < 1e-6).all() and (p[:, "share of hits"] > 1e-3).all()
    assert _outcomes(moved, *names, "common_bias_symmetric") == [FAILS, FAILS, OPEN]
    # The same bias in all: they are alike, and it is the same in every exposure.
    common = table.assign(bias_x_mm=table["bias_x_mm"] + 0.2)
    found = read(common)["common_bias_symmetric"]
    assert found.outcome == HOLDS and found.quantities["x"].value == pytest.approx(200, abs=5)
    mean = mean_bias(common[common["bar"] == "right"], "symmetric")
    assert mean is not None and mean.differs[0] and mean.renders == 3
    spread = mean_bias(moved[moved["bar"] == "right"], "symmetric")
    assert spread is not None and not spread.differs[0]


def test_a_bias_of_each_render_widens_the_error_of_the_mean() -> None:
    """Renders of 125 trials with a bias of their own: the error from all trials as if independent is far too small,
    the one from the renders' means holds."""
    rng, off, naive = np.random.default_rng(5), [], []
    for _ in range(150):
        rows = [
            {"layout": "symmetric", "way": "covariance", "seed": seed, "bias_chi2": 1.0}
            | {f"bias_{axis}_mm": value for axis, value in zip("xyz", xyz, strict=True)}
            for seed, common in enumerate(0.01 * rng.standard_normal((8, 3)))
            for xyz in common + 0.01 * rng.standard_normal((25, 3))
        ]
        drawn_rows = pd.DataFrame(rows)
        mean = mean_bias(drawn_rows, "symmetric")
        assert mean is not None
        off.append(mean.differs.any())
        naive.append(abs(drawn_rows["bias_x_mm"].mean()) > 1.96 * drawn_rows["bias_x_mm"].std() / np.sqrt(200))
    assert np.mean(off) < 0.11 and np.mean(naive) > 0.4


def test_the_full_study_has_a_thousand_trials_and_the_quick_one_few() -> None:
    full, quick = ([c for c in cases(q) if c.labels["bar"] == "right"] for q in (False, True))
    assert sum(c.options["trials"] for c in full) == 1000
    assert sum(c.options["trials"] for c in quick) <= 50
    # A case does every trial once, and names it.
    assert len({(c.labels["seed"], c.labels["first"] + k) for c in full for k in range(c.options["trials"])}) == 1000


@pytest.mark.slow
def test_the_quick_study_renders_and_finds_the_blind_layout(tmp_path: Path) -> None:
    found = run_study(STUDY, tmp_path, True, 2)["blind"].quantities
    assert found["flagged_one_sided"].value == 1 and found["flagged_symmetric"].value < 0.5
