"""From pixels to unknowns: the chain rule of each observation, compiled."""

from typing import NamedTuple

import numpy as np

from testfield.store.compiled import compiled


class Places(NamedTuple):
    """Where everything stands, as the compiled functions take it. Of images: `station_R` (I, 3, 3), `station_t` (I, 3)
    and `member_R`, `member_t` of their cameras in the rig, `member` (I,). Of boards: `board_R` (B, 3, 3), `board_t`,
    their common `scale`, their `ways` (B, 6, w), of which each has `way_count` (B,). Of points: `mm` (n, 3), `board`
    (n,)."""

    station_R: np.ndarray
    station_t: np.ndarray
    member_R: np.ndarray
    member_t: np.ndarray
    member: np.ndarray
    board_R: np.ndarray
    board_t: np.ndarray
    ways: np.ndarray
    way_count: np.ndarray
    scale: float
    scale_free: bool
    mm: np.ndarray
    board: np.ndarray


@compiled
def at_cameras(image: np.ndarray, point: np.ndarray, places: Places) -> np.ndarray:
    """(m, 3) mm: points `point` (m,) in the frames of the cameras that took `image` (m,)."""
    answer, x, y = np.empty((len(image), 3)), np.empty(3), np.empty(3)
    for e in range(len(image)):
        i, p = image[e], point[e]
        b = places.board[p]
        for k in range(3):
            x[k] = places.mm[p, k] * (places.scale if b >= 0 else 1.0)
        if b >= 0:
            R, t = places.board_R[b], places.board_t[b]
            for k in range(3):
                y[k] = R[k, 0] * x[0] + R[k, 1] * x[1] + R[k, 2] * x[2] + t[k]
            x[:] = y
        R, t = places.station_R[i], places.station_t[i]
        for k in range(3):
            y[k] = R[k, 0] * x[0] + R[k, 1] * x[1] + R[k, 2] * x[2] + t[k]
        if places.member[i] > 0:
            R, t = places.member_R[i], places.member_t[i]
            for k in range(3):
                answer[e, k] = R[k, 0] * y[0] + R[k, 1] * y[1] + R[k, 2] * y[2] + t[k]
        else:
            answer[e] = y
    return answer


@compiled
def _turn(x: np.ndarray, y: np.ndarray, z: np.ndarray, row: np.ndarray, out: np.ndarray) -> None:
    """The lever (x, y, z) cross the derivative by its end: that by a small turn of it."""
    out[0] = y * row[2] - z * row[1]
    out[1] = z * row[0] - x * row[2]
    out[2] = x * row[1] - y * row[0]


@compiled
def _times(row: np.ndarray, R: np.ndarray, out: np.ndarray) -> None:
    for k in range(3):
        out[k] = row[0] * R[0, k] + row[1] * R[1, k] + row[2] * R[2, k]


@compiled
def chain(
    image: np.ndarray,
    point: np.ndarray,
    places: Places,
    white: np.ndarray,
    at_camera: np.ndarray,
    by_interior: np.ndarray,
    unknown: np.ndarray,
    by_camera: np.ndarray,
    by_unknown: np.ndarray,
    by_point: np.ndarray,
) -> None:
    """Of m observations: whitened derivatives `by_unknown` (m, 2, w) and `by_point` (m, 2, 3), filled in.

    `white` (m, 2, 2) whitens; `by_interior` (m, 2, p) and `by_camera` (m, 2, 3) are derivatives of pixels by the
    interior orientation, of which `unknown` (q,) are asked for, and by the point `at_camera` (m, 3). The columns are
    those parameters, the station's turn and shift, those of the rig's member, the board's ways, the scale.
    """
    six, station, datum, lever, turned = np.empty(6), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    camera, board = np.empty(3), np.empty(3)
    for e in range(len(image)):
        i, p = image[e], point[e]
        b, rig, mm = places.board[p], places.member[i] > 0, places.mm[p]
        if b >= 0:
            R = places.board_R[b]
            for k in range(3):
                lever[k] = places.scale * (
                    R[k, 0] * places.mm[p, 0] + R[k, 1] * places.mm[p, 1] + R[k, 2] * places.mm[p, 2]
                )
                board[k] = lever[k] + places.board_t[b, k]
        else:
            board[:] = mm
        R = places.station_R[i]
        for k in range(3):
            turned[k] = R[k, 0] * board[0] + R[k, 1] * board[1] + R[k, 2] * board[2]
        for axis in range(2):
            w0, w1, out = white[e, axis, 0], white[e, axis, 1], by_unknown[e, axis]
            for k in range(len(unknown)):
                out[k] = w0 * by_interior[e, 0, unknown[k]] + w1 * by_interior[e, 1, unknown[k]]
            for k in range(3):
                camera[k] = w0 * by_camera[e, 0, k] + w1 * by_camera[e, 1, k]
            at = len(unknown)
            if rig:
                _times(camera, places.member_R[i], station)
            else:
                station[:] = camera
            _turn(turned[0], turned[1], turned[2], station, out[at : at + 3])
            out[at + 3 : at + 6] = station
            at += 6
            if rig:
                x, y, z = at_camera[e, 0], at_camera[e, 1], at_camera[e, 2]
                t = places.member_t[i]
                _turn(x - t[0], y - t[1], z - t[2], camera, out[at : at + 3])
                out[at + 3 : at + 6] = camera
                at += 6
            _times(station, places.station_R[i], datum)
            if b < 0:
                by_point[e, axis] = datum
                continue
            _turn(lever[0], lever[1], lever[2], datum, six[:3])
            six[3:] = datum
            for way in range(places.way_count[b]):
                total = 0.0
                for k in range(6):
                    total += six[k] * places.ways[b, k, way]
                out[at] = total
                at += 1
            if places.scale_free:
                out[at] = (datum[0] * lever[0] + datum[1] * lever[1] + datum[2] * lever[2]) / places.scale
            _times(datum, places.board_R[b], by_point[e, axis])
            for k in range(3):
                by_point[e, axis, k] *= places.scale
