import numpy as np
import pytest

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
