"""Grey methods: what the grey uncertainty is, what the relational degrees are, and what neither can do."""

import numpy as np
import pytest

from testfield.errors import TestfieldError
from testfield.seeds import generator
from testfield.uncertainty import grey_relations as relations
from testfield.uncertainty.grey_uncertainty import (
    ESTIMATORS,
    bessel_bias,
    bessel_uncertainty,
    gaps_as_measured,
    grey_coefficients,
    l1_norm_uncertainty,
    sup_norm_uncertainty,
    unsorted_uncertainty,
)

FIVE = np.array([10.012, 10.007, 10.019, 10.004, 10.010])

LAWS = {
    "normal": lambda rng, size: rng.normal(size=size),
    "uniform": lambda rng, size: rng.uniform(-np.sqrt(3), np.sqrt(3), size),
    "triangular": lambda rng, size: rng.triangular(-1, 0, 1, size) * np.sqrt(6),
    "Laplace": lambda rng, size: rng.laplace(size=size) / np.sqrt(2),
    "arcsine": lambda rng, size: np.sqrt(2) * np.sin(rng.uniform(-np.pi / 2, np.pi / 2, size)),
    "Rayleigh": lambda rng, size: (rng.rayleigh(size=size) - np.sqrt(np.pi / 2)) / np.sqrt(2 - np.pi / 2),
}


def test_the_textbook_sample_gives_its_gaps_and_its_three_uncertainties():
    assert np.allclose(5 * grey_coefficients(FIVE), [0.0064, 0.0098, 0.0102, 0.0086], atol=1e-13)
    assert sup_norm_uncertainty(FIVE) == pytest.approx(0.00510, abs=1e-12)
    assert bessel_uncertainty(FIVE) == pytest.approx(0.005683, abs=5e-7)
    assert l1_norm_uncertainty(FIVE) == pytest.approx(0.006204, abs=5e-7)


def test_unsorted_cumulation_gives_another_uncertainty_for_every_order_and_the_sorted_one_does_not():
    orders = [[10.012, 10.007, 10.019, 10.004, 10.010], np.sort(FIVE), [10.012, 10.004, 10.019, 10.007, 10.010]]
    found = {round(float(unsorted_uncertainty(np.random.default_rng(k).permutation(FIVE))), 4) for k in range(300)}
    assert {0.0034, 0.0051, 0.0032} <= found
    assert len({round(float(sup_norm_uncertainty(np.array(order))), 15) for order in orders}) == 1
    assert np.allclose(gaps_as_measured(np.sort(FIVE)), grey_coefficients(FIVE))


def test_the_sup_norm_is_peters_formula_and_the_l1_norm_is_downtons_to_the_last_digit():
    sample = generator(1, "grey").gamma(0.7, size=(200, 9))
    n = sample.shape[1]
    peters = 1.25 * np.abs(sample - sample.mean(axis=1, keepdims=True)).mean(axis=1)
    assert np.allclose(sup_norm_uncertainty(sample), peters, rtol=1e-14, atol=0)
    gini = np.abs(sample[:, :, None] - sample[:, None, :]).sum(axis=(1, 2)) / (n * (n - 1))
    assert np.allclose(l1_norm_uncertainty(sample), np.sqrt(np.pi) / 2 * gini, rtol=1e-13, atol=0)
    ranks = 2 * np.arange(1, n + 1) - n - 1
    downton = np.sqrt(np.pi) / (n * (n - 1)) * (np.sort(sample, axis=1) @ ranks)
    assert np.allclose(l1_norm_uncertainty(sample), downton, rtol=1e-13, atol=0)
    assert np.allclose(n * grey_coefficients(sample).sum(axis=1), n * (n - 1) * gini / 4, rtol=1e-13, atol=0)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_estimators_know_neither_order_nor_origin_and_follow_the_unit(name):
    estimate = ESTIMATORS[name]
    sample = generator(2, "grey").normal(size=(50, 7))
    u = estimate(sample)
    assert np.allclose(estimate(sample[:, [3, 1, 6, 0, 2, 5, 4]]), u, rtol=1e-13)
    assert np.allclose(estimate(sample + 1e3), u, rtol=1e-10)
    assert np.allclose(estimate(-2.5 * sample), 2.5 * u, rtol=1e-13)
    farther = sample.copy()
    farther[np.arange(50), sample.argmax(axis=1)] += 1.0
    assert (estimate(farther) > u).all()


