"""What common noise is worth: drawn errors whose correlation is known, and the same noise for one recipe twice."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

from testfield.bench.rendered_noise import AGAIN, FIRST, SAME, SEVERAL, noise_checks
from testfield.evaluate.common_noise import noise_of, noise_table
from testfield.evaluate.metrics import CENTRE


def drawn(correlation: float, draws: int = 40, marks: int = 400, same: bool = True) -> pd.DataFrame:
    """Rows of two scenes in which errors of `b` have that correlation with those of `a`, which scatter half as much,
    and a bias of their own; and of the first one again."""
    rng, rows = np.random.default_rng(7), list[dict[str, Any]]()
    for scene in ("one", "two"):
        bias = rng.normal(size=(marks, 2))
        for draw in range(1, draws + 1):
            first, own = 0.01 * rng.normal(size=(2, marks, 2))
            other = 2 * (correlation * first + np.sqrt(1 - correlation**2) * own) + bias
            again = first if same else 0.01 * rng.normal(size=(marks, 2))
            for name, error in ((FIRST, first), (AGAIN, again), ("b", other)):
                labels = {"scene": scene, "factor": "", "level": -1, "draw": draw, "recipe": name}
                columns = {"station": [0] * marks, "mark": list(range(marks))}
                columns |= {"dx_px": error[:, 0].tolist(), "dy_px": error[:, 1].tolist()}
                rows.append(labels | columns | {CENTRE.key: float(np.sqrt((error**2).mean()))})
    return pd.DataFrame(rows)


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_correlation_and_what_it_is_worth_are_found(correlation: float) -> None:
    again, other = noise_table(drawn(correlation), [FIRST, AGAIN, "b"]).itertuples()
    assert other.correlation == pytest.approx(correlation, abs=0.02) and other.items == 800
    assert other.spread == pytest.approx(0.02, rel=0.02) and other.spread_first == pytest.approx(0.01, rel=0.02)
    assert other.narrower == pytest.approx(np.sqrt(5 / (5 - 4 * correlation)), rel=0.02)
    assert again.correlation == pytest.approx(1) and again.narrower > 1e6


def test_noise_that_is_not_the_same_for_both_is_seen_and_the_unpaired_interval_is_as_computed() -> None:
    for same in (True, False):
        checks = noise_checks(drawn(0.8, same=same), [FIRST, AGAIN, "b"], lambda said: None)
        (twice,) = [check for check in checks if check.limit is SAME]
        assert (twice.value == 0) == same
        (computed,) = [check for check in checks if "measured over computed" in check.name]
        assert computed.value == pytest.approx(1, abs=0.05)
        assert sum(check.limit is SEVERAL for check in checks) == 3


def test_one_draw_or_no_common_centre_says_nothing() -> None:
    one = drawn(0.5, draws=1)
    assert noise_of(one, FIRST, "b") is None and noise_table(one, [FIRST, "b"]).correlation.isna().all()
    rows = drawn(0.5, draws=3)
    rows["mark"] = [[v + 1000 * (name == "b") for v in own] for own, name in zip(rows.mark, rows.recipe, strict=True)]
    assert noise_table(rows, [FIRST, "b"])["items"].tolist() == [0]
