"""Another world and other noise have folders of their own; beginning again touches nobody else's frames."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import TINY

from testfield.camera.images import Frame
from testfield.chain.run import Run, begin, clear, share_radiance
from testfield.cli.main import main
from testfield.scene.load import load_scene
from testfield.store.text import write_text

SEED = load_scene(TINY).seed


def laid_out(monkeypatch: pytest.MonkeyPatch, place: Path, seed: int | None, noise_seed: int | None) -> Run:
    """A run that is laid out in `place`, nothing rendered."""
    monkeypatch.chdir(place)
    return begin(TINY, None, seed, 1, noise_seed)[0]


def test_each_world_and_each_noise_has_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = {
        (seed, noise): laid_out(monkeypatch, tmp_path, seed, noise).folder.name
        for seed, noise in ((None, None), (SEED, None), (3, None), (None, 5), (3, 5))
    }
    assert found == {
        (None, None): "tiny",
        (SEED, None): "tiny",
        (3, None): "tiny-seed3",
        (None, 5): "tiny-noise5",
        (3, 5): "tiny-seed3-noise5",
    }


def test_other_noise_is_in_the_same_world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, other = (laid_out(monkeypatch, tmp_path, None, noise) for noise in (None, 5))
    assert np.array_equal(first.world.mark_world_mm, other.world.mark_world_mm)
    assert (first.folder / "field.json").read_bytes() == (other.folder / "field.json").read_bytes()
    assert other.scene.noise_seed == 5 and other.scene.seed == first.scene.seed


def test_radiance_is_shared_and_not_made_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    base, run = (laid_out(monkeypatch, tmp_path, None, noise) for noise in (None, 5))
    base.ledger.make("radiance/station01.exr", "key", lambda path: write_text(path, "light"), world="w")
    share_radiance(base, run)
    shared = run.folder / "radiance/station01.exr"
    assert shared.samefile(base.folder / "radiance/station01.exr")
    assert (
        run.ledger.fresh("radiance/station01.exr", "key") and run.ledger.files[f"radiance/{shared.name}"].world == "w"
    )


def test_beginning_again_leaves_frames_of_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = laid_out(monkeypatch, tmp_path, None, None)
    run.ledger.make("frames/a.json", "key", lambda path: write_text(path, "[1]"))
    run.ledger.make("frames/b.json", "key", lambda path: write_text(path, "[2]"))
    write_text(run.folder / "frames/b.json", "[3]")
    write_text(run.folder / "frames/c.json", "[4]")
    clear(run)
    left = {path.name for path in run.folder.rglob("*") if path.is_file()}
    assert left == {"b.json", "c.json"}


@pytest.mark.slow
def test_other_noise_gives_other_frames_of_the_same_radiance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    for words in ([], ["--noise-seed", "5"]):
        assert main(["run", str(TINY), "--jobs", "1", "--json", *words]) == 0
        json.loads(capsys.readouterr().out)
    first, other = (
        {path.name: path for path in Path(f"renders/{name}/radiance").iterdir()} for name in ("tiny", "tiny-noise5")
    )
    assert first.keys() == other.keys() and all(path.samefile(other[name]) for name, path in first.items())
    one, two = (Frame.load(Path(f"renders/{name}/frames/station01.png")) for name in ("tiny", "tiny-noise5"))
    differ = one.pixels_dn != two.pixels_dn
    assert differ.mean() > 0.5
    assert np.abs(one.pixels_dn.astype(float) - two.pixels_dn).mean() < 0.05 * one.pixels_dn.mean()
    assert main(["run", str(TINY), "--jobs", "1", "--noise-seed", "5"]) == 0
    assert "nothing to do" in capsys.readouterr().err