def test_coordinates_along_any_axis_are_estimated_one_by_one():
    errors_mm = generator(3, "grey").normal(size=(6, 3)) * [1.0, 2.0, 5.0]
    assert grey_coefficients(errors_mm, axis=0).shape == (5, 3)
    for k in range(3):
        assert np.allclose(grey_coefficients(errors_mm, axis=0)[:, k], grey_coefficients(errors_mm[:, k]))
        assert sup_norm_uncertainty(errors_mm, axis=0)[k] == sup_norm_uncertainty(errors_mm[:, k])
        assert l1_norm_uncertainty(errors_mm, axis=0)[k] == pytest.approx(l1_norm_uncertainty(errors_mm[:, k]))
        assert bessel_uncertainty(errors_mm, axis=0)[k] == pytest.approx(bessel_uncertainty(errors_mm[:, k]))


MEANS = {
    "normal": (0.8155, 0.8912, 0.9458, 0.9800),
    "uniform": (0.841, 0.937, 1.010, 1.058),
    "triangular": (0.825, 0.909, 0.967, 1.003),
    "Laplace": (0.768, 0.832, 0.865, 0.880),
    "arcsine": (0.849, 0.959, 1.041, 1.098),
}


@pytest.mark.parametrize("law", MEANS)
def test_the_grey_uncertainty_of_small_samples_is_biased_by_law_as_tabulated(law):
    for n, mean in zip((3, 5, 10, 30), MEANS[law], strict=True):
        found = sup_norm_uncertainty(LAWS[law](generator(4, f"{law}/{n}"), (60_000, n)))
        error = found.std() / np.sqrt(len(found))
        assert abs(found.mean() - mean) < 4 * error + 0.0005  # the table's own digits and its 200 000 draws


@pytest.mark.parametrize(
    ("law", "ratio"),
    [
        ("normal", 0.997),
        ("uniform", 1.083),
        ("triangular", 1.021),
        ("Laplace", 0.884),
        ("arcsine", 1.125),
        ("Rayleigh", 1.0048),
    ],  # 2.5 sqrt(2 pi) (1 - Phi(sqrt(pi / 2))) / sqrt(2 - pi / 2)
)
def test_the_grey_uncertainty_of_a_large_sample_is_another_part_of_sigma_for_every_law(law, ratio):
    found = sup_norm_uncertainty(LAWS[law](generator(5, law), (20, 100_000))).mean()
    assert found == pytest.approx(ratio, abs=0.0015)


def test_there_is_no_miracle_in_small_samples_all_scatter_alike():
    table = {
        3: (0.525, 0.523, 0.525),
        5: (0.373, 0.363, 0.366),
        10: (0.250, 0.239, 0.241),
        30: (0.140, 0.132, 0.133),
    }
    for n, expected in table.items():
        sample = generator(6, f"scatter/{n}").normal(size=(100_000, n))
        for name, cv in zip(("grey, largest gap", "Bessel", "grey, sum of gaps"), expected, strict=True):
            u = ESTIMATORS[name](sample)
            assert u.std() / u.mean() == pytest.approx(cv, abs=0.0005 + 0.012 * cv)


def test_what_is_called_unbiased_is_so_for_the_normal_law_and_what_is_not_is_not():
    for n in (2, 3, 5, 10):
        sample = generator(7, f"unbiased/{n}").normal(size=(100_000, n))
        for name in ("grey, largest gap, unbiased", "grey, sum of gaps", "Bessel, unbiased"):
            u = ESTIMATORS[name](sample)
            assert abs(u.mean() - 1) < 4.5 * u.std() / np.sqrt(len(u))
        for name in ("grey, largest gap", "Bessel"):
            u = ESTIMATORS[name](sample)
            assert u.mean() < 1 - 10 * u.std() / np.sqrt(len(u))
    assert [bessel_bias(n) for n in (3, 5, 10, 30)] == pytest.approx([0.887, 0.939, 0.972, 0.991], abs=1e-3)


