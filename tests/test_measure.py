"""Photographs measured without any scene: field files, dots without a code, real photographs."""

import json
import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from test_self_calibration import CAMERA, SIGMA_PX, calibrated, fitted, scene, ties_of

from testfield.calibrate.certified import Certified
from testfield.calibrate.misfit import NO_MISFIT
from testfield.calibrate.self_calibration import free_network
from testfield.calibrate.stitched import stitched
from testfield.camera.pose import Poses
from testfield.camera.project import project
from testfield.chain.run import Run
from testfield.cli.main import main
from testfield.detect.circle_grid import order_grid
from testfield.detect.observations import MEASURED, Observations
from testfield.detect.photograph import Found
from testfield.detect.target_spec import TargetSpec, parse_target
from testfield.errors import TestfieldError
from testfield.measure.certified import certified_of
from testfield.measure.photographs import measure, with_dots
from testfield.reconstruct.points import Points
from testfield.reconstruct.uncoded import match_dots
from testfield.score.align import rigid_fit
from testfield.targets.field import Field, NominalBoard
from testfield.targets.field_file import FieldFile, load_field_file
from testfield.targets.marks import Marks
from testfield.uncertainty.halves import NO_HALVES

FIELDS = Path(__file__).parents[1] / "scenes/fields"
REAL = Path(__file__).parents[1] / "../shared/real"
real = pytest.mark.skipif(not REAL.is_dir(), reason="the real photographs (../shared/real) are not here")
RING = {"target": {"kind": "ring14"}}


@pytest.fixture
def whole_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """The halves of the images are not measured too: they take six times as long, and only some tests ask them."""
    room = import_module("testfield.measure.photographs")  # by its path, `testfield.measure` is the function
    monkeypatch.setattr(room, "compare_halves", lambda *_: NO_HALVES)


def observations_of(noise_px: float = SIGMA_PX, coded: int = 20, seed: int = 0) -> tuple[Observations, list[Found]]:
    """Of the scene of `test_self_calibration`, with 60 points of which only the first have codes."""
    truth = scene(points=60)
    ties = ties_of(truth, noise_px, seed)
    code = np.where(ties.point < coded, 1 + ties.point, 0)
    n = len(code)
    depth = truth.stations[truth.image].apply(truth.point_mm[truth.point])[:, 2]
    moments = (0.5 * 10.0 * 4000 / depth)[:, None, None] ** 2 * np.eye(2)
    whole = Observations(
        stations=ties.stations,
        station=ties.image,
        xy_px=ties.xy_px,
        cov_px2=ties.cov_px2,
        moments_px2=moments,
        code=code,
        board=np.full(n, -1),
        point=ties.point,
        chi2=np.ones(n),
        status=np.full(n, MEASURED, object),
        centre_of_disc=False,
    )
    found = [
        Found(
            replace(part, stations=(name,), station=np.zeros(len(part), int), point=np.full(len(part), -1)),
            np.full((len(part), 2), -1),
            (),
        )
        for k, name in enumerate(ties.stations)
        for part in [whole.take(ties.image == k)]
    ]
    return whole, found


def field(**parts: object) -> FieldFile:
    return FieldFile.model_validate(RING | parts)


def test_dots_without_a_code_are_named_by_their_rays_and_join_the_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("testfield.uncertainty.halves.SPLITS", 1)
    truth = scene(points=60)
    whole, found = observations_of()
    length = float(np.linalg.norm(truth.point_mm[0] - truth.point_mm[1]))
    bar = {"name": "bar", "codes": [1, 2], "length_mm": length, "u_mm": 0.02}
    result = measure(whole.stations, found, (4096, 3000), field(distances=[bar]), parse_target("ring14"))
    points = result.points
    assert (points.code > 0).sum() == 20
    assert result.uncoded == 40
    # Which of the true points each dot is, its observations say; none may be mixed.
    here = result.observations.point >= 0
    assert here.sum() == result.calibration.used
    for k in range(len(points)):
        assert len(np.unique(whole.point[result.observations.point == k])) == 1
    owner = np.array([whole.point[result.observations.point == k][0] for k in range(len(points))])
    as_coded = replace_codes(points, owner)
    error, nees = fitted(as_coded, truth)  # type: ignore[arg-type]
    assert np.abs(error).max() < 1
    assert result.halves.splits == 1
    assert {d.quantity for d in result.halves.differences} >= {"fx", "cx", "cy"}
    assert 0.75 < nees < 1.3  # 174 degrees of freedom


