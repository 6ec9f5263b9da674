"""Pictures write what they are given: a dollar is a dollar, and the same picture is the same bytes."""

import matplotlib as mpl
import numpy as np
import pytest

from testfield.report.style import figure, svg_of

NAMES = ("cost $5^$ a", "$\\frac{$", "100 $")


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_drawn_as_it_is_written(name: str) -> None:
    with figure(6, 4, 2) as (drawing, axes), mpl.rc_context({"svg.fonttype": "none"}):
        drawing.suptitle(name)
        for one in axes:
            one.plot([1, 2, 3], [1, 10, 100], label=name)
            one.set_xlabel(name), one.set_title(name), one.text(2, 2, name), one.legend()
        axes[0].set_xticks([1, 2, 3], [name] * 3)
        axes[1].bar([name, name + "b"], [1, 2])
        axes[1].set_yscale("log")
        drawn = svg_of(drawing).decode()
    assert drawn.count(f">{name}<") >= 10


def test_a_picture_is_the_same_bytes_each_time() -> None:
    def drawn() -> bytes:
        with figure(6, 4, 3, 2) as (drawing, axes):
            for k, one in enumerate(axes.flat):
                one.plot(np.cumsum(np.full(20, 0.1 * (k + 1))))
                one.set_title(f"picture {k}"), one.set_xlabel("x, mm"), one.set_ylabel("y, px")
            return svg_of(drawing)

    assert drawn() == drawn()
