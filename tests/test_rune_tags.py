"""RUNE-Tags: words and numbers by the reference's rules, dots named with a third hidden and none wrong."""

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from testfield.camera.photograph import Photograph
from testfield.detect.photograph import ON_WHITE, detect_in_photograph
from testfield.detect.rune_dots import _any, name_rune, read_runes
from testfield.detect.target_spec import parse_target
from testfield.scene.pattern_parts import RuneTagPart
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.rune_code import (
    _GENERATOR,
    APART,
    DOT,
    SECTORS,
    TAGS,
    _as_bits,
    chance_of_rune,
    nearest_rune,
    places_of_rune,
    rune_code,
    symbols_of,
    word_of_rune,
)

MM = 200.0


def tag(number: int) -> BoardPattern:
    return BoardPattern("runetag", 1, 1, MM, DOT * MM, first_tag=number)


def homography(tilt_deg: float, turn_deg: float, px: float = 400.0) -> np.ndarray:
    """(3, 3) from mm to px of a tag so wide, by a camera 2.5 widths away."""
    a, b = np.radians([turn_deg, tilt_deg])
    turned = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    leant = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    R = turned @ leant @ np.diag([1, -1, -1])
    K = np.array([[2.5 * px, 0, 500], [0, 2.5 * px, 500], [0, 0, 1]])
    return np.asarray(K @ np.column_stack([R[:, 0], R[:, 1], [0, 0, 2.5 * MM]]))


