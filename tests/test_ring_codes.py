import json

import numpy as np
import pytest

from testfield.cli.main import main
from testfield.targets.code_sets import choose_codes, cyclic_distance, mirrored, repeats
from testfield.targets.ring_code import code_words, number_of_word, smallest_rotation, word_of_number

COUNTS = {8: 13, 10: 42, 12: 147, 14: 516, 16: 1861, 20: 24793}


@pytest.mark.parametrize(("bits", "count"), COUNTS.items())
def test_the_tables_have_the_published_counts(bits: int, count: int) -> None:
    assert len(code_words(bits)) == count


def test_numbers_and_words_are_inverse_in_any_rotation() -> None:
    words = word_of_number(np.arange(1, 517), 14)
    for turn in range(14):
        turned = ((words << np.uint32(turn)) | (words >> np.uint32(14 - turn))) & np.uint32((1 << 14) - 1)
        assert np.array_equal(number_of_word(turned, 14), np.arange(1, 517))


def test_no_two_valid_words_differ_in_one_bit() -> None:
    words = code_words(14)
    for bit in range(14):
        assert not number_of_word(words ^ np.uint32(1 << bit), 14).any()


def test_reading_the_wrong_way_round_gives_mostly_other_valid_numbers() -> None:
    # This is why chirality needs a test on rendered images (test_detection): the error is silent here.
    words = code_words(14)
    mirrored = np.array([int(f"{w:014b}"[::-1], 2) for w in words], np.uint32)
    other = number_of_word(mirrored, 14)
    assert (other > 0).all()
    assert (other != np.arange(1, 517)).mean() > 0.7


def test_a_number_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match="1 to 516"):
        word_of_number(np.array([517]), 14)


def test_smallest_rotation_is_a_rotation_and_smallest() -> None:
    assert smallest_rotation(np.array([0b10000000000001], np.uint32), 14) == 0b11


@pytest.mark.parametrize(("bits", "count"), [(12, 8), (14, 20), (14, 60), (16, 50), (20, 200)])
def test_a_chosen_set_keeps_its_distance_from_turned_and_mirrored_readings(bits: int, count: int) -> None:
    numbers, distance = choose_codes(bits, count)
    assert len(set(numbers.tolist())) == count
    words = word_of_number(numbers, bits)
    there = cyclic_distance(words, words, bits) + 99 * np.eye(count, dtype=int)
    mirror = cyclic_distance(words, mirrored(words, bits), bits) + 99 * np.eye(count, dtype=int)
    assert min(there.min(), mirror.min()) == distance
    assert distance >= {12: 4, 14: 4 if count == 20 else 2, 16: 4, 20: 4}[bits]
    assert not repeats(words, bits).any()


def test_the_distance_of_two_rings_is_counted_over_all_turns() -> None:
    assert cyclic_distance(np.array([0b00000000010010]), np.array([0b00000000001001]), 14).item() == 0
    assert cyclic_distance(np.array([0b00000001111111]), np.array([0b00000000111111]), 14).item() == 1


def test_the_whole_table_can_be_chosen() -> None:
    numbers, distance = choose_codes(12, 147, mirrors=False)
    assert numbers.tolist() == list(range(1, 148))
    assert distance == 2


def test_the_command_lists_and_chooses(capsys: pytest.CaptureFixture) -> None:
    assert main(["codes", "--bits", "14"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 517
    assert lines[1].split()[:2] == ["1", f"{code_words(14)[0]:014b}"]
    assert main(["codes", "--bits", "8", "--choose", "14"]) == 2
    assert "there are 13" in capsys.readouterr().err
    assert main(["codes", "--bits", "14", "--choose", "12", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["numbers"]) == 12
