"""Centring against the physical limit: series of cases that vary one thing at a time, and verdicts on them.

Each finished case is kept on disk, keyed by the case, the exposures and the source of all that measures it.
"""

import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from testfield.bench.centring import BEST, SEED, Task, measure
from testfield.bench.dots import Case
from testfield.evaluate.check import Check, Limit
from testfield.registry import module_of, names
from testfield.store.code import code_digest
from testfield.store.digests import digest
from testfield.store.kept import make_each
from testfield.store.ledger import Ledger
from testfield.store.text import read_text, write_text

FACTORS: dict[str, tuple[str, list[Any]]] = {
    "diameter": ("diameter_px", [4.0, 5.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 40.0]),
    "tilt": ("tilt_deg", [0.0, 15.0, 30.0, 45.0, 60.0, 65.0, 70.0]),
    "snr": ("snr", [5.0, 10.0, 20.0, 50.0, 100.0, 200.0]),
    "blur": ("blur_px", [0.4, 0.6, 0.8, 1.2, 2.0, 3.0]),
    "gradient": ("gradient", [0.0, 0.01, 0.02, 0.03, 0.04]),
    "phase": ("phase", [(0.0, 0.0), (0.125, 0.0), (0.25, 0.0), (0.375, 0.0), (0.5, 0.0), (0.5, 0.5)]),
    "coded": ("diameter_px", [6.0, 8.0, 12.0, 16.0, 24.0, 40.0]),
}
"""What is varied, from the least to the most; all else is as `Case` has it. `coded` are dots within ring codes."""
FIXED: dict[str, dict[str, Any]] = {"phase": {"tilt_deg": 0.0}, "coded": {"coded": True}}
"""What else a series asks for: a phase is the same for all dots only on a board that is seen straight."""
QUICK = {
    "diameter": (2, 4, 6),
    "tilt": (0, 4),
    "snr": (2, 5),
    "blur": (0, 5),
    "gradient": (4,),
    "phase": (2,),
    "coded": (1, 3),
}
CORNERS = [
    Case(6.0, 60.0, 20.0),
    Case(6.0, 60.0, 200.0),
    Case(6.0, 0.0, 20.0),
    Case(40.0, 60.0, 200.0),
    Case(40.0, 0.0, 200.0),
    Case(40.0, 60.0, 20.0),
    Case(12.0, 60.0, 200.0, 0.7, 0.01),
]
"""Where the requirement's range ends in several ways at once; only the forward model is tried there."""
EXPOSURES, OTHERS, QUICK_EXPOSURES, QUICK_OTHERS = 64, 16, 20, 3
LARGE_PX, LEAST_OTHERS = 16.0, 8
"""Of dots larger than this the other estimators see fewer exposures, down to so many: they take as long."""
LEAST_EFFICIENCY, MOST_BIAS, CHI2, MOST_LOST = 0.9, 0.1, (0.9, 1.1), 0.002
KEPT = "detect_cases"

Plan = list[tuple[str, Task]]
Series = dict[str, list[dict[str, Any]]]


def bench_detect(quick: bool, folder: Path, tell: Callable[[str], None]) -> dict[str, Any]:
    """All series and the verdicts on them; `tell` hears what is being done, `folder` keeps finished cases."""
    series = run(plan(quick), folder, tell)
    return {"quick": quick, "series": series, "verdicts": verdicts(series)}


def plan(quick: bool) -> Plan:
    """Every case with its factor, in the order of the page."""
    tasks: Plan = []
    for factor, (field, values) in FACTORS.items():
        for value in [values[k] for k in QUICK[factor]] if quick else values:
            case = Case(**{**FIXED.get(factor, {}), field: value})
            others = max(round(OTHERS * min(1, LARGE_PX / case.diameter_px)), LEAST_OTHERS)
            tasks.append((factor, _task(case, quick, others)))
    return tasks + [("corners", _task(case, quick, 0)) for case in (CORNERS[:2] if quick else CORNERS)]


