"""Connected bright pixels as runs along the rows: few numbers instead of all pixels of an image."""

from dataclasses import dataclass

import numpy as np

from testfield.store.compiled import compiled

ALL_DARK, ALL_BRIGHT = np.uint64(0), np.uint64(0x0101010101010101)
"""Eight pixels of a row's mask in one word."""


@dataclass(frozen=True)
class Sums:
    """What the pixels of n blobs sum up to: `area` in pixels; `left`, `top`, `right`, `bottom` of the smallest upright
    box, the latter two just outside; centre `x`, `y` and second moments `xx`, `xy`, `yy`, where a pixel is a square,
    not a point."""

    area: np.ndarray
    left: np.ndarray
    top: np.ndarray
    right: np.ndarray
    bottom: np.ndarray
    x: np.ndarray
    y: np.ndarray
    xx: np.ndarray
    xy: np.ndarray
    yy: np.ndarray


@dataclass(frozen=True)
class Runs:
    """Runs of pixels, m rows in the order of the image: `blob` (m,) to which blob each belongs, its `row`, its `first`
    column and its `length`. Pixels that share an edge belong to one blob."""

    blob: np.ndarray
    row: np.ndarray
    first: np.ndarray
    length: np.ndarray

    def sums(self) -> Sums:
        """All blobs in the order of their first runs."""
        whole, parts = _sums(self.blob, self.row, self.first, self.length, int(self.blob.max(initial=-1)) + 1)
        return Sums(*whole.T, *parts.T)