def test_a_check_distance_that_misses_fails_the_measurement(whole_only: None) -> None:
    truth = scene(points=60)
    whole, found = observations_of(coded=60)
    lengths = [float(np.linalg.norm(truth.point_mm[a] - truth.point_mm[a + 1])) for a in (0, 4)]
    parts = [
        {"name": "bar", "codes": [1, 2], "length_mm": lengths[0], "u_mm": 0.02},
        {"name": "check", "codes": [5, 6], "length_mm": lengths[1] + 1.0, "u_mm": 0.02, "role": "check"},
    ]
    result = measure(whole.stations, found, (4096, 3000), field(distances=parts), parse_target("ring14"))
    assert any("'check'" in failure for failure in result.calibration.failures)
    assert not result.calibration.test["passed"] and not result.calibration.rejected


@pytest.mark.parametrize(
    ("diameter_mm", "role", "codes", "failure"),
    [
        (None, "check", [1, 2], "cannot be compared: the scale is arbitrary"),
        (None, "check", [1, 99], "cannot be compared: an end of it"),
        (None, "control", [1, 99], "none of them can be used"),
        (10.2, "control", [1, 99], "none of them can be used"),
        (10.2, "check", [1, 2], ""),
    ],
)
def test_what_was_certified_and_cannot_be_used_is_a_failure(
    diameter_mm: float | None, role: str, codes: list[int], failure: str, whole_only: None
) -> None:
    """Dots of 10 mm whose diameters are told 2 % wrong: the scale, and what is stated of it, is theirs."""
    truth = scene(points=60)
    whole, found = observations_of(coded=60)
    found = [replace(one, observations=replace(one.observations, centre_of_disc=True)) for one in found]
    for one in found:
        one.observations.moments_px2[:] /= 4  # those of a disc: a quarter of its squared half-axes
    bar = {"name": "bar", "codes": codes, "length_mm": float(np.linalg.norm(truth.point_mm[0] - truth.point_mm[1]))}
    target = {"kind": "ring14"} | ({"diameter_mm": diameter_mm} if diameter_mm else {})
    asked = FieldFile.model_validate({"target": target, "distances": [bar | {"u_mm": 0.01, "role": role}]})
    result = measure(whole.stations, found, (4096, 3000), asked, parse_target("ring14"))
    said = " ".join(result.calibration.failures)
    assert (failure in said) if failure else not said
    if not failure:
        (length,) = result.lengths
        assert 0.01 < length.measured_mm / length.certified_mm - 1 < 0.03
        assert length.u_measured_mm == pytest.approx(0.07 * length.measured_mm, rel=0.01)
        assert abs(length.en) < 0.5


def test_a_grids_size_may_be_written_either_way_round(whole_only: None) -> None:
    answers = []
    for size in ("10x8", "8x10"):
        target = parse_target(f"circles:{size}")
        asked = FieldFile.model_validate(
            {"target": {"kind": f"circles:{size}", "diameter_mm": 10}, "grid": {"spacing_mm": 25}}
        )
        found = [seen_grid(k, target) for k in range(8)]
        result = measure(tuple(f"s{k}" for k in range(8)), found, (4096, 3000), asked, target)
        assert not result.calibration.failures and not result.calibration.rejected
        assert result.calibration.used == 640
        answers.append(result.calibration.interior.parameters)
    assert np.array_equal(*answers)


