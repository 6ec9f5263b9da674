"""Everything that is drawn more than once is drawn anew each time, and is the same again for the same seed.

Trials that repeat one draw have no scatter, and whatever stops when figures settle would stop at once. Nothing here
looks at how seeds are made: only at what is drawn.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from tempfile import mkdtemp
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hand_made import HandMade

from testfield.camera.images import Radiance
from testfield.chain import trials as trials_module
from testfield.chain.trials import Trials
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.truth import see
from testfield.scene.world import BAR
from testfield.seeds import generator, seed_of
from testfield.sensor.expose import Sensor, expose
from testfield.simulate.observations import draw_observations
from testfield.store.ledger import Ledger
from testfield.targets.field import Field
from testfield.uncertainty.certificates import draw_certificates, draw_pixels
from testfield.uncertainty.monte_carlo import adaptive
from testfield.uncertainty.supplement2 import adaptive_regions

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
SENSOR = Sensor(3.45, 8.0, 24.0, 550.0, 0.63, 10400, 2.3, 2.6, 64, 12)


def unlike(draws: list[np.ndarray]) -> None:
    """No two of the draws may be the same, nor one a shift of the other: their noise is uncorrelated."""
    assert len(draws) > 2
    for a, b in combinations(draws, 2):
        assert a.shape == b.shape
        r = np.corrcoef((a - a.mean()).ravel(), (b - b.mean()).ravel())[0, 1]
        assert abs(r) < 6 / np.sqrt(a.size)


def grey(station: str = "one") -> Radiance:
    return Radiance(station, np.full((64, 64), 0.5, np.float32))


def test_frames_of_stations_and_of_exposures_are_different_draws_and_the_same_again() -> None:
    stations = [expose(grey(f"station{k}"), SENSOR, 5).pixels_dn.astype(float) for k in range(4)]
    again = [expose(grey(), SENSOR, 5, noise_seed=seed).pixels_dn.astype(float) for seed in (5, 6, 7)]
    unlike([*stations, *again])
    assert np.array_equal(again[0], expose(grey(), SENSOR, 5).pixels_dn)
    assert np.array_equal(again[1], expose(grey(), SENSOR, 9, noise_seed=6).pixels_dn)


def test_the_sensors_pattern_is_one_and_the_same_however_often_it_is_exposed() -> None:
    fixed = replace(SENSOR, prnu=0.2, read_noise_e=0.0)
    frames = [expose(grey(name), fixed, 5, seed).pixels_dn.ravel() for name, seed in (("a", 1), ("b", 2), ("a", 3))]
    assert min(np.corrcoef(a, b)[0, 1] for a, b in combinations(frames, 2)) > 0.9
    other = expose(grey("a"), fixed, 6, 1).pixels_dn.ravel()
    assert abs(np.corrcoef(frames[0], other)[0, 1]) < 0.1


def test_generators_differ_by_seed_and_by_name() -> None:
    unlike([generator(seed, name).standard_normal(400) for seed, name in ((1, "a"), (1, "b"), (2, "a"), (2, "b"))])
    assert len({seed_of(seed, name) for seed in (1, 11) for name in ("a", "1/a", "b")}) == 6


@pytest.fixture
def drawn(by_hand: HandMade, tmp_path: Path) -> Callable[[str], Trials]:
    """Trials of the hand-made field in one depth, each time in a folder of their own."""

    def of(depth: str) -> Trials:
        folder = Path(mkdtemp(dir=tmp_path))
        run = SimpleNamespace(
            scene=load_scene(QUICK), field=by_hand.world.field, stations=("one",), folder=folder, ledger=Ledger(folder)
        )
        trials = Trials(run, depth)  # type: ignore[arg-type]
        made = {"observations": by_hand.observations, "calibration": by_hand.calibration, "points": by_hand.points}
        vars(trials).update(made, key="the same")
        return trials

    return of


def test_blocks_of_rays_are_different_draws(
    drawn: Callable[[str], Trials], by_hand: HandMade, monkeypatch: pytest.MonkeyPatch
) -> None:
    import testfield.uncertainty.rays as rays

    class Ready:
        code = by_hand.points.code

        def draw(self, trials: range, seed: int) -> np.ndarray:
            rng = np.random.default_rng([seed, trials.start])
            return by_hand.points.xyz_mm + rng.standard_normal((200, len(self.code), 3))

    monkeypatch.setattr(rays.RayTrials, "of", staticmethod(lambda *_: Ready()))
    trials = drawn("rays")
    blocks = [trials.block(k) - by_hand.points.xyz_mm for k in range(4)]
    unlike(blocks)
    assert np.array_equal(blocks[2], drawn("rays").block(2) - by_hand.points.xyz_mm)


@pytest.mark.parametrize("depth", ["calibration", "exposure"])
def test_trials_are_different_draws_of_pixels_and_of_certificates(
    depth: str, drawn: Callable[[str], Trials], by_hand: HandMade, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pixels and sheets that reach the calibrator, trial by trial. Of exposures the new frames' noise is asked for."""
    seen: list[tuple[np.ndarray, Field, list[int]]] = []
    noise: list[int] = []

    def reexposed(run: Any, seed: int) -> Any:
        noise.append(seed)
        return by_hand.observations

    class Enough(Exception):
        """Nothing after the calibrator is looked at."""

    def measure(observations: Any, field: Field, *_: Any) -> None:
        seen.append((observations.xy_px, field, list(noise)))
        raise Enough

    monkeypatch.setattr(trials_module, "reexposed", reexposed)
    monkeypatch.setattr(trials_module, "measure", measure)
    for k in (0, 1, 2, 1):
        with pytest.raises(Enough):
            drawn(depth).trial(k)
    if depth == "calibration":
        unlike([xy - by_hand.observations.xy_px for xy, *_ in seen[:3]])
    else:
        assert len({seeds[-1] for *_, seeds in seen}) == 3 and seen[1][2][-1] == seen[3][2][-1]
    bars = [[bar.length_mm for bar in field.scale_bars] for _, field, _ in seen]
    assert len({tuple(row) for row in bars[:3]}) == 3
    assert bars[1] == bars[3] and np.array_equal(seen[1][0], seen[3][0])