def test_efficiencies_against_bessel_depend_on_the_law():
    n = 200

    def efficiency(law: str, name: str) -> float:
        sample = LAWS[law](generator(8, law), (20_000, n))
        cv = [float(u.std() / u.mean()) for u in (ESTIMATORS["Bessel"](sample), ESTIMATORS[name](sample))]
        return (cv[0] / cv[1]) ** 2

    assert efficiency("normal", "grey, largest gap") == pytest.approx(0.876, abs=0.02)
    assert efficiency("normal", "grey, sum of gaps") == pytest.approx(0.98, abs=0.02)
    assert efficiency("Laplace", "grey, largest gap") > 1.05
    assert efficiency("uniform", "grey, largest gap") < 0.9
    assert efficiency("arcsine", "grey, largest gap") < 0.9


# ---------------------------------------------------------------------------------------------- relational degrees

LIU = np.array([[10, 9, 15, 14, 14, 15, 16], [46, 58, 70, 77, 84, 91, 98]], float)
DENG = np.array(
    [
        [1, 1.1, 2, 2.25, 3, 4],
        [1, 1.166, 1.834, 2, 2.314, 3],
        [1, 1.125, 1.075, 1.375, 1.625, 1.75],
        [1, 1, 0.7, 0.8, 0.9, 1.2],
    ]
)


def test_dengs_example_gives_his_coefficients_and_degrees():
    xi = relations.deng_coefficients(DENG[0], DENG[1:])
    assert np.allclose(xi[0], [1, 0.9550, 0.8940, 0.8485, 0.6711, 0.5833], atol=5e-5)
    assert np.allclose(xi[1], [1, 0.9825, 0.6022, 0.6154, 0.5045, 0.3836], atol=5e-5)
    assert np.allclose(xi[2], [1, 0.9333, 0.5185, 0.4912, 0.4000, 0.3333], atol=5e-5)
    assert np.allclose(relations.deng(DENG[0], DENG[1:]), [0.825323, 0.681343, 0.612736], atol=5e-7)
    first = np.eye(6)[0]
    assert np.allclose(relations.deng(DENG[0], DENG[1:], weights=7 * first), 1)


def test_dengs_least_difference_counts_where_no_sequence_touches_the_reference():
    assert np.allclose(relations.deng(np.array([1.0, 2.0]), np.array([[2.0, 4.0], [3.0, 6.0]])), [0.875, 0.625])


def test_dengs_degrees_change_when_another_factor_is_left_out():
    assert np.allclose(relations.deng(DENG[0], DENG[1:3]), [0.7975, 0.6455], atol=5e-5)


def test_dengs_degree_of_nothing_at_all_is_never_below_a_third():
    rng = generator(9, "floor")
    degrees = relations.deng(rng.normal(size=(500, 12)), rng.normal(size=(500, 4, 12)))
    assert degrees.min() > 1 / 3
    xi = relations.deng_coefficients(np.array([0.0, 0.0, 0.0]), np.array([[0.0, 1.0, 1.0], [0.0, 0.0, 1.0]]))
    assert xi.min() == pytest.approx(1 / 3, abs=1e-15)


def test_lius_example_gives_his_three_degrees():
    assert relations.absolute(LIU[0], LIU[1:])[0] == pytest.approx(197 / 353, abs=1e-15)
    assert relations.relative(LIU[0], LIU[1:])[0] == pytest.approx(0.788945, abs=5e-7)
    assert relations.synthetic(LIU[0], LIU[1:])[0] == pytest.approx(0.673509, abs=5e-7)


