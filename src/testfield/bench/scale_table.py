"""What becomes of a table on many workers, as lines for people."""

from collections.abc import Iterator
from typing import Any


def lines(figures: dict[str, Any]) -> Iterator[str]:
    """The figures of `bench_scale`, a line each."""
    cases, seconds, workers = figures["cases"], figures["seconds"], figures["workers"]
    yield f"{cases} cases of {seconds:g} s on {workers} workers, {figures['batch']} a task"
    yield f"{'':<22}{'whole, s':>10}{'workers':>9}{'scheduler':>11}{'parent':>8}{'tasks held':>12}{'MB held':>9}"
    for name, run in figures["runs"].items():
        busy = "".join(f"{100 * run[k]:>{w}.1f} %" for k, w in (("workers_busy", 7), ("scheduler_busy", 9)))
        held = f"{run['most_held']:>12.0f}{run['held_mb']:>9.1f}"
        yield f"{name:<22}{run['whole_s']:>10.0f}{busy}{100 * run['parent_busy']:>6.1f} %{held}"
    yield (
        f"keys, before the first case: {figures['before_s']:.0f} s of the parent; rows, meanwhile: "
        f"{figures['reading_s']:.0f} s, {100 * figures['reading_busy']:.0f} % of its time"
    )
    for name, least in sorted(figures["full_at_seconds"].items(), key=lambda item: -item[1]):
        yield f"{name}: keeps up with cases of {least:.2f} s and more"
    asked = figures["requests"]
    yield "storage: " + ", ".join(f"{k.replace('_', ' ')} {v:.3g}" for k, v in asked.items())
