"""How estimators of a standard uncertainty do on small samples of a population whose standard deviation is known."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.stats import t

from testfield.chain.run import Run
from testfield.evaluate.case import Case
from testfield.seeds import generator
from testfield.uncertainty.grey_uncertainty import ESTIMATORS, unsorted_uncertainty

SIZES = (3, 4, 5, 6, 8, 10, 15, 20, 30)
ALL: dict[str, Callable[[np.ndarray], np.ndarray]] = ESTIMATORS | {"grey, not sorted": unsorted_uncertainty}
BATCHES, PIVOTS = 20, 100_000
Draw = Callable[[int, int, int, np.random.Generator], np.ndarray]
"""(batch, count, n, rng) to (count, n) values of a law of mean 0 and standard deviation 1."""

LAWS: dict[str, Callable[[np.random.Generator, tuple[int, int]], np.ndarray]] = {
    "normal": lambda rng, size: rng.normal(size=size),
    "uniform": lambda rng, size: rng.uniform(-np.sqrt(3), np.sqrt(3), size),
    "triangular": lambda rng, size: np.sqrt(6) * rng.triangular(-1, 0, 1, size),
    "Laplace": lambda rng, size: rng.laplace(size=size) / np.sqrt(2),
    "arcsine": lambda rng, size: np.sqrt(2) * np.sin(rng.uniform(-np.pi / 2, np.pi / 2, size)),
}
"""Laws of mean 0 and standard deviation 1."""


def sample_law(case: Case, run: Run | None) -> list[dict[str, Any]]:
    """The work of a case: the estimators on samples of a law by name, all sizes."""
    law, count = case.options["law"], case.options["count"]
    return [row for n in SIZES for row in judge(law, law_draw(law), n, count)]


def law_draw(law: str) -> Draw:
    """Draws of a law by name."""
    return lambda batch, count, n, rng: LAWS[law](rng, (count, n))


def population_draw(populations: list[np.ndarray]) -> Draw:
    """Draws with replacement from one of the populations, each brought to mean 0 and standard deviation 1.

    So a population's own values are its law, exactly. Every batch has populations of its own, as far as they reach:
    the batches' scatter then tells how much depends on which populations there were.
    """
    ready = [(p - p.mean()) / p.std() for p in populations if len(p) > 1 and p.std() > 0]

    def draw(batch: int, count: int, n: int, rng: np.random.Generator) -> np.ndarray:
        own = ready[batch % len(ready) :: BATCHES]
        parts = np.array_split(np.arange(count), len(own))
        drawn = [rng.choice(values, (len(part), n)) for values, part in zip(own, parts, strict=True)]
        return np.concatenate(drawn)

    return draw


def judge(name: str, draw: Draw, n: int, count: int) -> list[dict[str, Any]]:
    """One row for each estimator: what it gives of sigma on the mean, its relative scatter, and what is covered.

    `mean_ratio` and `scatter` with standard uncertainties from batches; `sigma_covered` by the 95 % interval that would
    be right for the normal law; `mean_covered_t` by the estimate over sqrt(n) with the factor right for the normal law,
    `mean_covered_2` with the factor 2.
    """
    found: dict[str, list[list[Any]]] = {estimator: [] for estimator in ALL}
    for batch in range(BATCHES):
        rng = generator(0, f"grey samples/{name}/{n}/{batch}")
        sample = draw(batch, count // BATCHES, n, rng)
        off = np.abs(sample.mean(axis=1)) * np.sqrt(n)
        for estimator, estimate in ALL.items():
            u = estimate(sample)
            low, high, k = pivots(estimator, n)
            shares = [np.mean((u >= low) & (u <= high)), np.mean(off <= k * u), np.mean(off <= 2 * u)]
            found[estimator].append([u.mean(), u.std() / u.mean(), *shares])
    rows = []
    for estimator, batches in found.items():
        row: dict[str, Any] = {"law": name, "n": n, "estimator": estimator, "samples": count}
        means, u_means = np.mean(batches, axis=0), np.std(batches, axis=0, ddof=1) / np.sqrt(BATCHES)
        for k, key in enumerate(("mean_ratio", "scatter", "sigma_covered", "mean_covered_t", "mean_covered_2")):
            row[key], row[f"u_{key}"] = float(means[k]), float(u_means[k])
        rows.append(row)
    return rows


@lru_cache
def pivots(estimator: str, n: int) -> tuple[float, float, float]:
    """Of n normal values: the 2.5 % and 97.5 % quantiles of estimate / sigma, and the factor k of a 95 % interval.

    From PIVOTS samples; Bessel's factor is Student's t.
    """
    sample = generator(0, f"grey pivots/{n}").normal(size=(PIVOTS, n))
    u = ALL[estimator](sample)
    k = float(np.quantile(np.abs(sample.mean(axis=1)) * np.sqrt(n) / u, 0.95))
    if estimator == "Bessel":
        k = float(t.ppf(0.975, n - 1))
    low, high = np.quantile(u, [0.025, 0.975])
    return float(low), float(high), k