def test_a_sequence_is_wholly_related_to_itself_and_the_t_type_knows_the_sign():
    x = generator(10, "self").uniform(1, 2, 9)
    for name, degree in relations.DEGREES.items():
        assert degree(x, x[None])[0] == pytest.approx(1, abs=1e-15), name
    assert relations.t_type(x, (5 - 2 * x)[None])[0] == pytest.approx(-1, abs=1e-12)
    assert relations.t_type(x, (7 + 3 * x)[None])[0] == pytest.approx(1, abs=1e-12)
    for name in ("Deng", "absolute", "relative", "synthetic", "slope", "B-type"):
        assert relations.DEGREES[name](x, (3 - x)[None])[0] > 0, name  # a perfect opposite is "related" all the same


def test_slope_and_b_type_by_hand():
    x0, x = np.array([1.0, 2.0, 3.0]), np.array([[2.0, 2.0, 5.0]])
    # Increments over means: 1/2, 1/2 against 0, 1.
    assert relations.slope(x0, x)[0] == pytest.approx(1.5 / 2, abs=1e-15)
    # Differences 1, 0, 2; -1, 2; 3.
    assert relations.b_type(x0, x)[0] == pytest.approx(1 / (1 + 3 / 3 + 3 / 2 + 3 / 1), abs=1e-15)
    # Increments in units of their mean: 1, 1 against 0, 2.
    assert relations.t_type(x0, x)[0] == pytest.approx(0.25, abs=1e-15)


def test_only_deng_with_mean_or_range_scaling_does_not_ask_for_the_order_of_the_runs():
    rng = generator(11, "order")
    x0, x = rng.uniform(1, 2, 15), rng.uniform(1, 2, (4, 15))
    turn = rng.permutation(15)
    for image in (relations.mean_image, relations.range_image):
        same = relations.deng(image(x0), image(x)) - relations.deng(image(x0[turn]), image(x[:, turn]))
        assert np.allclose(same, 0, atol=1e-14)
    for name in ("absolute", "relative", "synthetic", "T-type", "slope", "B-type"):
        degree = relations.DEGREES[name]
        assert not np.allclose(degree(x0, x), degree(x0[turn], x[:, turn]), atol=1e-3), name
    by_first = [
        relations.deng(relations.initial_image(a), relations.initial_image(b))
        for a, b in ((x0, x), (x0[turn], x[:, turn]))
    ]
    assert not np.allclose(*by_first, atol=1e-3)


def test_many_problems_at_once_are_the_problems_one_by_one():
    rng = generator(12, "many")
    x0, x = rng.uniform(1, 2, (5, 2, 11)), rng.uniform(1, 2, (5, 2, 3, 11))
    for name, degree in relations.DEGREES.items():
        together = degree(x0, x)
        assert together.shape == (5, 2, 3)
        assert np.allclose(together[3, 1], degree(x0[3, 1], x[3, 1]), atol=1e-14), name


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: relations.deng(np.ones(4), np.ones((2, 5))), "do not belong together"),
        (lambda: relations.deng(np.ones(4), np.ones(4)), "do not belong together"),
        (lambda: relations.deng(np.ones(4), np.ones((2, 4)), rho=0), "rho is 0"),
        (lambda: relations.b_type(np.ones(2), np.ones((1, 2))), "too short"),
        (lambda: relations.relative(np.array([0.0, 1, 2]), np.ones((1, 3))), "first value, which is zero"),
        (lambda: relations.range_image(np.ones((2, 3))), "range, which is zero"),
        (lambda: relations.absolute(np.array([1, np.nan, 2]), np.ones((1, 3))), "not finite"),
        (lambda: relations.synthetic(np.arange(1, 4), np.ones((1, 3)), theta=2), "theta is 2"),
        (lambda: sup_norm_uncertainty(np.ones(1)), "less than two values"),
        (lambda: grey_coefficients(np.array([1.0, np.inf])), "not finite"),
    ],
)
def test_what_cannot_be_computed_is_said_in_words(call, words):
    with pytest.raises(TestfieldError, match=words):
        call()
