"""The page of `testfield plan`: maps of predicted uncertainty through the volume, warnings, and tables."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from testfield.plan.predict import Prediction
from testfield.plan.volume import Slice, slices_of
from testfield.report.pages import page

WIDTH = 560
"""Width of a map in its own units."""
EDGE = 46
TICKS = 5
MOST_ROWS = 60
COLOURS = 6
"""Steps of the legend."""


def plan_page(found: Prediction, card: dict[str, Any]) -> str:
    """The page as text."""
    slices = slices_of(found)
    values = np.concatenate([one.u_mm[np.isfinite(one.u_mm)] for one in slices])
    scale = _Scale.of(values)
    rows = sorted(card["points"]["points"], key=lambda row: -float(np.linalg.norm(row["u_mm"])))
    return page(
        "plan.html",
        card=card,
        description=found.job.scene.description,
        maps=[_map(found, one, scale) for one in slices] if len(values) else [],
        legend=scale.legend(),
        rows=rows[:MOST_ROWS],
        datum={row["board"]: row["u_rms_mm"] for row in card["datum"]["boards"]},
    )


@dataclass(frozen=True)
class _Scale:
    """Colours of uncertainties from `low` to `high` mm, by their logarithm."""

    low: float
    high: float

    @staticmethod
    def of(values: np.ndarray) -> "_Scale":
        if not len(values):
            return _Scale(1e-3, 1.0)
        low, high = (float(v) for v in np.percentile(values, [2, 97]))
        return _Scale(low, max(high, 1.05 * low))

    def colour(self, value: float) -> str:
        from matplotlib import colormaps
        from matplotlib.colors import to_hex

        part = np.log(max(value, 1e-12) / self.low) / np.log(self.high / self.low)
        return str(to_hex(colormaps["viridis"](float(np.clip(1 - part, 0, 1)))))

    def legend(self) -> list[tuple[str, str]]:
        """Colours and the uncertainties in mm that they stand for."""
        return [(self.colour(v), f"{v:.3g}") for v in np.geomspace(self.low, self.high, COLOURS)]


def _map(found: Prediction, one: Slice, scale: _Scale) -> dict[str, Any]:
    """What the template draws of a slice, in its own units: y points down."""
    world, a = found.job.world, list(one.axes)
    eyes = world.camera_from_world.origin_mm[:, a]
    cells = np.array([one.u_axis_mm[[0, -1]], one.v_axis_mm[[0, -1]]])
    low = np.minimum(eyes.min(axis=0), cells.min(axis=1))
    high = np.maximum(eyes.max(axis=0), cells.max(axis=1))
    pad = 0.04 * float((high - low).max())
    low, high = low - pad, high + pad
    unit = (WIDTH - EDGE) / float(high[0] - low[0])

    def put(xy: np.ndarray) -> np.ndarray:
        return np.column_stack([EDGE + unit * (xy[:, 0] - low[0]), unit * (high[1] - xy[:, 1])])

    du, dv = unit * (one.u_axis_mm[1] - one.u_axis_mm[0]), unit * (one.v_axis_mm[1] - one.v_axis_mm[0])
    u, v = np.meshgrid(one.u_axis_mm, one.v_axis_mm)
    at = put(np.column_stack([u.ravel(), v.ravel()]))
    size, rays = one.u_mm.ravel(), one.rays.ravel()
    weak = one.weak.reshape(-1, 2) * [1, -1]
    strokes = np.linalg.norm(weak, axis=1)
    longest = float(np.nanpercentile(strokes, 85)) if np.isfinite(strokes).any() else 1.0
    fields = []
    for k in np.flatnonzero(np.isfinite(size)):
        line = weak[k] / max(longest, strokes[k]) * 0.46 * min(du, dv)
        fields.append(
            {
                "x": at[k, 0] - du / 2,
                "y": at[k, 1] - dv / 2,
                "cx": at[k, 0],
                "cy": at[k, 1],
                "lx": line[0],
                "ly": line[1],
                "colour": scale.colour(float(size[k])),
                "said": f"{size[k]:.4f} mm, {rays[k]} images",
            }
        )
    outlines = []
    for sheet, R, t in zip(world.field.boards, world.world_from_board.R, world.world_from_board.t_mm, strict=True):
        xy = sheet.marks.xy_mm
        box = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * np.ptp(xy, axis=0) + xy.min(axis=0)
        corner = put((box @ R[:, :2].T + t)[:, a])
        outlines.append({"name": sheet.name, "at": put(t[None, a])[0].tolist(), "path": _path(corner)})
    points = world.mark_world_mm[(world.marks.board < 0) & (world.marks.code > 0)]
    R = world.camera_from_world.R[:, 2][:, a]  # the optical axes
    towards = R / np.maximum(np.linalg.norm(R, axis=1, keepdims=True), 1e-9) * [1, -1] * 16
    names = "xyz"
    return {
        "title": "Plan" if one.across == 2 else "Elevation",
        "slice": f"{names[one.across]} = {one.at_mm:.0f} mm",
        "width": WIDTH,
        "height": unit * float(high[1] - low[1]) + EDGE,
        "floor": unit * float(high[1] - low[1]),
        "du": du,
        "dv": dv,
        "fields": fields,
        "outlines": outlines,
        "points": put(points[:, a]).tolist(),
        "eyes": [
            {"x": x, "y": y, "tx": tx, "ty": ty, "name": name}
            for (x, y), (tx, ty), name in zip(put(eyes).tolist(), towards.tolist(), world.station_name, strict=True)
        ],
        "xticks": [(float(put(np.array([[v, low[1]]]))[0, 0]), f"{v / 1000:g}") for v in _ticks(low[0], high[0])],
        "yticks": [(float(put(np.array([[low[0], v]]))[0, 1]), f"{v / 1000:g}") for v in _ticks(low[1], high[1])],
        "axes": [f"{names[axis]}, m" for axis in a],
        "edge": EDGE,
    }


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers between two, about `TICKS` of them."""
    raw = (high - low) / TICKS
    power = 10 ** np.floor(np.log10(raw))
    step = power * next(f for f in (1, 2, 5, 10) if f * power >= raw)
    return [float(v) * step for v in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def _path(corners: np.ndarray) -> str:
    return "M" + "L".join(f"{x:.1f},{y:.1f}" for x, y in corners) + "Z"