def runs_above(image: np.ndarray, half_size: np.ndarray, width: int, noise: tuple[float, float, float]) -> Runs:
    """Runs of pixels of an image (h, w) that exceed the mean of their neighbourhood by its noise.

    `half_size` is the image halved, in which the means of `width` by `width` pixels (an odd number) are taken; at the
    borders it is continued as in a mirror. `noise` is how much a pixel must exceed a mean: the root of the first
    number, plus the second times by how much the mean exceeds the third, if that is positive. Between the halved
    image's pixels the threshold is interpolated linearly, and outermost pixels have that of their neighbours.
    """
    h, w = image.shape
    runs, m = _runs(
        np.ascontiguousarray(image, np.float32),
        np.ascontiguousarray(half_size[: max(h // 2, 1), : max(w // 2, 1)], np.float32),
        width,
        np.array(noise, np.float32),
    )
    return Runs(*runs[:, :m].copy())


@compiled
def _runs(image: np.ndarray, half: np.ndarray, width: int, noise: np.ndarray) -> tuple[np.ndarray, int]:
    """Blob, row, first column and length (4, m or more), and m. In one pass from top to bottom, so that what is in use
    stays in the processor's cache."""
    h, w = image.shape
    rows, columns = half.shape
    reach = width // 2
    sums = np.zeros(columns)
    for k in range(-reach, reach + 1):
        _add(sums, half[_mirrored(k, rows)], 1.0)
    scratch = np.empty((2, columns + 2 * width), np.float32)
    threshold = np.empty((3, columns + 2), np.float32)
    full = np.empty(2 * columns + 2, np.float32)
    mask = np.zeros((w // 8 + 1) * 8, np.uint8)
    words = mask.view(np.uint64)

    runs = np.empty((4, 1024 + w), np.int64)
    m, above, here = 0, 0, 0  # how many there are; where those of the row above and of this row begin
    _threshold(sums, width, noise, scratch, threshold[0])
    for j in range(rows):
        if j + 1 < rows:
            _add(sums, half[_mirrored(j + 1 + reach, rows)], 1.0)
            _add(sums, half[_mirrored(j - reach, rows)], -1.0)
            _threshold(sums, width, noise, scratch, threshold[(j + 1) % 3])
        for r in range(2 * j, 2 * j + 2 if j + 1 < rows else h):
            if r < 2 * j + 2:  # else an odd last row, which has the threshold of the one before
                beside = max(j - 1, 0) if r == 2 * j else min(j + 1, rows - 1)
                _between(threshold[j % 3], threshold[beside % 3], scratch[0], full)
            _compare(image[r], full, mask)
            if m + w > runs.shape[1]:
                runs = _longer(runs, m, 2 * runs.shape[1] + w)
            above, here = here, m
            m = _note(mask, words, r, runs, m)
            _join(runs, above, here, m)
    _number(runs[0], m)
    return runs, m


@compiled
def _longer(runs: np.ndarray, m: int, length: int) -> np.ndarray:
    longer = np.empty((4, length), np.int64)
    for k in range(4):
        for i in range(m):
            longer[k, i] = runs[k, i]
    return longer


@compiled
def _mirrored(k: int, count: int) -> int:
    """Which row of `count` stands for row `k`, which may lie outside by no more than there are."""
    return -1 - k if k < 0 else (2 * count - 1 - k if k >= count else k)


@compiled
def _add(sums: np.ndarray, row: np.ndarray, sign: float) -> None:
    for c in range(len(sums)):
        sums[c] += sign * row[c]


@compiled
def _threshold(sums: np.ndarray, width: int, noise: np.ndarray, scratch: np.ndarray, out: np.ndarray) -> None:
    """A row of means of `width` sums each, with what noise may add; its ends are repeated once more."""
    columns, reach, one = len(sums), width // 2, np.float32(1.0)
    line, other, box = scratch[0], scratch[1], out[1 : len(sums) + 1]
    inner = line[reach:]
    for c in range(columns):
        inner[c] = sums[c]
        box[c] = 0
    for k in range(reach):
        line[k] = line[2 * reach - 1 - k]
        line[columns + reach + k] = line[columns + reach - 1 - k]
    # Sums of 1, 2, 4 ... neighbours, of which the width's binary digits tell which to take.
    size, step, taken = columns + 2 * reach, 1, 0
    while True:
        if width & step:
            _add(box, line[taken:], one)
            taken += step
        if taken == width:
            break
        size -= step
        _pairs(line, line[step:], other[:size])
        line, other = other, line
        step *= 2
    base, slope, zero, scale = noise[0], noise[1], noise[2], np.float32(1.0 / (width * width))
    for c in range(columns):
        mean = scale * box[c]
        box[c] = mean + np.sqrt(base + max(slope * (mean - zero), np.float32(0.0)))
    out[0], out[columns + 1] = out[1], out[columns]


@compiled
def _pairs(line: np.ndarray, behind: np.ndarray, out: np.ndarray) -> None:
    for c in range(len(out)):
        out[c] = line[c] + behind[c]


@compiled
def _between(near: np.ndarray, far: np.ndarray, line: np.ndarray, full: np.ndarray) -> None:
    """A row of the image between two rows of the halved one, three times as near to the first."""
    most, least = np.float32(0.75), np.float32(0.25)
    columns = len(near) - 2
    for c in range(columns + 2):
        line[c] = most * near[c] + least * far[c]
    for c in range(columns):
        full[2 * c] = most * line[c + 1] + least * line[c]
        full[2 * c + 1] = most * line[c + 1] + least * line[c + 2]
    full[2 * columns] = full[2 * columns - 1]


@compiled
def _compare(row: np.ndarray, threshold: np.ndarray, mask: np.ndarray) -> None:
    for c in range(len(row)):
        mask[c] = row[c] > threshold[c]


@compiled
def _note(mask: np.ndarray, words: np.ndarray, row: int, runs: np.ndarray, m: int) -> int:
    """Write the row's runs behind the m there are, each as a blob of its own, and tell how many there are then. The
    mask ends with a dark pixel."""
    inside = False
    for k in range(len(words)):
        if words[k] == (ALL_BRIGHT if inside else ALL_DARK):
            continue
        for c in range(8 * k, 8 * k + 8):
            if (mask[c] != 0) != inside:
                inside = not inside
                if inside:
                    runs[0, m], runs[1, m], runs[2, m] = m, row, c
                else:
                    runs[3, m] = c - runs[2, m]
                    m += 1
    return m


@compiled
def _join(runs: np.ndarray, above: int, here: int, end: int) -> None:
    """Give the runs of a row, `here` to `end`, the blobs of those `above` them that they touch: of two blobs the later
    one is led to the earlier one."""
    blob, first, length = runs[0], runs[2], runs[3]
    low, high = above, here
    while low < high and here < end:
        if first[low] < first[here] + length[here] and first[here] < first[low] + length[low]:
            a, b = _root(blob, low), _root(blob, here)
            blob[max(a, b)] = min(a, b)
        if first[low] + length[low] < first[here] + length[here]:
            low += 1
        else:
            here += 1


@compiled
def _root(blob: np.ndarray, k: int) -> int:
    while blob[k] != k:
        blob[k] = blob[blob[k]]
        k = blob[k]
    return k


@compiled
def _number(blob: np.ndarray, m: int) -> None:
    """Blobs numbered in the order of their first runs; every run led to an earlier one of its blob until now."""
    n = 0
    for k in range(m):
        if blob[k] == k:
            blob[k] = n
            n += 1
        else:
            blob[k] = blob[blob[k]]


@compiled
def _sums(
    blob: np.ndarray, row: np.ndarray, first: np.ndarray, length: np.ndarray, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """Area and box (n, 5), centre and second moments (n, 5), in the order of `Sums`."""
    whole, parts = np.zeros((n, 5), np.int64), np.zeros((n, 5))
    for k in range(len(blob)):
        b, c, end = blob[k], first[k], first[k] + length[k]
        if whole[b, 0] == 0:
            whole[b, 1], whole[b, 2] = c, row[k]
        whole[b, 0] += length[k]
        whole[b, 1], whole[b, 3], whole[b, 4] = min(whole[b, 1], c), max(whole[b, 3], end), row[k] + 1
        parts[b, 0] += length[k] * (0.5 * (c + end - 1))
        parts[b, 1] += length[k] * row[k]
    for b in range(n):
        parts[b, 0] /= whole[b, 0]
        parts[b, 1] /= whole[b, 0]
    for k in range(len(blob)):
        b, count = blob[k], float(length[k])
        dx, dy = first[k] + 0.5 * (count - 1) - parts[b, 0], row[k] - parts[b, 1]
        parts[b, 2] += count * (dx * dx + (count * count - 1) / 12)  # the latter of a run about its own middle
        parts[b, 3] += count * dx * dy
        parts[b, 4] += count * dy * dy
    for b in range(n):
        for j in range(2, 5):
            parts[b, j] = parts[b, j] / whole[b, 0] + (0.0 if j == 3 else 1 / 12)
    return whole, parts
