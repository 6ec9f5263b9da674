"""`testfield bench chain`: every stage is timed, another checkout is run beside, and what is none is refused."""

import os
from pathlib import Path

import pytest

from testfield.bench.chain import OURS, THEIRS, bench_chain
from testfield.chain.stages import STAGES
from testfield.errors import TestfieldError

ROOT = Path(__file__).parents[1]
TINY = ROOT / "tests" / "torture" / "tiny.toml"


@pytest.mark.slow
def test_a_checkout_run_beside_itself_takes_the_time_that_its_stages_take() -> None:
    found = bench_chain(TINY, ROOT, 1, lambda _: None)
    for side in (found[OURS], found[THEIRS]):
        timed = [name for name in STAGES if name not in ("score", "report")]
        assert list(side["stages_s"]) == timed
        assert 0 < sum(side["stages_s"].values()) < side["wall_s"]
        # What else the machine does takes from the wall clock alone, so the two cannot be held against each other.
        assert 2 < side["processor_s"] < side["wall_s"] * (os.cpu_count() or 1)
        assert 0.1 < side["peak_memory_gb"] < 4
        assert side["radiance_gb"] > 0
    assert found["ratio"] == found[OURS]["wall_s"] / found[THEIRS]["wall_s"]
    assert set(found["stage_ratios"]) <= set(found[OURS]["stages_s"])


def test_what_is_no_checkout_is_refused_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(TestfieldError, match="no checkout"):
        bench_chain(TINY, tmp_path, 1, lambda _: None)


def test_a_run_that_fails_says_so_in_its_own_words(tmp_path: Path) -> None:
    scene = tmp_path / "broken.toml"
    scene.write_text('name = "x"\n')
    with pytest.raises(TestfieldError, match=r"the run failed: .*stations"):
        bench_chain(scene, None, 1, lambda _: None)
