"""Rings of any shape: named, rendered, read and measured as those of the usual shape are."""

import cv2
import numpy as np
import pytest

from testfield.bench.bound import cramer_rao
from testfield.bench.dots import Case, render_dots
from testfield.camera.photograph import photograph_of
from testfield.detect.bright import bright_marks
from testfield.detect.detect import measure_targets
from testfield.detect.observations import MEASURED
from testfield.detect.photograph import Found, detect_in_photograph
from testfield.detect.target_spec import parse_target
from testfield.sensor.expose import expose
from testfield.targets.marks import ring_radii, shape_name
from testfield.targets.ring_code import code_words

SHAPES = ("1:1.6:2.4", "1:2:3", "1:2.5:4", "1:3:4.5")
QUICK = {("1:1.6:2.4", 14), ("1:2.5:4", 10), ("1:3:4.5", 12)}


@pytest.mark.parametrize("shape", ["2:4:6", "1:2:3.0", "0.5:1:1.5"])
def test_a_shape_is_brought_to_a_dot_of_one(shape: str) -> None:
    assert shape_name(ring_radii(shape)) == "1:2:3"


@pytest.mark.parametrize(
    "shape", ["", "1:2", "1:2:x", "0:2:3", "-1:2:3", "1:1.2:3", "1:3:2", "1:2:2.1", "1:2:9", "1:nan:3", "inf:2:3"]
)
def test_what_is_no_shape_is_refused(shape: str) -> None:
    with pytest.raises(ValueError, match=r"[a-z]"):
        ring_radii(shape)


@pytest.mark.parametrize(
    ("shape", "bits"),
    [
        pytest.param(shape, bits, marks=() if (shape, bits) in QUICK else pytest.mark.slow)
        for shape in SHAPES
        for bits in (10, 12, 14)
    ],
)
def test_rendered_rings_of_any_shape_are_read_and_measured_at_the_bound(shape: str, bits: int) -> None:
    dots = render_dots(Case(diameter_px=14, tilt_deg=25, coded=True, bits=bits, radii=shape), 3, 4)
    bound, _ = cramer_rao(dots)
    frame = expose(dots.radiance, dots.sensor, 5)
    image, sheet = bright_marks(frame, True)
    found = measure_targets(image, sheet, "forward_model", 5.0, bits, ring_radii(shape))
    mine = np.flatnonzero((found.status == MEASURED) & (found.code > 0))
    code, xy = found.code[mine], found.xy_px[mine]
    away = np.linalg.norm(dots.xy_px[:, None] - xy[None], axis=2)
    nearest = away.argmin(axis=1)
    assert len(mine) == len(dots.world.marks), found.status
    assert code[nearest].tolist() == dots.world.marks.code.tolist()
    error = xy[nearest] - dots.xy_px
    # 128 coordinates scatter by 6 percent.
    assert np.sqrt((error**2).sum() / np.einsum("nii->", bound)) < 1.2
    cov = found.cov_px2[mine][nearest]
    assert 0.7 < np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error).mean() / 2 < 1.35


def drawn(
    shape: tuple[float, float], dot_px: float = 16.0, hole: float = 0.0, sharpen: float = 0.0, jpeg: int = 0
) -> np.ndarray:
    """Nine codes of 14 bits as a camera's JPEG shows them, dark on white; sharpened by a part of what blur takes."""
    fine, words = 6, code_words(14)[[3, 50, 120, 300, 400, 500, 30, 222, 444]]
    pitch = int(dot_px * (shape[1] + 1.3))
    y, x = (np.mgrid[0 : pitch * fine, 0 : pitch * fine] + 0.5) / fine - pitch / 2 - 0.3
    r, turn = np.hypot(x, y) / (dot_px / 2), (np.arctan2(y, x) + 0.3) % (2 * np.pi) / (2 * np.pi) * 14
    ink = [
        ((r < 1) & (r >= hole))
        | ((r > shape[0]) & (r < shape[1]) & (int(word) >> (13 - np.minimum(turn.astype(int), 13)) & 1 == 1))
        for word in words
    ]
    whole = np.block([[part.astype(np.float32) for part in ink[k : k + 3]] for k in (0, 3, 6)])
    side = 3 * pitch
    image = cv2.GaussianBlur(whole, (0, 0), 0.7 * fine).reshape(side, fine, side, fine).mean(axis=(1, 3))
    image = 210 - 170 * image + np.random.default_rng(0).normal(0, 1, image.shape)
    image += sharpen * (image - cv2.GaussianBlur(image, (0, 0), 1.2))
    pixels = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return cv2.imdecode(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, jpeg])[1], 0) if jpeg else pixels


def seen(image: np.ndarray, radii: str, target: str = "ring14") -> Found:
    return detect_in_photograph(photograph_of("it", image), parse_target(target), radii)


@pytest.mark.parametrize(
    "state",
    [
        {"hole": 0.25},
        {"sharpen": 1.0, "jpeg": 60},
        {"sharpen": 0.6, "jpeg": 75, "dot_px": 12},
        {"hole": 0.3, "sharpen": 0.6, "jpeg": 80},
    ],
)
@pytest.mark.parametrize("shape", [(2.0, 3.0), (2.6, 3.9)])
def test_a_hole_and_sharpening_are_no_disturbance(shape: tuple[float, float], state: dict) -> None:
    asked = "1:2:3" if shape[0] == 2 else "1:2.5:4"
    o = seen(drawn(shape, **state), asked).observations
    assert ((o.status == MEASURED) & (o.code > 0)).sum() == 9
    assert len(np.unique(o.code[o.code > 0])) == 9


def test_a_shape_that_is_not_as_told_is_measured_and_named() -> None:
    found = seen(drawn((2.7, 4.0), 24), "1:2.5:4")
    o = found.observations
    assert ((o.status == MEASURED) & (o.code > 0)).sum() == 9
    told = [note for note in found.notes if note.startswith("the rings are 1:")]
    inner, outer = (float(v) for v in told[0].split(",")[0].split(":")[1:])
    assert abs(inner - 2.7) < 0.03
    assert abs(outer - 4.0) < 0.03


def test_where_nothing_is_read_the_shape_that_would_be_is_proposed() -> None:
    image = drawn((1.6, 2.4), 20)
    found = seen(image, "1:2.5:4")
    assert not (found.observations.code > 0).any()
    told = [note for note in found.notes if "--radii 1:1.6:2.4 reads 9 numbers" in note]
    assert told, found.notes


def test_a_segment_that_is_hidden_in_a_sharpened_picture_is_not_believed() -> None:
    image = drawn((2.0, 3.0), 16, sharpen=1.0, jpeg=60)
    pitch = image.shape[0] // 3
    middle = pitch + pitch // 2
    clean = seen(image, "1:2:3").observations
    right = {int(c) for c in clean.code[(clean.status == MEASURED) & (clean.code > 0)]}
    for angle in np.radians([0, 40, 95, 150, 215, 280, 330]):
        spoilt = image.copy()
        at = (int(middle + 20 * np.cos(angle)), int(middle + 20 * np.sin(angle)))
        cv2.circle(spoilt, at, 5, 20, -1)
        o = seen(spoilt, "1:2:3").observations
        told = {int(c) for c in o.code[(o.status == MEASURED) & (o.code > 0)]}
        assert told <= right, angle
        assert len(told) >= 8
