"""What was asked before is answered at once, and only what was asked."""

from dataclasses import dataclass

import numpy as np

from testfield.store import remembered as room
from testfield.store.remembered import remembered


@dataclass(frozen=True)
class Lens:
    terms: np.ndarray


def test_the_same_contents_are_answered_once_and_others_by_themselves() -> None:
    asked = []

    @remembered
    def total(lens: Lens, views: list[tuple[np.ndarray, np.ndarray]], scale: float = 1.0) -> float:
        asked.append(scale)
        return scale * float(lens.terms.sum() + sum(a.sum() + b.sum() for a, b in views))

    def view(k: float) -> tuple[np.ndarray, np.ndarray]:
        return np.full((3, 2), k), np.ones(3)

    assert [total(Lens(np.ones(2)), [view(1.0)]) for _ in range(3)] == [11.0] * 3
    assert len(asked) == 1
    others = [
        total(Lens(np.zeros(2)), [view(1.0)]),
        total(Lens(np.ones(2)), [view(2.0)]),
        total(Lens(np.ones(2)), [view(1.0), view(1.0)]),
        total(Lens(np.ones(2)), [view(1.0)], scale=2.0),
    ]
    assert others == [9.0, 17.0, 20.0, 22.0]
    assert len(asked) == 5


def test_old_answers_are_forgotten() -> None:
    asked = []
    again = remembered(lambda k: asked.append(k))
    for k in [*range(room.MOST + 1), 0]:
        again(k)
    assert len(asked) == room.MOST + 2
