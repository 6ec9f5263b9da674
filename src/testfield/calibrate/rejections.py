"""Rejections by group: whether an image, a board, a camera or a certificate lost more than its share.

Single observations are rejected one by one, for they contradict all others. Where many of one group go, the group is
to blame: a sheet with another spacing, an image whose numbers are shifted, photographs by another camera. The chance
that a group loses so many at the rate of all others is binomial, and is asked of as many groups as there are.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binom

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.targets.field import Field

SIGNIFICANCE = 0.001
"""Chance that any group at all is blamed where rejections fall evenly."""
LEAST_SHARE = 0.2
"""Part of a group's observations below which its losses are no reason to doubt all of it."""
LEAST_LOST = 4
"""Rejections of one group below which chance or dirt explains them."""
ORDINARY = 0.02
"""Rate of rejections that needs no reason: a few misread marks in a hundred."""
HOPELESS = 10.0
"""How many times as large as claimed residuals may be before nothing fits."""
HOPELESS_PX = 1.0
"""Rms of residuals that no centre of a target has, however poor its image: a model is wrong."""
HALF = 0.4
"""Part of all observations the loss of which leaves nobody to say who was wrong."""


@dataclass(frozen=True)
class Group:
    """What observations have in common: `kind` (board, station, camera, certificate, mark) and `name`."""

    kind: str
    name: str


def counted(used: Iterable[tuple[Group, ...]], rejected: Iterable[tuple[Group, ...]]) -> tuple[dict, ...]:
    """One entry a group: `kind`, `name`, observations `used` and `rejected`, and whether these are `too_many`; each
    observation is given by the groups it belongs to."""
    kept, lost = (Counter(group for groups in some for group in groups) for some in (used, rejected))
    groups = sorted({*kept, *lost}, key=lambda g: (g.kind, g.name))
    rows = []
    for group in groups:
        n, k = kept[group] + lost[group], lost[group]
        others = [g for g in groups if g.kind == group.kind and g != group]
        all_others = sum(kept[g] + lost[g] for g in others)
        rate = max(sum(lost[g] for g in others) / all_others if all_others else 0.0, ORDINARY)
        chance = float(binom.sf(k - 1, n, min(rate, 1.0))) if k else 1.0
        many = k >= LEAST_LOST and k > LEAST_SHARE * n and chance < SIGNIFICANCE / len(groups)
        if group.kind == "mark" and not k:
            continue  # there are as many as there are marks
        rows.append({"kind": group.kind, "name": group.name, "used": kept[group], "rejected": k, "too_many": many})
    return tuple(rows)


def judged(calibration: Calibration, rows: tuple[dict, ...]) -> Calibration:
    """The calibration with its rejections counted; it is not passed where a group lost more than its share, or so much
    is lost that nobody can say who was wrong, or something else has failed already."""
    failures = list(calibration.failures)
    marks = [row for row in rows if row["too_many"] and row["kind"] == "mark"]
    notes = [
        f"{row['name']} was rejected in {row['rejected']} of {row['used'] + row['rejected']} images: is it elsewhere "
        "than on the sheet, exchanged with another, or damaged?"
        for row in marks
    ]
    for row in rows:
        if row["too_many"] and row not in marks:
            failures.append(
                f"{NAMES[row['kind']]} '{row['name']}': {row['rejected']} of {row['used'] + row['rejected']} "
                f"observations were rejected, more than its share: {WHY[row['kind']]}"
            )
    used, lost = calibration.used, len(calibration.rejected)
    if lost > HALF * (used + lost) and lost >= LEAST_LOST:
        failures.append(
            f"{lost} of {used + lost} observations were rejected: what is left may be the wrong part; look at the "
            "images' camera, the sheets, the numbers"
        )
    if calibration.sigma0 > HOPELESS and calibration.reprojection_rms_px > HOPELESS_PX:
        failures.append(
            f"the residuals are {calibration.sigma0:.0f} times as large as claimed, and no single observation is to "
            f"blame: are all images by one camera, is its lens '{calibration.interior.model}', do the sheets fit?"
        )
    said = [sentence for sentence in failures if sentence not in calibration.notes]
    test = calibration.test
    if test:
        test = test | {"passed": bool(test["passed"]) and not failures}
    return replace(
        calibration, rejections=rows, failures=tuple(failures), notes=(*said, *notes, *calibration.notes), test=test
    )