def seen(pattern: BoardPattern, H: np.ndarray, noise_px: float = 0.05, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 2) and diameters (n,) px of all dots of a tag."""
    xy = cv2.perspectiveTransform(pattern.points_mm[None], H)[0]
    edge = [pattern.points_mm + d * pattern.diameters_mm[:, None] / 2 for d in ([1, 0], [0, 1])]
    axes = [cv2.perspectiveTransform(one[None], H)[0] - xy for one in edge]
    area = np.abs(axes[0][:, 0] * axes[1][:, 1] - axes[0][:, 1] * axes[1][:, 0])
    return xy + np.random.default_rng(seed).normal(0, noise_px, xy.shape), 2 * np.sqrt(area)


def test_words_are_of_a_cyclic_code_whose_turns_differ_in_30_symbols() -> None:
    code = rune_code()
    assert len(code.number) == len(np.unique(code.number)) == 17_000
    rng = np.random.default_rng(1)
    some = code.word[rng.choice(17_000, 40, replace=False)]
    turned = np.concatenate([np.roll(some, k, axis=1) for k in range(SECTORS)])
    apart = (turned[:, None] != some[None]).sum(axis=2)
    assert sorted(apart.ravel())[:40] == [0] * 40
    assert np.sort(apart.ravel())[40] >= APART
    # Linear and cyclic: seven words of the code and their turns span no more than seven dimensions over GF(7).
    assert _rank(np.concatenate([np.roll(some, k, axis=1) for k in (0, 5, 17)]).astype(int)) == 7


def test_a_number_is_that_of_the_message_and_of_one_turn() -> None:
    """Dividing by the generator gives the message, of whose digits a number is made; 16 turns by a sector mod 173."""
    code = rune_code()
    for row in (0, 77, 9_000, 16_999):
        left, digits = code.word[row].astype(int), []
        for k in range(6, -1, -1):
            digits.append(int(left[k + 36]))
            left[k : k + 37] = (left[k : k + 37] - digits[-1] * np.array(_GENERATOR)) % 7
        assert not left.any()
        assert int("".join(map(str, digits[1:])), 7) == code.number[row]
        assert sum(int(c) * pow(16, j, 173) for j, c in enumerate(code.word[row])) % 173 in (1, 2, 4, 8)


def _rank(rows: np.ndarray) -> int:
    """Rank over the field of 7 elements."""
    rank = 0
    for column in range(rows.shape[1]):
        below = np.flatnonzero(rows[rank:, column]) + rank
        if not len(below):
            continue
        rows[[rank, below[0]]] = rows[[below[0], rank]]
        rows[rank] = rows[rank] * pow(int(rows[rank, column]), -1, 7) % 7
        rows[rank + 1 :] = (rows[rank + 1 :] - rows[rank + 1 :, column, None] * rows[rank]) % 7
        rank += 1
        if rank == len(rows):
            break
    return rank


def test_what_is_printed_says_the_word() -> None:
    number = int(rune_code().number[4321])
    sector, circle = places_of_rune(number)
    shown = np.zeros((SECTORS, 3), int)
    shown[sector, circle] = 1
    assert (symbols_of(shown) == word_of_rune(number)).all()
    pattern = tag(number)
    radius = np.linalg.norm(pattern.points_mm, axis=1)
    assert np.allclose(radius, MM / 12 * (4 + circle))
    assert np.allclose(pattern.diameters_mm, 2 * radius / 17.8)
    # Counter-clockwise from the right, seen from the front.
    angle = np.arctan2(pattern.points_mm[:, 1], pattern.points_mm[:, 0]) % (2 * np.pi)
    assert np.allclose(angle, sector * 2 * np.pi / 43)
    apart, _ = cKDTree(pattern.points_mm).query(pattern.points_mm, k=2)
    assert apart[:, 1].min() > 1.2 * pattern.diameters_mm.min()


@pytest.mark.parametrize("tilt_deg", [0, 20, 40, 55])
def test_every_dot_is_named_at_any_slant_and_turn(tilt_deg: float) -> None:
    for seed in range(4):
        pattern = tag(int(rune_code().number[1000 * seed + 17]))
        xy, diameter = seen(pattern, homography(tilt_deg, 77.0 * seed), 0.1, seed)
        order = np.random.default_rng(seed).permutation(len(xy))
        assert (name_rune(xy[order], diameter[order], pattern) == order).all(), seed


def test_a_third_hidden_and_dots_that_are_none_leave_no_dot_wrong() -> None:
    read = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        pattern = tag(int(rng.choice(rune_code().number)))
        xy, diameter = seen(pattern, homography(30, 45.0 * seed), 0.1, seed)
        left = np.flatnonzero(np.abs(np.arctan2(*(xy - 500).T)) > 0.33 * np.pi)
        rubbish = np.column_stack([rng.uniform(50, 950, 25), rng.uniform(50, 950, 25)])
        found = name_rune(
            np.concatenate([xy[left], rubbish]), np.concatenate([diameter[left], rng.uniform(8, 25, 25)]), pattern
        )
        named = found[: len(left)] >= 0
        assert (found[: len(left)][named] == left[named]).all()
        assert (found[len(left) :] >= 0).sum() == 0
        read += bool(named.all())
    assert read >= 7


def test_other_tags_a_tag_from_behind_and_rubbish_have_no_name() -> None:
    rng, numbers = np.random.default_rng(5), rune_code().number
    pattern = tag(int(numbers[5000]))
    for seed in range(5):
        H = homography(25, 30.0 * seed)
        other = tag(int(rng.choice(numbers)))
        xy, diameter = seen(other, H, 0.1, seed)
        assert (name_rune(xy, diameter, pattern) == -1).all()
        xy, diameter = seen(pattern, H, 0.1, seed)
        assert (name_rune(xy * [-1, 1], diameter, pattern) == -1).all()
        any_place = rng.random((SECTORS, 3)) < 0.57
        sector, circle = np.nonzero(any_place)
        angle, radius = 2 * np.pi * sector / SECTORS, 100 * (4 + circle) / 6
        xy = cv2.perspectiveTransform(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])[None], H)[0]
        assert (name_rune(xy, 0.11 * 2 * np.linalg.norm(xy - 500, axis=1), pattern) == -1).all()
        xy = rng.uniform(100, 900, (90, 2))
        assert (name_rune(xy, np.full(90, 25.0), pattern) == -1).all()


def test_a_number_that_is_none_is_refused_in_a_sentence() -> None:
    missing = int(np.setdiff1d(np.arange(2000), rune_code().number)[0])
    with pytest.raises(ValueError, match="no RUNE-Tag of number"):
        RuneTagPart(kind="runetag", diameter_mm=190, number=missing)


def test_tags_that_nobody_named_are_told_with_half_of_one_hidden() -> None:
    whole, half = (tag(int(rune_code().number[row])) for row in (77, 12_345))
    xy, diameter = seen(whole, homography(30, 20), 0.15, 1)
    other, size = seen(half, homography(40, 200), 0.15, 2)
    left = np.flatnonzero(np.abs(np.arctan2(*(other - 500).T)) > 0.45 * np.pi)
    number, point = read_runes(np.concatenate([xy, other[left] + [900, 0]]), np.concatenate([diameter, size[left]]))
    assert (number[: len(xy)] == whole.first_tag).all()
    assert (point[: len(xy)] == np.arange(len(xy))).all()
    named = number[len(xy) :] >= 0
    assert named.mean() > 0.9 and (number[len(xy) :][named] == half.first_tag).all()
    assert (point[len(xy) :][named] == left[named]).all()


def test_chance_agrees_with_a_word_as_often_as_counted() -> None:
    """Dice against 731,000 words and turns: 14 of 43 symbols agree in some 2 of 1,000."""
    symbols = np.random.default_rng(3).integers(0, 7, (8, SECTORS))
    turns = (np.arange(SECTORS)[:, None] + np.arange(SECTORS)) % SECTORS
    shown = (symbols[0][turns][..., None] == np.arange(7)).reshape(SECTORS, -1).astype(np.float32)
    alike = _as_bits() @ shown.T
    assert alike.size == TAGS * SECTORS
    for least in (10, 12, 14):
        assert (alike >= least).sum() == pytest.approx(chance_of_rune(SECTORS, least), rel=0.1)
    # The nearest word agrees as much as counted, and with a tag's own symbols that tag.
    best = [nearest_rune(one)[2] for one in symbols]
    assert all(chance_of_rune(SECTORS, most) > 1e-4 for most in best)
    number = int(rune_code().number[4])
    assert nearest_rune(np.roll(word_of_rune(number), 9)) == (number, 9, SECTORS)


@pytest.mark.parametrize(("seen", "wrong", "told"), [(14, 0, False), (17, 0, True), (28, 6, False), (43, 14, True)])
def test_a_number_is_told_where_chance_would_not_bring_a_word_as_near(seen: int, wrong: int, told: bool) -> None:
    word = word_of_rune(int(rune_code().number[600]))
    symbols = np.where(np.arange(SECTORS) < seen, (word + (np.arange(SECTORS) < wrong)) % 7, -1)
    assert (_any(symbols) is not None) == told


def test_no_number_is_made_of_rubbish_or_of_a_quarter_of_a_tag() -> None:
    rng, pattern = np.random.default_rng(8), tag(int(rune_code().number[5000]))
    H = homography(25, 30)
    xy, diameter = seen(pattern, H, 0.1, 3)
    few = np.flatnonzero(np.abs(np.arctan2(*(xy - 500).T)) > 0.75 * np.pi)
    assert (read_runes(xy[few], diameter[few])[0] == -1).all()
    sector, circle = np.nonzero(rng.random((SECTORS, 3)) < 0.57)
    angle, radius = 2 * np.pi * sector / SECTORS, 100 * (4 + circle) / 6
    xy = cv2.perspectiveTransform(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])[None], H)[0]
    assert (read_runes(xy, 0.11 * 2 * np.linalg.norm(xy - 500, axis=1))[0] == -1).all()
    xy = rng.uniform(100, 900, (90, 2))
    assert (read_runes(xy, np.full(90, 25.0))[0] == -1).all()


@pytest.mark.parametrize("target", ["runetag:3505", "runetag"])
def test_a_photograph_shows_a_tag_by_its_number(target: str) -> None:
    fine, H = 8, np.array([[1, 0, -340], [0, 1, -340], [0, 0, 1]]) @ homography(25, 40, 240.0)
    points, size = tag(3505).points_mm, tag(3505).diameters_mm
    image, angle = np.full((320 * fine, 320 * fine), 200, np.uint8), np.linspace(0, 2 * np.pi, 90, endpoint=False)
    for middle, diameter in zip(points, size, strict=True):
        circle = middle + diameter / 2 * np.column_stack([np.cos(angle), np.sin(angle)])
        edge = (cv2.perspectiveTransform(circle[None], H)[0] + 0.5) * fine - 0.5
        cv2.fillPoly(image, [np.rint(edge * 16).astype(np.int32)], 20, shift=4)
    sharp = cv2.resize(image.astype(np.float32), (320, 320), interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(sharp, (0, 0), 0.7)
    shown = Photograph("drawn", image + np.random.default_rng(0).normal(0, 1, image.shape).astype(np.float32), 8, ())
    found = detect_in_photograph(shown, parse_target(target), polarity=ON_WHITE)
    named = found.observations.point >= 0
    assert named.sum() > 0.9 * len(points), found.summary
    assert target == "runetag:3505" or found.numbers.tolist() == [3505]
    true = cv2.perspectiveTransform(points[None], H)[0]
    assert np.linalg.norm(found.observations.xy_px - true[found.observations.point], axis=1)[named].max() < 0.2