def seen_grid(image: int, target: TargetSpec) -> Found:
    """A grid of 10 x 8 dots, 25 mm apart, by the camera of `test_self_calibration` from one of eight places."""
    k = np.arange(80)
    xyz = 25.0 * np.column_stack([k % 10, k // 10, 0 * k])
    turn = Rotation.from_euler("zxy", [0.8 * image, 0.4 * np.sin(image), 0.4 * np.cos(image)]).as_matrix()
    pose = Poses(turn[None], (np.array([0, 0, 400.0 + 30 * image]) - turn @ xyz.mean(axis=0))[None])
    xy = project(CAMERA, pose[np.zeros(80, int)], xyz)
    xy = xy + np.random.default_rng(image).normal(0, 0.05, xy.shape)
    place = order_grid(xy, np.full(80, 90.0), target.columns, target.rows)
    none = np.full(80, -1)
    observations = Observations(
        stations=(f"s{image}",),
        station=np.zeros(80, int),
        xy_px=xy,
        cov_px2=np.tile(0.0025 * np.eye(2), (80, 1, 1)),
        moments_px2=np.tile(500 * np.eye(2), (80, 1, 1)),
        code=np.zeros(80, int),
        board=none,
        point=none,
        chi2=np.ones(80),
        status=np.full(80, MEASURED),
        centre_of_disc=False,
    )
    return Found(observations, place, ())


def replace_codes(points: Points, owner: np.ndarray) -> Points:
    return replace(points, code=1 + owner)


def test_dots_that_lie_elsewhere_are_not_matched() -> None:
    truth = scene(points=60)
    rng = np.random.default_rng(1)
    image = np.repeat(np.arange(8), 25)
    xy = rng.uniform([0, 0], [4095, 2999], (200, 2))
    dots = match_dots([CAMERA] * len(truth.stations), truth.stations, image, xy, np.full(200, 6.0), truth.point_mm, 0.3)
    assert len(dots.point_mm) <= 3


def test_certified_places_hold_the_datum_and_a_wrong_one_is_named() -> None:
    truth = scene()
    ties = ties_of(truth, SIGMA_PX)
    turn = np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]])
    frame = truth.point_mm @ turn.T + [100, 200, 300]
    known = {code: (frame[code - 1] + [0, 0, 40.0 * (code == 5)], np.full(3, 0.01)) for code in range(1, 9)}
    found = free_network(ties, 4096, 3000, certified=Certified((), known))
    assert found.scale_from == "control points"
    assert "code 5 is" in " ".join(found.calibration.notes)
    error = found.xyz_mm - frame[found.code - 1]
    assert np.abs(error).max() < 0.5
    low, high = chi2.interval(0.999, error.size)
    assert low < error.ravel() @ np.linalg.solve(found.cov_xyz_mm2, error.ravel()) < high


def test_a_field_file_says_what_is_certified() -> None:
    certified = certified_of(
        FieldFile.model_validate(
            {
                "target": {"kind": "ring14", "diameter_mm": 5, "diameters_mm": {7: 9}},
                "boards": [{"u_mm": 0.1, "points": [{"code": k, "xyz_mm": [k, 0, k * k]} for k in (1, 2, 3)]}],
                "distances": [{"codes": [1, 2], "length_mm": 3, "u_mm": 0.5, "role": "check"}],
            }
        )
    )
    assert np.array_equal(2 * certified.radii(np.array([1, 7])), [5, 9])
    assert np.array_equal(certified.known[2][0], [2, 0, 4])
    assert np.array_equal(certified.known[2][1], [0.1] * 3)
    assert certified.bars[0].role == "check"


