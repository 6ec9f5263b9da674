"""Whether a comparison's words and intervals are as often right as they say: drawn comparisons whose truth is known."""

from collections.abc import Callable

import numpy as np
from scipy.stats import nct, t

from testfield.evaluate.check import Check, Limit
from testfield.evaluate.paired import LEVEL, Difference, Word, difference, together
from testfield.evaluate.ranks import rank_intervals
from testfield.seeds import generator

LEAST_TRIALS = 200
LEVEL_OF_FIGURES, OF_SCENES, OF_DRAWS = 10.0, 3.0, 1.0
"""What a figure is about, and by how much scenes, and draws of noise in them, change it for all recipes alike."""
OWN = 0.3
"""By how much a draw of noise changes one recipe's figure alone."""
SHIFT = 0.5
"""A difference of 5 %."""
EQUAL = Limit(0.035, 0.065)
COVERS = Limit(0.93, 0.97)
NEXT_TO_NOTHING = 1e-9
DIFFERENT = (Word.BETTER, Word.WORSE)


def drawn(
    rng: np.random.Generator, scenes: int, draws: int, shift: float = 0.0, scene_shift: float = 0.0
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Two recipes' figures, scene by scene: the second is `shift` worse, in a scene by `scene_shift` more or less."""
    first, other = [], []
    for _ in range(scenes):
        common = LEVEL_OF_FIGURES + OF_SCENES * rng.normal() + OF_DRAWS * rng.normal(size=draws)
        first.append(common + OWN * rng.normal(size=draws))
        other.append(common + OWN * rng.normal(size=draws) + shift + scene_shift * rng.normal())
    return first, other


def bench_comparisons(trials: int, tell: Callable[[str], None]) -> list[Check]:
    """Every claim of a comparison as a check, from so many drawn ones."""
    found = []
    for check in (_equal_in_a_scene, _equal_over_scenes, _many_equal, _covers, _power, _equivalent, _ranks, _paired):
        found.append(check(trials))
        tell(f"{found[-1].name}: {found[-1].value:.4g}")
    return found


def _of(name: str, trials: int, scenes: int, draws: int, *shifts: float, matters: float = 1e-9) -> list[Difference]:
    rng = generator(1, f"comparisons/{name}")
    return [difference(*drawn(rng, scenes, draws, *shifts), matters) for _ in range(trials)]


def _share(differences: list[Difference], *words: Word) -> float:
    return float(np.mean([one.word in words for one in differences]))


def _equal_in_a_scene(trials: int) -> Check:
    share = _share(_of("one scene", trials, 1, 8), *DIFFERENT)
    return Check("equal recipes called better or worse, one scene", share, None, EQUAL, "", f"{trials} of 8 draws")


def _equal_over_scenes(trials: int) -> Check:
    share = _share(_of("scenes", trials, 6, 8, 0.0, 0.4), *DIFFERENT)
    how = f"{trials} of 6 scenes of 8 draws, equal on the whole but not in a scene"
    return Check("equal recipes called better or worse, six scenes", share, None, EQUAL, "", how)


def _many_equal(trials: int) -> Check:
    pairs = _of("many", 12 * (trials // 2), 1, 6)
    groups = [together(pairs[k : k + 12]) for k in range(0, len(pairs), 12)]
    share = float(np.mean([any(one.word in DIFFERENT for one in group) for group in groups]))
    return Check(
        "any of 12 equal recipes called so (Holm)", share, None, Limit(0, 0.065), "", f"{trials // 2} of 6 draws"
    )


def _covers(trials: int) -> Check:
    ends = [one.estimate.interval() for one in _of("covers", trials, 8, 12, SHIFT, 0.4)]
    share = float(np.mean([low <= SHIFT <= high for low, high in ends]))
    return Check(
        "intervals that hold the difference, clustered draws", share, None, COVERS, "", f"{trials} of 8 scenes"
    )


def _power(trials: int) -> Check:
    draws = 6
    share = _share(_of("power", trials, 1, draws, SHIFT), Word.WORSE)
    theory = float(nct.sf(t.ppf(1 - LEVEL / 2, draws - 1), draws - 1, SHIFT / (OWN * np.sqrt(2 / draws))))
    off = 3 * float(np.sqrt(theory * (1 - theory) / trials))
    how = f"{trials} of {draws} draws; theory says {theory:.3f}"
    return Check("a difference of 5 % called worse", share, None, Limit(theory - off, theory + off), "", how)


def _equivalent(trials: int) -> Check:
    share = _share(_of("equivalent", trials, 1, 12, 1.0, matters=1.0), Word.EQUIVALENT)
    how = f"{trials} of 12 draws"
    return Check("a difference that just matters called equivalent", share, None, Limit(0, 0.065), "", how)


def _ranks(trials: int) -> Check:
    rng, held = generator(1, "comparisons/ranks"), []
    true, places = (1.0, 1.0, 1.3, 5.0), ((1, 2), (1, 2), (3, 3), (4, 4))
    for _ in range(trials // 2):
        common = rng.normal(size=8)
        figures = {str(k): [mean + common + OWN * rng.normal(size=8)] for k, mean in enumerate(true)}
        rows = rank_intervals(figures, NEXT_TO_NOTHING).itertuples()
        held.append(all(row.best <= low and high <= row.worst for row, (low, high) in zip(rows, places, strict=True)))
    how = f"{trials // 2} of four recipes, two of them equal"
    return Check("rank intervals that hold all places at once", float(np.mean(held)), None, Limit(0.93, 1), "", how)


def _paired(trials: int) -> Check:
    one = _of("paired", 1, 1, 100 * 4)[0]
    ratio = one.unpaired_u / one.estimate.u
    expected = float(np.hypot(OF_DRAWS, OWN) / OWN)
    how = f"400 draws; {expected:.2f} by the drawn scatters"
    return Check(
        "interval without common noise over that with it", ratio, None, Limit(0.9 * expected, 1.1 * expected), "", how
    )
