"""What a planner should be warned of, each with what it touches."""

import numpy as np

from testfield.adjust.weakness import weak_unknowns
from testfield.calibrate.doubts import geometric_doubts
from testfield.plan.network import LEAST_CODES
from testfield.plan.predict import Prediction
from testfield.targets.field import TIME

NARROW_DEG = 15.0
"""Views of a board, or rays to a point, within less than this of each other fix depth badly."""
FEW_RAYS = 3
"""With fewer rays a wrong one cannot be told from the others."""
UNEVEN = 3.0
"""Ratio of the longest to the shortest axis of the mean error ellipsoid from which its direction is named."""
NAMED = 6
"""Targets that a warning names."""
MOST_WEAK = 3
"""Weak combinations of unknowns that are named: the weakest come first."""


def warnings_of(found: Prediction) -> list[str]:
    """Sentences, the gravest kind first."""
    plan, network = found.planned, found.adjustment.network
    boards = tuple(found.job.field.boards[b].name for b in plan.boards)
    cameras = tuple(camera.name for camera in found.job.imaging.cameras)
    labels = plan.labels(network)
    unknown = len(labels) - 3 * len(network.kept_points)
    weak = weak_unknowns(found.adjustment.covariance[:unknown, :unknown], labels[:unknown])
    doubts = geometric_doubts(network, plan.image_names, boards, cameras)
    if len(weak) > MOST_WEAK:
        weak = [*weak[:MOST_WEAK], f"{len(weak) - MOST_WEAK} more combinations of unknowns are hardly determined"]
    return [
        *_targets(found),
        *weak,
        *doubts,
        *_narrow_boards(found, boards),
        *_hardly_named(found),
        *_control(found),
        *_directions(found),
    ]


def _targets(found: Prediction) -> list[str]:
    """Check targets that are not measured, or hardly."""
    marks = found.job.world.marks
    wanted = marks.code[(marks.board < 0) & (marks.code > 0)]
    missing = np.setdiff1d(wanted, found.code)
    rays, code = found.rays, found.code
    few, narrow = code[rays < FEW_RAYS], code[(rays >= FEW_RAYS) & (found.angle_deg < NARROW_DEG)]
    return [
        f"{what}: {_listed(codes)}"
        for what, codes in (
            ("targets that fewer than two stations see, which will not be measured", missing),
            (f"targets seen by fewer than {FEW_RAYS} stations, where no ray controls another", few),
            (f"targets whose rays meet within {NARROW_DEG:g} degrees, with poor depth", narrow),
        )
        if len(codes)
    ]


def _listed(codes: np.ndarray) -> str:
    shown = ", ".join(f"{code % TIME} at time {code // TIME}" if code > TIME else str(code) for code in codes[:NAMED])
    return f"{shown} and {len(codes) - NAMED} more" if len(codes) > NAMED else shown


def _narrow_boards(found: Prediction, boards: tuple[str, ...]) -> list[str]:
    """Boards that are seen from nearly one direction."""
    network = found.adjustment.network
    board = network.point_board[network.point]
    origin = network.camera_from_datum().origin_mm
    notes = []
    for k, name in enumerate(boards):
        images = np.unique(network.image[board == k])
        middle = network.datum_mm(np.flatnonzero(network.point_board == k)).mean(axis=0)
        ray = origin[images] - middle
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        widest = float(np.degrees(np.arccos(np.clip((ray @ ray.T).min(initial=1.0), -1, 1))))
        if len(images) > 1 and widest < NARROW_DEG:
            notes.append(f"board '{name}' is seen only within {widest:.0f} degrees ({len(images)} images)")
    return notes


def _hardly_named(found: Prediction) -> list[str]:
    """Boards that show so few codes in an image that detection may not tell which they are."""
    plan, marks = found.planned, found.job.world.marks
    mark, image = found.job.expected.mark[plan.row], found.job.expected.station[plan.row]
    coded = (marks.board[mark] >= 0) & (marks.code[mark] > 0)
    pairs, codes = np.unique(np.column_stack([image, marks.board[mark]])[coded], axis=0, return_counts=True)
    few = pairs[codes <= LEAST_CODES]
    if not len(few):
        return []
    named = [f"'{found.job.field.boards[b].name}' in '{found.job.images[i]}'" for i, b in few[:NAMED]]
    more = f" and {len(few) - NAMED} more" if len(few) > NAMED else ""
    return [f"boards that show {LEAST_CODES} codes only, too few if one is misread: {', '.join(named)}{more}"]


def _control(found: Prediction) -> list[str]:
    """Errors that nothing would show."""
    notes = []
    if count := int(found.reliability.uncontrolled.sum()):
        notes.append(f"{count} observation(s) are controlled by no other: their errors would show in no residual")
    bars, used = found.job.field.scale_bars, set(found.planned.bars)
    lost = list(dict.fromkeys(f"'{bar.name}'" for bar in bars if found.rows(bar.codes) is None))
    if lost:
        more = f" and {len(lost) - NAMED} more" if len(lost) > NAMED else ""
        notes.append(
            f"scale bars of which fewer than two stations see an end, which give and check no scale: "
            f"{', '.join(lost[:NAMED])}{more}"
        )
    if not any(bar.role == "check" and found.rows(bar.codes) is not None for bar in bars):
        control = [bar for bar in bars if bar.role == "control" and bar.name in used]
        rests = "on one control bar" if len(control) == 1 else "on the prints" if not control else ""
        if rests:
            notes.append(f"the scale rests {rests}, and no check bar would show that it is wrong")
    return notes


def weak_axes(found: Prediction) -> list[dict]:
    """The axes of the mean error ellipsoid of all points, weakest first: `direction` (3,) in the datum frame and
    `u_rms_mm` along it."""
    if not len(found.code):
        return []
    values, vectors = np.linalg.eigh(found.blocks.mean(axis=0))
    return [{"direction": vectors[:, k].tolist(), "u_rms_mm": float(np.sqrt(values[k]))} for k in (2, 1, 0)]


def _directions(found: Prediction) -> list[str]:
    axes = weak_axes(found)
    if not axes or axes[0]["u_rms_mm"] < UNEVEN * axes[2]["u_rms_mm"]:
        return []
    x, y, z = axes[0]["direction"]
    ratio = axes[0]["u_rms_mm"] / axes[2]["u_rms_mm"]
    return [
        f"points are known {ratio:.1f} times worse along ({x:.2f}, {y:.2f}, {z:.2f}) "
        "of the datum board than across: rays come from too narrow a cone about it"
    ]