@pytest.mark.parametrize(
    "text, words",
    [
        ("[target]\nkind = 'ring14'\ndiameter = 3", "target.diameter: unknown field"),
        ("[target]\nkind = 'ring14'\n[[distances]]\ncodes=[1, 2]\nlenght_mm=3", "did you mean 'length_mm'?"),
        ("[target]\nkind = 'ring14'\n[[distances]]\ncodes=[1, 1]\nlength_mm=3", "both ends have the same code"),
        ("[target]\nkind = 'ring14'\n[[distances]]\ncodes=[1, 2]\nlength_mm=-3", "distances[0].length_mm: value -3"),
        ("[target]\nkind = 'circles:10x8'\ndiameter_mm = 3", "needs [grid] with spacing_mm"),
        ("[target]\nkind = 'circles:10x8'\n[grid]\nspacing_mm = 9", "needs target.diameter_mm"),
        ("[target]\nkind = 'circles'\ndiameter_mm = 3\n[grid]\nspacing_mm = 9", "columns and rows"),
        ("[target]\nkind = ' circles:10x8'\ndiameter_mm = 3", "needs [grid] with spacing_mm"),
        ("[target]\nkind = 'ring14'\ndiameters_mm = { 3 = 0 }", "diameters_mm.3: value 0"),
        ("[target]\nkind = 'ring14'\n[[distances]]\ncodes=[0, 2]\nlength_mm=3", "distances[0].codes[0]: value 0"),
        (
            "[target]\nkind = 'ring14'\n[[distances]]\ncodes=[1, 2]\nlength_mm=3\n[[distances]]\ncodes=[2, 1]\n"
            "length_mm=3",
            "two distances are called 'bar 1-2'",
        ),
        (
            "[target]\nkind = 'ring14'\n[[boards]]\npoints = [{ code = 1, xyz_mm = [0, 0, 0], u_mm = -0.5 },"
            " { code = 2, xyz_mm = [1, 0, 0] }, { code = 3, xyz_mm = [0, 1, 0] }]",
            "boards[0].points[0].u_mm",
        ),
        ("[target]\nkind = 'ring14'\n[grid]\nspacing_mm = 9", "belongs to target.kind"),
        ("name = 'x'", "target: this field is required"),
        ("name = ", "not valid TOML"),
    ],
)
def test_a_wrong_field_file_is_said_to_be_one(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "field.toml"
    path.write_text(text)
    with pytest.raises(TestfieldError) as caught:
        load_field_file(path)
    assert words in str(caught.value)
    assert "field.toml" in str(caught.value)


def test_the_command_says_what_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["measure", "none.png", "--field", str(tmp_path / "none.toml")]) == 2
    assert "none.toml" in capsys.readouterr().err
    (tmp_path / "f.toml").write_text("[target]\nkind = 'ring14'\n")
    assert main(["measure", "none.png", "--field", str(tmp_path / "f.toml"), "--hold", "k3,k7"]) == 2
    assert "--hold: the lens model 'brown' has no coefficient 'k7'" in capsys.readouterr().err
    assert main(["measure", str(tmp_path / "none.png"), "--field", str(tmp_path / "f.toml")]) == 2
    assert "no image can be read" in capsys.readouterr().err


def test_without_dots_the_network_stays_as_it_is() -> None:
    truth = scene()
    whole, _ = observations_of(coded=60)
    found = calibrated(truth, ties_of(truth))
    assert with_dots(found, whole, ()) is found


