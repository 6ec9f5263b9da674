"""Skeletons of algorithms of one's own: one for each kind, each of which runs as it is."""

import keyword
from pathlib import Path

from testfield.errors import TestfieldError
from testfield.registry import names
from testfield.store.atomic import whole
from testfield.store.text import write_text

FINDER = """\"\"\"A finder of your own: where in an image there may be dots.\"\"\"

import cv2
import numpy as np

from testfield import register


@register("finders", "NAME")
def NAME(image_dn, sheet, smallest_px, largest_px, contrast=0.5):
    \"\"\"Bright spots of one threshold for the whole image.\"\"\"
    low, high = np.percentile(image_dn, (5, 99.5))
    mask = (image_dn > low + contrast * (high - low)).astype(np.uint8)
    _, label, stats, centres = cv2.connectedComponentsWithStats(mask)
    xy, moments = [], []
    for k in range(1, len(stats)):
        left, top, width, height, area = stats[k]
        if smallest_px**2 * 0.5 < area < largest_px**2 and max(width, height) < 6 * min(width, height):
            y, x = np.nonzero(label[top : top + height, left : left + width] == k)
            xy.append(centres[k])
            moments.append(np.cov(np.stack([x, y]), bias=True) + np.eye(2) / 12)
    return np.array(xy).reshape(-1, 2), np.array(moments).reshape(-1, 2, 2)
"""

CENTROID = """\"\"\"A centroid estimator of your own: the centres of dots whose places are known roughly.\"\"\"

import numpy as np

from testfield import register
from testfield.detect.centre import Centres


@register("centroids", "NAME")
def NAME(image_dn, sheet, xy_px, moments_px2, reach=1.6):
    \"\"\"Grey-value centroid of all pixels within `reach` half-axes.\"\"\"
    found = Centres.empty(len(xy_px))  # NaN, and ok = False
    height, width = image_dn.shape
    for k, (at, moments) in enumerate(zip(xy_px, moments_px2, strict=True)):
        half = int(np.ceil(2 * reach * np.sqrt(np.linalg.eigvalsh(moments)[1]))) + 2
        x0, y0 = np.rint(at).astype(int) - half
        if x0 < 0 or y0 < 0 or x0 + 2 * half >= width or y0 + 2 * half >= height:
            continue
        y, x = np.mgrid[y0 : y0 + 2 * half + 1, x0 : x0 + 2 * half + 1]
        off = np.stack([x - at[0], y - at[1]], axis=-1)
        q = np.sqrt(np.einsum("...i,ij,...j", off, np.linalg.inv(4 * moments), off))  # in half-axes
        values = image_dn[y, x].astype(float)
        black, white = np.median(values[(q > 1.3) & (q < reach)]), np.median(values[q < 0.6])
        weight = np.where(q < 1.4, np.clip(values - black, 0, None), 0)
        found.xy_px[k] = (weight * x).sum() / weight.sum(), (weight * y).sum() / weight.sum()
        found.moments_px2[k] = moments
        found.background_dn[k], found.contrast_dn[k] = black, white - black
        found.chi2[k], found.misfit[k] = 1.0, 0.0
        found.ok[k] = white > black
        # found.cov_px2[k] stays NaN: no uncertainty is stated.
    return found
"""

DECODER = """\"\"\"A decoder of your own: the numbers of the rings around dots.\"\"\"

from testfield import register
from testfield.detect.decode import decode


@register("decoders", "NAME")
def NAME(image_dn, xy_px, moments_px2, contrast_dn, background_dn, bits, radii):
    \"\"\"This project's own decoder: put yours in its place.\"\"\"
    code, _, _ = decode(image_dn, xy_px, moments_px2, contrast_dn, background_dn, bits, radii)
    return code  # (n,) whole numbers: 0 a dot without a ring, below 0 a ring that cannot be read
"""

DETECTOR = """\"\"\"A detector of your own: everything from a frame to named centres.\"\"\"

from dataclasses import replace

import numpy as np

from testfield import register
from testfield.detect.detect import detect


@register("detectors", "NAME")
def NAME(frame, field, centroid="star"):
    \"\"\"This project's own detector without its covariance: put yours in its place.\"\"\"
    found = detect(frame, field, centroid, 5.0)
    return replace(found, cov_px2=np.full_like(found.cov_px2, np.nan))  # no uncertainty is stated
"""

