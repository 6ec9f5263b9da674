"""The page of a twin: every figure, reason and note is on it, with both images of a station."""

from pathlib import Path

import numpy as np
import pytest

from testfield.author.twin_compare import Row
from testfield.report.twin import write_twin


@pytest.mark.parametrize(("ratio", "words"), [(1.2, "verdict passed"), (2.7, "verdict doubtful"), (None, "doubtful")])
def test_the_page_shows_both_images_and_all_figures(tmp_path: Path, ratio: float | None, words: str) -> None:
    rows = [Row("residual <rms>", "0.1 px", "0.2 px", ratio), Row("fx", "1.0", "2.0")]
    image = np.linspace(0, 255, 4800).reshape(60, 80)
    path = write_twin(tmp_path, "t", "t.toml", rows, ["a reason"], ["a note"], [("one", image, image / 2)] * 9)
    text = path.read_text()
    for piece in ("residual &lt;rms&gt;", "0.2 px", "a reason", "a note", words):
        assert piece in text
    assert text.count("data:image/jpeg") == 12
