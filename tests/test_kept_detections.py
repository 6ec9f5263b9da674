"""Finished detections are kept: a kill costs the image at hand, a second run detects nothing, none is changed."""

from dataclasses import fields
from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.bench.hard_dots import draw, small
from testfield.camera.photograph import Photograph, read_photograph
from testfield.cli.main import main
from testfield.detect.photograph import AUTO, Found, detect_in_photograph
from testfield.detect.target_spec import TargetSpec
from testfield.measure.kept_detections import Kept, Look, detect_each, put_picture
from testfield.report.photograph import draw_found
from testfield.targets.marks import USUAL

LOOK = Look(detect_in_photograph, (TargetSpec("circles"), USUAL, AUTO, 5.0, None))


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Four photographs of dots, and a file that is none."""
    folder = tmp_path_factory.mktemp("photographs")
    for k in range(4):
        pixels = draw(small(10, 40, seed=k)).pixels[:120, :120]
        cv2.imwrite(str(folder / f"{k}.png"), (pixels * 16).astype(np.uint16))
    (folder / "none.png").write_bytes(b"no image")
    return sorted(folder.iterdir())


class Drawn:
    """Draws, and counts what it draws: one picture each detection. It stops at one as an interrupt would."""

    def __init__(self, stop_at: int = 99) -> None:
        self.names: list[str] = []
        self.stop_at = stop_at

    def __call__(self, photograph: Photograph, found: Found, path: Path) -> None:
        if len(self.names) == self.stop_at:
            raise KeyboardInterrupt
        self.names.append(photograph.name)
        draw_found(photograph, found, path)


def same(a: Found | None, b: Found | None) -> bool:
    """Whether two detections are alike to the bit."""
    if a is None or b is None:
        return a is b
    pairs = [(getattr(a.observations, f.name), getattr(b.observations, f.name)) for f in fields(a.observations)]
    for x, y in [*pairs, (a.place, b.place)]:
        equal = np.array_equal(x, y, equal_nan=x.dtype.kind == "f") if isinstance(x, np.ndarray) else x == y
        if not equal or (isinstance(x, np.ndarray) and x.dtype != y.dtype):
            return False
    return a.notes == b.notes and a.passed_over == b.passed_over


def test_a_kept_detection_is_the_detection(paths: list[Path], tmp_path: Path) -> None:
    detect_each(paths, LOOK, tmp_path, draw_found)
    kept = detect_each(paths, LOOK, tmp_path, draw_found)
    for path, one in zip(paths[:4], kept, strict=False):
        assert one.found is not None
        assert len(one.found.observations) > 3
        photograph = read_photograph(path)
        assert same(one.found, detect_in_photograph(photograph, TargetSpec("circles"), USUAL, AUTO, 5.0, None))
        assert one.size_px == (120, 120)
        assert one.notes == photograph.notes
    assert kept[4].found is None
    assert str(paths[4]) in str(kept[4].trouble)


def test_a_second_run_detects_nothing_and_several_processes_find_the_same(paths: list[Path], tmp_path: Path) -> None:
    first, second = Drawn(), Drawn()
    told: list[tuple[int, bool]] = []
    one = detect_each(paths, LOOK, tmp_path / "a", first)
    again = detect_each(paths, LOOK, tmp_path / "a", second, tell=lambda k, _, before: told.append((k, before)))
    assert first.names == ["0", "1", "2", "3"]
    assert second.names == []
    assert sorted(told) == [(k, True) for k in range(5)]
    other = detect_each(paths, LOOK, tmp_path / "b", draw_found, jobs=2)
    for a, b, c in zip(one, again, other, strict=True):
        assert same(a.found, b.found)
        assert same(a.found, c.found)


def test_an_interrupt_loses_the_image_at_hand_alone(paths: list[Path], tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        detect_each(paths, LOOK, tmp_path, Drawn(stop_at=2))
    rest = Drawn()
    detect_each(paths, LOOK, tmp_path, rest)
    assert rest.names == ["2", "3"]


def test_what_is_damaged_or_was_asked_otherwise_is_looked_at_again(paths: list[Path], tmp_path: Path) -> None:
    detect_each(paths[:2], LOOK, tmp_path, draw_found)
    file = sorted(tmp_path.glob("*.npz"))[0]
    file.write_bytes(file.read_bytes()[:-40])
    sorted(tmp_path.glob("*.png"))[1].unlink()
    again = Drawn()
    detect_each(paths[:2], LOOK, tmp_path, again)
    assert sorted(again.names) == ["0", "1"]
    other = Drawn()
    detect_each(paths[:2], Look(detect_in_photograph, (TargetSpec("circles"), USUAL, AUTO, 7.0, None)), tmp_path, other)
    assert sorted(other.names) == ["0", "1"]


def test_the_same_bytes_under_another_name_are_not_looked_at_again(paths: list[Path], tmp_path: Path) -> None:
    copy = tmp_path / "copy.png"
    copy.write_bytes(paths[0].read_bytes())
    drawn = Drawn()
    kept: list[Kept] = detect_each([paths[0], copy], LOOK, tmp_path / "kept", drawn)
    assert drawn.names == ["0"]
    assert [one.found.observations.stations for one in kept if one.found] == [("0",), ("copy",)]
    put_picture(kept[1], tmp_path / "seen.png")
    put_picture(kept[1], tmp_path / "seen.png")
    assert (tmp_path / "seen.png").read_bytes() == kept[1].picture.read_bytes()


def test_measure_names_each_photograph_and_a_second_run_keeps_them(
    paths: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    field = tmp_path / "field.toml"
    field.write_text('[target]\nkind = "ring14"\n')
    command = ["measure", str(paths[0].parent), "--field", str(field), "--out", str(tmp_path / "out"), "--jobs", "1"]
    for kept in (0, 4):
        assert main(command) == 2  # dots without codes measure nothing
        said = capsys.readouterr().out
        assert all(f"{k}.png: " in said for k in range(4))
        assert said.count("kept from before") == kept