def _task(case: Case, quick: bool, others: int) -> Task:
    if quick:
        return Task(case, QUICK_EXPOSURES, QUICK_OTHERS, min(others, QUICK_OTHERS))
    return Task(case, EXPOSURES, EXPOSURES // 2, others)


def run(tasks: Plan, folder: Path, tell: Callable[[str], None], jobs: int = 1) -> Series:
    """Measure what is not yet kept in `folder`, by so many processes; a run that was stopped goes on where it was, with
    the same figures."""
    ledger = Ledger(folder / KEPT)
    algorithms = sorted({module_of("centroids", name) for name in names("centroids")})
    source = code_digest("testfield.bench.centring", *algorithms, module_of("lenses", "brown"))
    keys = {task: digest(task, SEED, names("centroids"), source) for _, task in tasks}
    missing = [task for task, key in keys.items() if not ledger.fresh(file_name(task), key)]
    if kept := len(keys) - len(missing):
        tell(f"{kept} of {len(keys)} cases are kept from before")
    progress = _Progress(missing, len(keys), tell)
    files = [(file_name(task), keys[task]) for task in missing]
    make_each(ledger, files, partial(_write, missing), jobs, moved=progress.moved)
    series: Series = {}
    for factor, task in tasks:
        row = json.loads(read_text(ledger.folder / file_name(task)))
        series.setdefault(factor, []).append(row)
    return series


class _Progress:
    """Tells which case is done, and how long the rest will take by the effort so far."""

    def __init__(self, missing: list[Task], cases: int, tell: Callable[[str], None]):
        self.missing, self.cases, self.tell = missing, cases, tell
        self.count, self.done, self.start = cases - len(missing), 0.0, time.monotonic()

    def moved(self, number: int) -> None:
        """Case `number` of those that were missing is done."""
        self.count += 1
        self.done += effort(self.missing[number])
        left = (time.monotonic() - self.start) * (sum(map(effort, self.missing)) / self.done - 1)
        end = f", {left / 60:.1f} min to go" if self.count < self.cases else ""
        self.tell(f"case {self.count} of {self.cases} is done{end}: {text(vars(self.missing[number].case))}")


def _write(tasks: list[Task], number: int, path: Path) -> None:
    write_text(path, json.dumps(measure(tasks[number])))


def effort(task: Task) -> float:
    """About how long a task takes, in any unit."""
    size = 1 + (task.case.diameter_px / 12) ** 1.5
    return size * (5 + task.exposures + task.of_known + 4 * task.of_others)


def text(case: dict[str, Any]) -> str:
    """A case for a person, on one line; light is even and the phase any where nothing is said of them."""
    parts = [
        f"{'ring codes of ' if case['coded'] else ''}{case['diameter_px']:g} px",
        f"tilt {case['tilt_deg']:g}",
        f"SNR {case['snr']:g}",
        f"blur {case['blur_px']:g} px",
    ]
    parts += [f"gradient {case['gradient']:g}"] if case["gradient"] else []
    parts += ["phase {:g}, {:g}".format(*case["phase"])] if case["phase"] is not None else []
    return ", ".join(parts)


def file_name(task: Task) -> str:
    """Where a finished task is kept."""
    case = task.case
    phase = "" if case.phase is None else "_phase{:g}_{:g}".format(*case.phase)
    return (
        f"{'ring' if case.coded else 'dot'}_{case.diameter_px:g}px_{case.tilt_deg:g}deg_snr{case.snr:g}"
        f"_blur{case.blur_px:g}_gradient{case.gradient:g}{phase}_x{task.exposures}_{task.of_others}.json"
    )


def in_range(case: dict[str, Any]) -> bool:
    """Whether the requirement speaks of a case: 6 to 40 px, SNR 20 to 200, tilt to 60 degrees."""
    return 6 <= case["diameter_px"] <= 40 and 20 <= case["snr"] <= 200 and case["tilt_deg"] <= 60


def verdicts(series: Series) -> list[dict[str, Any]]:
    """The plain forward model's worst figures in the range required, and whether they keep their limits: of dots, and
    of the dots in ring codes."""
    rows = [row for part in series.values() for row in part if in_range(row["case"])]
    result = []
    for of, coded in (("dots", False), ("ring codes", True)):
        result += [{"of": of} | v for v in _verdicts([row for row in rows if row["case"]["coded"] == coded])]
    return result


def _verdicts(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    if not rows:
        return []
    # A mean of chi-squared over a series; cases differ only by chance where the claim is honest.
    overall = float(np.mean([row["estimators"][BEST].get("chi2", np.nan) for row in rows]))
    return [
        _worst("least efficiency", rows, "efficiency", least=LEAST_EFFICIENCY),
        _worst("greatest bias of all dots together, in sigma", rows, "bias", most=MOST_BIAS),
        _worst("greatest bias of the single dots, in sigma", rows, "bias_by_dot", most=MOST_BIAS),
        _verdict("chi-squared per degree of freedom, mean of cases", overall, CHI2[0], CHI2[1]),
        _worst("the same, least case", rows, "chi2", least=CHI2[0]),
        _worst("the same, greatest case", rows, "chi2", most=CHI2[1]),
        _worst("largest part of dots not measured", rows, "lost", most=MOST_LOST),
    ]


def _worst(
    name: str, rows: list[dict[str, Any]], key: str, least: float | None = None, most: float | None = None
) -> dict[str, Any]:
    """The verdict on the case whose figure is the worst; a case without the figure is worse than any."""
    sign = 1 if least is None else -1

    def figure(row: dict[str, Any]) -> float:
        best = row["estimators"][BEST]
        if key == "lost":
            return best["not_measured"] / max(best["measured"] + best["not_measured"], 1)
        return best.get(key, sign * np.inf)

    row = max(rows, key=lambda r: sign * figure(r))
    best = row["estimators"][BEST]
    notes = {"seen": best.get(f"{key}_seen"), "band": best.get(f"{key}_band"), "case": text(row["case"])}
    return _verdict(name, figure(row), least, most) | notes


def _verdict(name: str, measured: float, least: float | None, most: float | None) -> dict[str, Any]:
    limit = Limit(-np.inf if least is None else least, np.inf if most is None else most)
    check = Check(name=name, value=measured, limit=limit)
    return {"name": name, "measured": check.row()["value"], "least": least, "most": most, "met": check.passed}