NAMES = {"board": "board", "station": "image", "camera": "camera", "certificate": "distance"}
WHY = {
    "board": "does its sheet fit it (spacing, numbers)?",
    "station": "are its marks numbered as in the others, and is it by the same camera?",
    "camera": "are all its images by one camera?",
    "certificate": "are its targets those that are meant?",
}


def lossy(rejections: tuple[dict, ...]) -> list[dict]:
    """Groups that lost any observation, the hardest hit first."""
    some = [row for row in rejections if row["rejected"]]
    return sorted(some, key=lambda row: (not row["too_many"], -row["rejected"] / (row["used"] + row["rejected"])))


def failed_checks(checks: Iterable[tuple[str, float | None]]) -> list[str]:
    """A sentence for every check distance (its name and E_n) that misses its certificate by more than both state."""
    return [
        f"the check distance '{name}' FAILED: E_n = {en:+.2f}, and at most 1 in size is allowed: "
        "are its ends the targets that are meant, is its certificate still true, is the scale by enough lengths?"
        for name, en in checks
        if en is not None and not abs(en) <= 1
    ]


def failed(calibration: Calibration, failures: list[str]) -> Calibration:
    """The calibration with more failures: not passed, where there are any."""
    if not failures:
        return calibration
    test = calibration.test | {"passed": False} if calibration.test else calibration.test
    return replace(
        calibration, failures=(*calibration.failures, *failures), notes=(*failures, *calibration.notes), test=test
    )


def lost_images(shared: dict[str, int], joined: tuple[str, ...], least: int) -> list[str]:
    """A sentence for each image that was not joined to the others, though it has `least` targets or more in common with
    them (`shared`)."""
    return [
        f"image '{name}' shows {count} targets that others show too, and does not fit them: is it numbered as they "
        "are, and by the same camera?"
        for name, count in shared.items()
        if name not in joined and count >= least
    ]


def of_boards(calibration: Calibration, used: Observations, field: Field) -> Calibration:
    """A calibration with boards judged; `used` observations are those that were left."""
    names = [sheet.name for sheet in field.boards]
    bars = {code: bar.name for bar in field.scale_bars if bar.role == "control" for code in bar.codes}
    rows = zip(used.station, used.board, used.code, used.point, strict=True)
    kept = [
        _groups(used.stations[s], names[b], "", _mark(names[b], c, p))
        if b >= 0
        else _groups(used.stations[s], "", bars.get(int(c), ""))
        for s, b, c, p in rows
    ]
    lost = [
        _groups(r["station"], r["board"], "", _mark(r["board"], r["code"], r["point"]))
        if r["board"]
        else _groups(r["station"], "", bars.get(r["code"], ""))
        for r in calibration.rejected
    ]
    return judged(calibration, counted(kept, lost))


def of_joints(calibration: Calibration) -> Calibration:
    """The calibration of a method that rejects nothing itself, judged by what was turned down before it."""
    kept = [_groups(joint["station"], joint["board"]) for joint in calibration.joints for _ in range(joint["marks"])]
    lost = [_groups(r["station"], r["board"]) for r in calibration.rejected]
    return judged(calibration, counted(kept, lost))


def of_ties(calibration: Calibration, station: np.ndarray, code: np.ndarray, ends: dict[int, str]) -> Calibration:
    """A calibration without boards judged: the used sights' `station` (m,) and `code` (m,), and which code is an `end`
    of what certificate."""
    names = calibration.station_names
    kept = [_groups(names[s], "", ends.get(int(c), "")) for s, c in zip(station, code, strict=True)]
    lost = [_groups(r["station"], "", ends.get(r["code"], "")) for r in calibration.rejected]
    return judged(calibration, counted(kept, lost))


def _mark(board: str, code: int, point: int) -> str:
    """What a reader calls a mark of a board."""
    return f"{f'code {code}' if code > 0 else f'mark {point}'} of board '{board}'"


def _groups(station: str, board: str, certificate: str = "", mark: str = "", camera: str = "") -> tuple[Group, ...]:
    """The groups of one observation; there is one camera today, and its name is empty."""
    named = (("station", station), ("board", board), ("certificate", certificate), ("mark", mark), ("camera", camera))
    return tuple(Group(kind, name) for kind, name in named if name)