def test_pixels_and_certificates_are_drawn_from_the_generator_that_is_given(by_hand: HandMade) -> None:
    o, field = by_hand.observations, by_hand.world.field
    pixels = [draw_pixels(o, field, seed_of(1, f"{k}")).xy_px - o.xy_px for k in range(4)]
    unlike(pixels)
    sheets = [
        draw_certificates(by_hand.observations, by_hand.calibration, by_hand.world.field, seed_of(1, f"{k}"))[1]
        for k in range(3)
    ]
    assert len({bar.length_mm for sheet in sheets for bar in sheet.scale_bars[1:2]}) == 3


def test_worlds_of_other_seeds_are_other_draws_of_print_bars_and_pixels() -> None:
    scene = load_scene(QUICK)
    scenes = [scene.model_copy(update={"seed": seed}) for seed in (1, 2, 3)]
    worlds = [build_world(one) for one in scenes]
    nominal = np.concatenate([sheet.marks.xy_mm for sheet in worlds[0].field.boards])
    off = [world.marks.xy_mm[world.marks.board >= 0] - nominal for world in worlds]
    # The scale that all boards share is a draw of its own; what is left are the errors of the print.
    unlike([one - nominal * (one * nominal).sum() / (nominal**2).sum() for one in off])
    lengths = {np.linalg.norm(np.diff(world.mark_world_mm[world.marks.role == BAR][:2], axis=0)) for world in worlds}
    assert len(lengths) == 3
    views = see(worlds[0])
    pixels = [draw_observations(scene, worlds[0], views, seed_of(seed, "pixels")).xy_px for seed in range(6)]
    unlike([pixels[k] - pixels[k + 1] for k in (0, 2, 4)])


def test_the_adaptive_stops_ask_for_one_block_after_the_other() -> None:
    asked: list[int] = []

    def block(number: int) -> np.ndarray:
        asked.append(number)
        return np.random.default_rng(number).standard_normal((1000, 3))

    adaptive(block, np.full(3, 1e-9), 5000)
    assert asked == [0, 1, 2, 3, 4]
    asked.clear()
    adaptive_regions(lambda k: block(k).reshape(1000, 1, 3), 5000, digits=4)
    assert asked == [0, 1, 2, 3, 4]


def test_a_monte_carlo_of_one_draw_repeated_would_settle_at_once() -> None:
    """What the tests above keep from happening: without scatter between blocks any tolerance is met."""
    same = adaptive(lambda _: np.random.default_rng(1).standard_normal((1000, 2)), np.full(2, 1e-12), 50_000)
    anew = adaptive(lambda k: np.random.default_rng(k).standard_normal((1000, 2)), np.full(2, 1e-12), 50_000)
    assert same.blocks == 2 and anew.blocks == 50