CALIBRATOR = """\"\"\"A calibrator of your own: camera, exterior orientations and boards from observations.\"\"\"

from dataclasses import replace

from testfield import register
from testfield.calibrate.zhang import zhang


@register("calibrators", "NAME")
def NAME(observations, field, width_px, height_px, lens="brown", hold=()):
    \"\"\"Zhang's calibration without its covariance: put yours in its place.\"\"\"
    found = zhang(observations, field, width_px, height_px, lens, hold)
    return replace(found, method="NAME", labels=(), covariance=found.covariance[:0, :0])  # none is stated
"""

RECONSTRUCTOR = """\"\"\"A reconstructor of your own: points from observations and a calibrated camera.\"\"\"

import numpy as np

from testfield import register
from testfield.reconstruct.estimate import Method, reconstruct


def weights(sights, rays, calibration):
    \"\"\"(n, k, 2, 2) of the lines of n points with up to k rays: near rays count more.\"\"\"
    weight = np.where(sights.there, 1 / np.maximum(rays.depth_mm, 1.0) ** 2, 0)
    return weight[..., None, None] * np.eye(2)


@register("reconstructors", "NAME")
def NAME(observations, calibration, field):
    \"\"\"Least squares along the rays; whatever the weights, the covariance follows from the gain.\"\"\"
    return reconstruct(observations, calibration, field, Method("NAME", weights))
"""

PROGRAM = """\"\"\"A program of your own, which knows nothing of testfield: python NAME.py IMAGE.pgm CENTRES.csv\"\"\"

import re
import sys

with open(sys.argv[1], "rb") as file:
    data = file.read()
width, height = map(int, re.match(rb"P5\\s+(\\d+)\\s+(\\d+)\\s+65535\\s", data).groups())
start = len(data) - 2 * width * height
grey = [data[k] << 8 | data[k + 1] for k in range(start, len(data), 2)]  # row by row, high byte first
threshold = (min(grey) + sorted(grey)[-len(grey) // 200]) / 2
left = {k for k, value in enumerate(grey) if value > threshold}
rows = []
while left:
    spot, todo = [], [left.pop()]
    while todo:
        k = todo.pop()
        spot.append(k)
        for other in (k - 1, k + 1, k - width, k + width):
            if other in left:
                left.remove(other)
                todo.append(other)
    if 12 < len(spot) < 20000:
        total = sum(grey[k] - threshold for k in spot)
        x = sum((grey[k] - threshold) * (k % width) for k in spot) / total
        y = sum((grey[k] - threshold) * (k // width) for k in spot) / total
        rows.append(f"{x:.4f},{y:.4f}")  # the centre of the top-left pixel is (0, 0)
with open(sys.argv[2], "w") as file:
    print("x_px,y_px", *rows, sep="\\n", file=file)
"""

SKELETONS = {
    "finder": FINDER,
    "centroid": CENTROID,
    "decoder": DECODER,
    "detector": DETECTOR,
    "calibrator": CALIBRATOR,
    "reconstructor": RECONSTRUCTOR,
    "program": PROGRAM,
}


def write_skeleton(name: str, kind: str, folder: Path) -> list[Path]:
    """Write `folder`/NAME.py, an algorithm of that kind, and NAME.toml, the recipe that uses it.

    Raises `TestfieldError` where the name is none, is taken, or one of the files is there already.
    """
    if not name.isidentifier() or keyword.iskeyword(name):
        raise TestfieldError(f"'{name}' is no name of a function", "NAME", "use letters, digits and _")
    if kind != "program" and name in names(f"{kind}s"):
        raise TestfieldError(f"a {kind} called '{name}' is there already", "NAME", "give yours another name")
    files = [folder / f"{name}.py", folder / f"{name}.toml"]
    for path in files:
        if path.exists():
            raise TestfieldError("this file is there already", str(path), "give another NAME or --out")
    if kind == "program":
        recipe = f'[detector]\ncommand = "python {name}.py {{pgm}} {{csv}}"\n'
    else:
        recipe = f'load = "{name}.py"\n\n[{kind}]\nname = "{name}"\n'
    for path, text in zip(files, (SKELETONS[kind].replace("NAME", name), recipe), strict=True):
        with whole(path) as part:
            write_text(part, text)
    return files