def test_frames_measured_as_photographs_are_as_true_as_claimed(
    quick: Run, whole_only: None, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    images, file = str(quick.folder / "frames"), str(FIELDS / "quick.toml")
    assert main(["measure", images, "--field", file, "--out", str(tmp_path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    points = Points.load(tmp_path / "points.parquet")
    true, code = quick.world.mark_world_mm, quick.world.marks.code
    place = {int(c): k for k, c in enumerate(code) if c > 0}
    coded = points.code > 0
    R, t = rigid_fit(points.xyz_mm[coded], true[[place[int(c)] for c in points.code[coded]]])
    distance, nearest = cKDTree(true).query(points.xyz_mm @ R.T + t)
    # Every dot without a code is one of the field's, and none is there twice.
    assert distance.max() < 0.3
    assert len(np.unique(nearest)) == len(points)
    assert (code[nearest] == np.maximum(points.code, 0)).all()
    assert coded.sum() == 36
    assert answer["uncoded"] >= 120
    error, nees = fitted(replace(points, code=1 + nearest), replace(scene(), point_mm=true))  # type: ignore[arg-type]
    assert np.sqrt((error**2).mean()) < 0.01
    assert 0.8 < nees < 1.25  # 480 degrees of freedom
    assert abs(answer["lengths"][1]["en"]) < 1.5
    assert answer["lengths"][0]["en"] is None


@real
def test_a_real_plate_is_measured(whole_only: None, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    images, file = str(REAL / "ring14_plate"), str(FIELDS / "plate.toml")
    assert main(["measure", images, "--field", file, "--out", str(tmp_path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["reprojection_rms_px"] < 0.03
    assert answer["sigma0"] < 2
    assert len(answer["joined"]) == 3
    assert any("arbitrary" in note for note in answer["notes"])
    assert any("two images only" in note for note in answer["notes"])
    points = Points.load(tmp_path / "points.parquet")
    assert (points.code > 0).sum() >= 58
    assert answer["uncoded"] >= 120
    # All but three raised targets lie on a plate, and so do the dots nobody numbered.
    flat = points.xyz_mm[~np.isin(points.code, [72, 73, 74])]
    normal = np.linalg.svd(flat - flat.mean(axis=0))[2][2]
    off = (flat - flat.mean(axis=0)) @ normal
    assert np.std(off) < 0.2  # of an extent of about 1000
    assert np.abs(off).max() < 1
    assert points.xyz_mm[np.isin(points.code, [72, 73, 74])][:, 2].min() > 100
    page = (tmp_path / "report.html").read_text()
    assert "code 72" in page
    # Photographs come without truth: no figure, heading or column may be called true, actual or an error.
    labels = re.findall(r"<(?:th|span|h2|h3|figcaption)[^>]*>([^<]*)<", page.split("<main>")[1])
    assert len(labels) > 20
    assert not [label for label in labels if re.search(r"\b(true|truth|actual|error)\b", label)]


@real
@pytest.mark.slow  # `test_photographs` finds and calibrates by the same grid, `test_bent_boards` knows paper that bends
def test_a_real_grid_of_circles_calibrates_as_opencv_does(
    whole_only: None, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    images, file = str(REAL / "circle_grid"), str(FIELDS / "grid.toml")
    assert main(["measure", images, "--field", file, "--out", str(tmp_path), "--hold", "k3", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["reprojection_rms_px"] < 0.4755
    # OpenCV takes the paper for flat and the lens for its model; so do we when told to.
    k = np.arange(80)
    marks = Marks(25.0 * np.column_stack([k % 10, k // 10]), np.full(80, 15.0), np.zeros(80, int), 14)
    sheet = Field(14, (NominalBoard("grid", marks, 0.0, 0.0),))
    observations = Observations.load(tmp_path / "observations.parquet")
    flat = stitched(observations, sheet, 640, 480, hold=("k3",), empirical=True, misfit=NO_MISFIT)
    assert flat.interior.fx == pytest.approx(456.96, abs=1.0)  # OpenCV's, circles' eccentricity modelled
    # The paper is not flat, and 0.5 px are left of 0.005 px that detection claims: nobody knows this focal length to
    # 0.016 px. What is stated covers OpenCV's answer.
    assert answer["lens_misfit"]["unflat_mm"] > 0.1
    assert answer["reprojection_rms_px"] < 0.25
    assert 0.3 < answer["interior_u"]["fx"] < 3
    assert abs(answer["interior"]["fx"] - 456.96) < 4 * answer["interior_u"]["fx"]


@real
@pytest.mark.slow
def test_the_halves_of_a_real_grid_are_compared(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    images, file = str(REAL / "circle_grid"), str(FIELDS / "grid.toml")
    assert main(["measure", images, "--field", file, "--out", str(tmp_path), "--hold", "k3", "--json"]) == 0
    halves = json.loads(capsys.readouterr().out)["halves"]
    assert halves["splits"] == 3
    assert {d["quantity"] for d in halves["differences"]} == {"fx", "cx", "cy"}
    # The paper bends otherwise in each image, which is in what is stated.
    assert all(d["ratio"] < 2 for d in halves["differences"])
