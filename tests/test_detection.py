"""Detection on the quick scene's rendered frames, and on synthetic ones where the answer is known exactly."""

import numpy as np
import pytest

from testfield.camera.images import Frame, SensorSheet
from testfield.chain.run import Run
from testfield.detect.centre_grey import grey_centroid
from testfield.detect.centre_model import ellipse_model
from testfield.detect.detect import detect
from testfield.detect.observations import Observations

SHEET = SensorSheet(2.6, 2.3, 64.0, 12)


def frame_of(quick: Run, station: int = 0) -> Frame:
    return Frame.load(quick.folder / f"frames/{quick.stations[station]}.png")


def test_codes_are_read_clockwise(quick: Run) -> None:
    frame = frame_of(quick)
    right = detect(frame, quick.field, "ellipse_model", 5.0).measured
    mirrored = Frame(frame.station, np.ascontiguousarray(frame.pixels_dn[:, ::-1]), frame.sheet)
    wrong = detect(mirrored, quick.field, "ellipse_model", 5.0).measured
    assert (right.code > 0).sum() >= 25
    # In a mirror most codes are other numbers, and no board's layout carries them.
    assert (wrong.board >= 0).sum() == 0


def test_black_on_white_is_the_same_upside_down(quick: Run) -> None:
    from dataclasses import replace

    frame = frame_of(quick)
    inverted = Frame(frame.station, (4095 - frame.pixels_dn.astype(int)).astype(np.uint16), frame.sheet)
    white = detect(frame, quick.field, "ellipse_model", 5.0).measured
    black = detect(inverted, replace(quick.field, white_on_black=False), "ellipse_model", 5.0).measured
    assert abs(len(black) - len(white)) <= 5
    assert (black.board >= 0).sum() >= 0.98 * (white.board >= 0).sum()


def test_a_code_that_contradicts_its_board_is_refused() -> None:
    from testfield.detect.identify import identify
    from testfield.targets.field import Field, NominalBoard
    from testfield.targets.marks import Marks

    xy = np.stack(np.meshgrid(np.arange(4) * 100.0, np.arange(3) * 100.0), -1).reshape(-1, 2)
    board = NominalBoard("A", Marks(xy, np.full(12, 20.0), np.arange(1, 13)), 0.01, 0.0)
    codes = np.arange(1, 13)
    codes[[2, 7]] = codes[[7, 2]]
    none = np.full((12, 2, 2), np.nan)
    found, _, reason = identify(xy * 0.7 + 50, codes, none, Field(14, (board,)))
    assert (found == -1).nonzero()[0].tolist() == [2, 7]
    assert reason[2] == reason[7] == "code contradicts its board's layout"


def disc(centre: tuple, axes: tuple, angle: float, sigma: float, size: int = 64) -> np.ndarray:
    """A blurred elliptic disc, 0 to 1, integrated by brute force over 16 x 16 points a pixel."""
    from scipy.ndimage import gaussian_filter

    n = 16
    at = (np.arange(size * n) + 0.5) / n - 0.5
    x, y = np.meshgrid(at - centre[0], at - centre[1])
    c, s = np.cos(angle), np.sin(angle)
    fine = (((c * x + s * y) / axes[0]) ** 2 + ((-s * x + c * y) / axes[1]) ** 2 < 1).astype(float)
    return gaussian_filter(fine, sigma * n).reshape(size, n, size, n).mean((1, 3))


@pytest.mark.parametrize("axes", [(4.0, 4.0), (7.0, 7.0), (9.0, 5.0), (12.0, 5.0)])
def test_the_ellipse_model_is_unbiased_and_says_its_own_uncertainty(axes: tuple) -> None:
    rng = np.random.default_rng(int(10 * axes[0] + axes[1]))
    errors, claims = [], []
    for _ in range(8):
        centre = 31.5 + rng.uniform(-0.5, 0.5, 2)
        mean_e = 300 + 6500 * disc(tuple(centre), axes, 0.5, 0.6)
        c, s = np.cos(0.5), np.sin(0.5)
        turn = np.array([[c, -s], [s, c]])
        moments = turn @ np.diag(np.square(axes)) @ turn.T / 4
        for _ in range(25):
            e = rng.poisson(mean_e) + 2.3 * rng.standard_normal(mean_e.shape)
            image = np.rint(e / 2.6 + 64).astype(np.float32)
            fit = ellipse_model(image, SHEET, np.rint(centre)[None], moments[None])
            assert fit.ok[0]
            errors.append(fit.xy_px[0] - centre)
            claims.append(fit.cov_px2[0])
    error, claim = np.array(errors), np.array(claims)
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(claim), error).mean() / 2
    assert 0.8 < nees < 1.25  # 400 degrees of freedom, and a little for the model
    assert np.abs(error.mean(axis=0)).max() < 4 * np.sqrt(claim[:, 0, 0].mean() / len(error)) + 2e-4


