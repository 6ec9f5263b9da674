"""Progress on standard error: a bar on a terminal, silence elsewhere."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def bar(title: str, total: float, unit: str) -> Iterator[Callable[[float], None]]:
    """A bar that is moved by calling what this yields with the amount done since the last call."""
    from tqdm import tqdm

    layout = "{desc:<12}{percentage:3.0f}% |{bar:30}| {n:.0f}/{total:.0f} {unit}  {elapsed}<{remaining}"
    with tqdm(
        total=total, desc=title, unit=unit, disable=None, leave=True, bar_format=layout, mininterval=0.2
    ) as meter:

        def move(amount: float) -> None:
            # Fractions of a unit do not add up to exactly one.
            meter.update(min(amount, total - meter.n))

        yield move
