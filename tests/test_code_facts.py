"""Numbers and words of ring codes as the world outside has them, and kept photographs of real targets.

Six pairs of 14 bits are the maker's: each target's number is printed beside its ring on the plate of
`photographs/ring14_plate_cut.png`, and the rings were read there by eye, clockwise. The numbers of codes are those
that are published for these code lengths (147 of 12 bits, 516 of 14 bits). All other pairs come from the rules of the
patent DE 197 33 466 A1, worked out by hand or on words as texts.
"""

from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.camera.photograph import photograph_of, read_photograph
from testfield.detect.photograph import ON_WHITE, detect_in_photograph
from testfield.detect.target_spec import parse_target
from testfield.targets.ring_code import code_words, number_of_word, word_of_number

PHOTOGRAPHS = Path(__file__).parent / "photographs"
PRINTED = {
    3: "10001011000000",
    4: "10001101000000",
    5: "10010011000000",
    13: "10110001000000",
    14: "10110111000000",
    15: "10111011000000",
}
"""The maker's numbers and what their rings show, clockwise from the segment at the left."""
TABLE = {
    8: {1: "00010001", 2: "00010111", 3: "00011011", 10: "01010101", 13: "01110111"},
    10: {1: "0000100001", 2: "0000100111", 3: "0000101011", 10: "0001001011", 42: "0111101111"},
    12: {1: "000001000001", 2: "000001000111", 3: "000001001011", 10: "000001100101", 147: "011111011111"},
    14: {1: "00000010000001", 2: "00000010000111", 10: "00000010100101", 258: "00011001001011", 516: "01111110111111"},
    16: {1: "0000000100000001", 2: "0000000100000111", 10: "0000000100100101", 1861: "0111111101111111"},
    20: {
        1: "00000000010000000001",
        2: "00000000010000000111",
        10: "00000000010000100101",
        24793: "01111111110111111111",
    },
}
COUNT = {8: 13, 10: 42, 12: 147, 14: 516, 16: 1861, 20: 24793}


@pytest.mark.parametrize("number", PRINTED)
def test_the_makers_numbers_belong_to_the_rings_beside_them(number: int) -> None:
    assert number_of_word(np.array([int(PRINTED[number], 2)]), 14)[0] == number


@pytest.mark.parametrize("bits", TABLE)
def test_words_stand_under_their_published_numbers(bits: int) -> None:
    assert len(code_words(bits)) == COUNT[bits]
    for number, word in TABLE[bits].items():
        assert f"{word_of_number(np.array([number]), bits)[0]:0{bits}b}" == word
        for turn in range(bits):
            assert number_of_word(np.array([int(word[turn:] + word[:turn], 2)]), bits)[0] == number


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_the_whole_table_follows_from_the_rules_on_words_as_texts(bits: int) -> None:
    """Smallest rotation; an even number of ones; a pair of ones across from each other; not all ones."""
    words = []
    for k in range(1 << bits):
        word = f"{k:0{bits}b}"
        opposite = any(word[j] == word[j + bits // 2] == "1" for j in range(bits // 2))
        if (
            word.count("1") % 2 == 0
            and opposite
            and "0" in word
            and word == min(word[j:] + word[:j] for j in range(bits))
        ):
            words.append(word)
    assert [f"{word:0{bits}b}" for word in code_words(bits)] == words


def test_the_printed_numbers_are_read_in_the_photograph() -> None:
    """Read the other way round, or with another number for a word, these would be others of the valid numbers."""
    found = detect_in_photograph(
        read_photograph(PHOTOGRAPHS / "ring14_plate_cut.png"), parse_target("ring14")
    ).observations
    at = {int(code): xy for code, xy in zip(found.code, found.xy_px, strict=True) if code > 0}
    assert set(at) == set(PRINTED)
    for number, place in {
        3: (58, 283),
        4: (202, 298),
        5: (347, 312),
        13: (72, 128),
        14: (216, 141),
        15: (358, 156),
    }.items():
        assert np.linalg.norm(at[number] - place) < 2, number


def test_all_circles_of_a_kept_photograph_are_found_in_their_places() -> None:
    found = detect_in_photograph(read_photograph(PHOTOGRAPHS / "circle_grid_00003.jpg"), parse_target("circles:10x8"))
    assert found.notes[0] == ON_WHITE
    here = found.place[:, 0] >= 0
    assert here.sum() == 80
    assert {tuple(place) for place in found.place[here].tolist()} == {(c, r) for c in range(10) for r in range(8)}


def test_numbers_of_12_14_and_20_bits_are_those_of_micmac() -> None:
    """Its tables of targets "CERN" (micmacIGN/micmac, MMVII/MMVII-RessourceDir/CodeCircTaget, Nbit_lookup.txt):
    number and smallest rotation, ascending."""
    assert [len(code_words(bits)) for bits in (12, 14, 20)] == [147, 516, 24793]
    assert [code_words(12)[k - 1] for k in (1, 2, 40, 82, 110, 132, 143, 147)] == [
        65,
        71,
        277,
        585,
        821,
        1365,
        1755,
        2015,
    ]
    of_14 = {1: 129, 33: 263, 100: 669, 174: 1097, 254: 1589, 334: 2343, 419: 3279, 485: 5463, 509: 7023, 516: 8127}
    assert {number: int(code_words(14)[number - 1]) for number in of_14} == of_14
    of_20 = {1: 1025, 100: 1421, 257: 2055, 640: 4117, 767: 5129, 1000: 6071, 24777: 489343, 24793: 523775}
    assert {number: int(code_words(20)[number - 1]) for number in of_20} == of_20


@pytest.mark.parametrize(
    ("bits", "shape", "words"),
    [
        (12, "1:2:3", {1: 65, 40: 277, 110: 821, 147: 2015}),
        (14, "1:2:3", {33: 263, 100: 669, 334: 2343, 509: 7023}),
        (20, "1:2.5:4", {100: 1421, 640: 4117, 1000: 6071, 24777: 489343}),
    ],
)
def test_codes_as_micmac_draws_them_have_its_numbers(bits: int, shape: str, words: dict[int, int]) -> None:
    """Its targets "CERN" (MMVII/src/CodedTarget/cGenerateTarget.cpp): white on black, bit k of the word in the sector
    k counter-clockwise from the right; rings from 2 to 3 radii of the dot, with 20 bits from 2.5 to 4."""
    inner, outer = (float(part) for part in shape.split(":")[1:])
    fine, pitch = 4, 160
    y, x = (np.mgrid[: pitch * fine, : pitch * fine] + 0.5) / fine - pitch / 2 - 0.2
    rho, sector = np.hypot(x, y) / 16, (np.arctan2(-y, x) % (2 * np.pi) / (2 * np.pi) * bits).astype(int)
    ring = (rho > inner) & (rho < outer)
    white = [(rho < 1) | (ring & ((word >> sector) & 1 == 1)) for word in words.values()]
    fine_dn = 30 + 170 * np.hstack(white).astype(float)
    sharp = fine_dn.reshape(pitch, fine, -1, fine).mean(axis=(1, 3))
    image = cv2.GaussianBlur(sharp, (0, 0), 0.7) + np.random.default_rng(0).normal(0, 2, sharp.shape)
    o = detect_in_photograph(
        photograph_of("drawn", image.round().astype(np.uint8)), parse_target(f"ring{bits}"), shape
    ).observations
    coded = np.flatnonzero(o.code > 0)
    assert o.code[coded][np.argsort(o.xy_px[coded, 0])].tolist() == list(words)