def test_the_ellipse_model_beats_the_grey_centroid() -> None:
    rng = np.random.default_rng(4)
    errors: dict[str, list] = {"model": [], "grey": []}
    for _ in range(40):
        centre = 31.5 + rng.uniform(-0.5, 0.5, 2)
        mean_e = 300 + 3000 * disc(tuple(centre), (6, 6), 0, 0.6)
        image = np.rint(rng.poisson(mean_e) / 2.6 + 64).astype(np.float32)
        for name, estimate in (("model", ellipse_model), ("grey", grey_centroid)):
            errors[name].append(estimate(image, SHEET, np.rint(centre)[None], 9 * np.eye(2)[None]).xy_px[0] - centre)
    rms = {name: np.sqrt(np.mean(np.square(e))) for name, e in errors.items()}
    assert rms["model"] < 0.8 * rms["grey"]


@pytest.mark.parametrize("white_on_black", [pytest.param(True, marks=pytest.mark.slow), False])
def test_a_mosaic_is_measured_like_a_grey_image_and_says_its_own_uncertainty(white_on_black: bool) -> None:
    from dataclasses import replace

    from testfield.detect.detect import bright_marks
    from testfield.sensor.patterns import filter_pattern

    rng = np.random.default_rng(12)
    colours = filter_pattern((64, 64), "RGGB", (0.5, 1.0, 0.65))
    nees, taken_for_grey = [], []
    for _ in range(80):
        centre = 31.5 + rng.uniform(-0.5, 0.5, 2)
        shape = disc(tuple(centre), (9, 7), 0.5, 0.7)
        light = 300 + 6500 * (shape if white_on_black else 1 - shape)
        dn = rng.poisson(light * colours) / 2.6 + 64 + 0.9 * rng.standard_normal(shape.shape)
        for sheet in (replace(SHEET, bayer="RGGB"), SHEET):
            image, noise = bright_marks(Frame("s", np.rint(dn).astype(np.uint16), sheet), white_on_black)
            fit = ellipse_model(image, noise, np.rint(centre)[None], np.diag([81, 49])[None] / 4.0)
            if not sheet.bayer:
                taken_for_grey.append(fit.chi2[0])
                continue
            assert fit.ok[0]
            assert 0.7 < fit.chi2[0] < 1.4
            error = fit.xy_px[0] - centre
            nees.append(error @ np.linalg.solve(fit.cov_px2[0], error) / 2)
    assert 0.7 < np.mean(nees) < 1.4  # 160 degrees of freedom
    assert np.median(np.nan_to_num(taken_for_grey, nan=np.inf)) > 10  # a chequered image fits no dot


@pytest.mark.parametrize("image", ["black", "white", "noise", "tiny"])
def test_nothing_to_see_gives_an_empty_result(quick: Run, image: str) -> None:
    rng = np.random.default_rng(1)
    pixels = {
        "black": np.full((300, 400), 64, np.uint16),
        "white": np.full((300, 400), 4095, np.uint16),
        "noise": rng.normal(500, 14, (300, 400)).astype(np.uint16),
        "tiny": np.full((1, 1), 64, np.uint16),
    }[image]
    assert len(detect(Frame("s", pixels, SHEET), quick.field, "ellipse_model", 5.0).measured) == 0


def test_observations_survive_their_file(quick: Run, tmp_path) -> None:  # type: ignore[no-untyped-def]
    a = Observations.load(quick.folder / "observations.parquet")
    a.save(tmp_path / "o.parquet")
    b = Observations.load(tmp_path / "o.parquet")
    for name in ("xy_px", "cov_px2", "moments_px2", "code", "board", "point", "status", "station"):
        assert np.array_equal(
            getattr(a, name), getattr(b, name), equal_nan=name in ("xy_px", "cov_px2", "moments_px2", "chi2")
        )
    assert a.stations == b.stations
