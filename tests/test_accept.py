"""`testfield accept`: the truth fed in gives zeros, known errors give their own size, and the verdict follows."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testfield.calibrate.calibration import Calibration
from testfield.camera.pose import Poses
from testfield.chain.run import Run
from testfield.cli.main import main
from testfield.errors import TestfieldError
from testfield.reconstruct.points import Points
from testfield.report.accept import accept_page, sentence
from testfield.scene.build import build_world
from testfield.scene.check_marks import codes_exist_and_differ
from testfield.scene.load import load_scene, parse_scene
from testfield.scene.schema import SceneFile
from testfield.scene.world import BOARD, World
from testfield.score.acceptance import acceptance, planes
from testfield.score.align import rigid_basis, rigid_fit
from testfield.score.camera import true_in_datum
from testfield.score.flatness import flatness, form_error, in_a_row
from testfield.score.length_test import Limit, MeasuredLengths, figures, judge, limit_of, smallest_a
from testfield.score.points import score_points
from testfield.statistics.consistency import decorrelated, nees_band, pit_uniformity
from testfield.targets.field import Field

SCENES = Path(__file__).parents[1] / "scenes"
TIGHT = Limit(1e-9)


@pytest.fixture(scope="module")
def scene() -> SceneFile:
    return load_scene(SCENES / "vdi2634.toml")


@pytest.fixture(scope="module")
def exact(scene: SceneFile) -> World:
    """The field made without any error: what the sheet says of lengths is true."""
    lines = tuple(line.model_copy(update={"u_length_mm": 0.0}) for line in scene.measuring_lines)
    bars = tuple(bar.model_copy(update={"u_length_mm": 0.0}) for bar in scene.scale_bars)
    return build_world(scene.model_copy(update={"measuring_lines": lines, "scale_bars": bars}))


def calibrated(world: World) -> Calibration:
    """A calibration that says no more than which board is the datum."""
    return Calibration(
        method="none",
        interior=world.interior,
        station_names=world.station_name,
        stations=world.camera_from_world,
        board_names=(world.field.boards[0].name,),
        boards=Poses.identity(1),
        scale=1.0,
        covariance=np.zeros((0, 0)),
        labels=(),
        sigma0=1.0,
        freedom=1,
        reprojection_rms_px=0.0,
        used=0,
    )


def true_points(world: World, u_mm: float = 0.01) -> Points:
    """All coded targets that are on no board's sheet, where they truly are in the datum frame."""
    datum, _ = true_in_datum(world, (world.field.boards[0].name,))
    here = np.flatnonzero((world.marks.role != BOARD) & (world.marks.code > 0))
    xyz = (world.mark_world_mm[here] - datum.t_mm[0]) @ datum.R[0]
    n = len(here)
    return Points(
        method="true",
        code=world.marks.code[here],
        xyz_mm=xyz,
        cov_xyz_mm2=u_mm**2 * np.eye(3 * n),
        rays=np.full(n, 9),
        residual_rms_px=np.zeros(n),
        rejected=np.zeros(n, int),
    )


def test_the_truth_gives_zeros(scene: SceneFile, exact: World) -> None:
    card, lengths = acceptance(scene, exact, calibrated(exact), true_points(exact), TIGHT)
    assert len(lengths) == 36  # 7 lines of 5 lengths, and the check bar
    assert np.abs(lengths.dl_mm).max() < 1e-9
    found = card["lengths"]
    assert abs(found["slope"]["slope_ppm"]) < 1e-6
    assert found["envelope"]["a_mm"] < 1e-9
    assert card["verdict"]["verdict"] == "passed" and card["verdict"]["with_test_uncertainty"] == "shown"
    assert card["spacing"]["spacings"] == 36 and card["spacing"]["max_abs_mm"] < 1e-9
    assert [plane["targets"] for plane in card["flatness"]] == [6]
    assert abs(card["flatness"][0]["error_mm"]) < 1e-9
    assert card["points"]["rmse_mm"] < 1e-9 and card["points"]["anees"] < 1e-9
    assert card["points"]["coverage_95"] == card["points"]["en_within_1"] == 1


def test_the_lines_stand_as_recommended_and_a_shorter_one_does_not(scene: SceneFile) -> None:
    world = build_world(scene)
    card, _ = acceptance(scene, world, calibrated(world), true_points(world))
    assert [row["met"] for row in card["arrangement"]] == [True] * 6
    lines = scene.measuring_lines
    spoilt = scene.model_copy(
        update={"measuring_lines": (lines[0].model_copy(update={"lengths_mm": (350.0, 900.0)}), *lines[1:6])}
    )
    world = build_world(spoilt)
    card, _ = acceptance(spoilt, world, calibrated(world), true_points(world))
    met = {row["what"]: row["met"] for row in card["arrangement"]}
    assert not any(
        met[what] for what in ("measuring lines", "test lengths on every line", "an end point in every corner")
    )
    assert met["one line at least"]


def test_corners_are_the_declared_volumes_not_the_lines_own(scene: SceneFile) -> None:
    """A single line spans a box of its own, in whose corners it does not end."""
    found = {}
    for k, line in enumerate(scene.measuring_lines):
        alone = scene.model_copy(update={"measuring_lines": (line,)})
        world = build_world(alone)
        card, _ = acceptance(alone, world, calibrated(world), true_points(world), Limit(1.0))
        rows = {row["what"]: row for row in card["arrangement"]}
        corners = rows["an end point in every corner"]
        assert not corners["met"]
        found[k] = int(corners["found"])
        assert card["verdict"]["verdict"] == "passed" and not card["verdict"]["arrangement_met"]
        said = sentence(card)
        assert "The recommended arrangement is not met in: measuring lines (1, asked: 7 or more)" in said
        assert "an end point in every corner" in said
    assert [found[k] for k in range(4)] == [2] * 4 and max(found[k] for k in range(4, 7)) == 0


def test_passed_without_the_tests_arrangement_is_said_so(scene: SceneFile, exact: World) -> None:
    card, _ = acceptance(scene, exact, calibrated(exact), true_points(exact), TIGHT)
    assert card["verdict"]["arrangement_met"]
    assert "arrangement" not in sentence(card) and "not the test" not in sentence(card)
    bare = scene.model_copy(update={"measuring_lines": ()})
    world = build_world(bare)
    card, _ = acceptance(bare, world, calibrated(world), true_points(world), Limit(1.0))
    assert card["verdict"]["verdict"] == "passed" and not card["verdict"]["arrangement_met"]
    assert sentence(card).endswith("The run has no measuring lines, so this is not the test of part 1.")


def test_a_scale_error_is_the_slope_and_the_envelope(scene: SceneFile, exact: World) -> None:
    points, q = true_points(exact), 20e-6
    larger = replace(points, xyz_mm=(1 + q) * points.xyz_mm)
    card, lengths = acceptance(scene, exact, calibrated(exact), larger, Limit(0.01, 10))
    assert np.allclose(lengths.dl_mm, q * lengths.calibrated_mm, rtol=0, atol=1e-9)
    found = card["lengths"]
    assert found["slope"]["slope_ppm"] == pytest.approx(20, abs=1e-6)
    assert found["slope"]["offset_mm"] == pytest.approx(0, abs=1e-9)
    assert found["mean_relative_ppm"] == pytest.approx(20, abs=1e-6)
    assert found["envelope"]["k_ppm"] == pytest.approx(20, abs=1e-5)
    assert found["envelope"]["k_without_a_ppm"] == pytest.approx(20, abs=1e-5)
    assert found["envelope"]["a_mm"] == pytest.approx(0, abs=1e-7)
    assert found["max_abs_dl_mm"] == pytest.approx(q * 3201.562, abs=1e-9)
    # 20 ppm exceed 0.01 mm + 10 ppm from 1 m on.
    assert card["verdict"]["verdict"] == "failed"
    assert card["verdict"]["outside"] == (lengths.calibrated_mm > 1000).sum()
    assert judge(lengths, Limit(0.001, 20))["verdict"] == "passed"
    assert judge(lengths, Limit(0.01, 20, 0.05))["verdict"] == "failed"  # B caps the limit
    # External accuracy sees the scale, internal does not.
    assert card["points"]["external_over_internal"] > 1


def test_one_wrong_length_is_named(scene: SceneFile, exact: World) -> None:
    points = true_points(exact)
    line = exact.field.measuring_lines[4]
    xyz = points.xyz_mm.copy()
    a, b = points.rows([line.codes[0], line.codes[3]])
    along = (xyz[b] - xyz[a]) / np.linalg.norm(xyz[b] - xyz[a])
    xyz[b] += 0.1 * along
    card, lengths = acceptance(scene, exact, calibrated(exact), replace(points, xyz_mm=xyz))
    wrong = np.flatnonzero(np.abs(lengths.dl_mm) > 1e-9)
    assert [tuple(lengths.codes[k]) for k in wrong] == [(line.codes[0], line.codes[3])]
    assert lengths.dl_mm[wrong] == pytest.approx(0.1, abs=1e-9)
    assert card["verdict"]["verdict"] == "failed" and card["verdict"]["outside"] == 1
    assert card["verdict"]["worst_codes"] == [line.codes[0], line.codes[3]]
    assert card["verdict"]["with_test_uncertainty"] == "refuted"
    assert card["spacing"]["max_abs_mm"] == pytest.approx(0.1, abs=1e-9)


def test_control_bars_are_no_test_lengths(scene: SceneFile, exact: World) -> None:
    points = true_points(exact)
    moved = points.xyz_mm.copy()
    moved[points.rows([301])] += 5.0
    card, lengths = acceptance(scene, exact, calibrated(exact), replace(points, xyz_mm=moved), TIGHT)
    assert not {301, 302, 303, 304} & set(lengths.codes.ravel().tolist())
    assert card["adjustment"]["scale_bars"] == ["upper bar", "upright bar"]
    assert card["verdict"]["verdict"] == "passed"


def test_calibrated_lengths_differ_from_the_true_ones_as_declared(scene: SceneFile) -> None:
    lines = tuple(line.model_copy(update={"u_length_mm": 0.05}) for line in scene.measuring_lines)
    world = build_world(scene.model_copy(update={"measuring_lines": lines}))
    _, lengths = acceptance(scene, world, calibrated(world), true_points(world))
    on_lines = np.array(lengths.line) != "check bar"
    assert 0.6 < np.sqrt((lengths.dl_mm[on_lines] ** 2).mean()) / 0.05 < 1.4
    assert np.abs(lengths.en).max() < 2


def test_a_target_that_was_not_measured_leaves_the_test_incomplete(scene: SceneFile, exact: World) -> None:
    points = true_points(exact)
    kept = points.code != 403
    index = np.repeat(kept, 3)
    fewer = Points(
        method="true",
        code=points.code[kept],
        xyz_mm=points.xyz_mm[kept],
        cov_xyz_mm2=points.cov_xyz_mm2[np.ix_(index, index)],
        rays=points.rays[kept],
        residual_rms_px=points.residual_rms_px[kept],
        rejected=points.rejected[kept],
    )
    card, _ = acceptance(scene, exact, calibrated(exact), fewer, TIGHT)
    assert card["verdict"]["verdict"] == "incomplete"
    assert card["lengths"]["missing"] == [{"line": "diagonal 1", "codes": [401, 403]}]


def _lengths(calibrated_mm: np.ndarray, dl_mm: np.ndarray, u_calibrated_mm: float = 0.0) -> MeasuredLengths:
    n = len(calibrated_mm)
    return MeasuredLengths(
        ("line",) * n,
        np.arange(2 * n).reshape(n, 2),
        calibrated_mm,
        np.full(n, u_calibrated_mm),
        calibrated_mm + dl_mm,
        0.01**2 * np.eye(n),
    )


def test_the_envelope_is_the_lowest_that_holds_all_errors() -> None:
    rng = np.random.default_rng(1)
    length, dl = rng.uniform(200, 3000, 40), rng.normal(0, 0.01, 40)
    found = _lengths(length, dl)
    best = figures(found)["envelope"]
    assert (np.abs(dl) <= best["a_mm"] + 1e-6 * best["k_ppm"] * length + 1e-9).all()
    k = np.linspace(0, best["k_without_a_ppm"], 4001)
    at_mean = smallest_a(found, k) + 1e-6 * k * length.mean()
    assert best["a_mm"] + 1e-6 * best["k_ppm"] * length.mean() <= at_mean.min() + 1e-9


def test_the_slopes_interval_holds_as_often_as_it_says() -> None:
    """With errors drawn from the claimed covariance, lengths correlated by a shared scale."""
    rng = np.random.default_rng(2)
    length = np.linspace(300, 3000, 12)
    covariance = 0.005**2 * np.eye(12) + (5e-6) ** 2 * np.outer(length, length)
    root = np.linalg.cholesky(covariance)
    hits, naive = 0, 0
    for _ in range(600):
        dl = 10e-6 * length + root @ rng.standard_normal(12)
        found = figures(replace(_lengths(length, dl), cov_measured_mm2=covariance))["slope"]
        hits += found["ci_low_ppm"] <= 10 <= found["ci_high_ppm"]
        naive += found["scatter_low_ppm"] <= 10 <= found["scatter_high_ppm"]
    assert 0.92 < hits / 600 < 0.98
    assert naive / 600 < 0.6  # lengths that share a scale are not independent


def test_the_tests_own_uncertainty_makes_three_answers() -> None:
    length = np.array([1000.0, 2000.0])
    for dl, answer in ((0.01, "shown"), (0.019, "open"), (0.021, "open"), (0.03, "refuted")):
        judged = judge(_lengths(length, np.array([0.0, dl]), u_calibrated_mm=0.002), Limit(0.02))
        assert judged["with_test_uncertainty"] == answer
        assert judged["verdict"] == ("passed" if dl <= 0.02 else "failed")
        assert limit_of(judged) == Limit(0.02)
    for limit in (Limit(0.02, 3), Limit(0.02, 3, 0.03), Limit(0.02, 3, 0.0)):  # at most 0 is a limit too
        judged = judge(_lengths(length, np.zeros(2)), limit)
        assert limit_of(judged) == limit
        assert judged["verdict"] == "passed"


def test_flatness_is_the_range_about_the_plane_however_it_lies() -> None:
    rng = np.random.default_rng(3)
    flat = np.column_stack([rng.uniform(-500, 500, (9, 2)), np.zeros(9)])
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    assert flatness(flat @ turn.T + 700) < 1e-9
    square = np.array([[x, y, 0.0] for x in (-1, 1) for y in (-1, 1)]) * 100
    bent = square + np.array([[0, 0, z] for z in (0.1, -0.1, -0.1, 0.1)])
    assert flatness(bent @ turn.T) == pytest.approx(0.2, abs=1e-9)


def test_a_bow_measured_the_wrong_way_round_is_an_error_of_twice_its_size() -> None:
    rng = np.random.default_rng(6)
    x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(-200.0, 200, 5)]))
    bow = 0.3 * (1 - (x**2 + y**2) / 80_000)
    R, t = np.linalg.qr(rng.standard_normal((3, 3)))[0], rng.standard_normal(3) * 1000
    R *= np.sign(np.linalg.det(R))
    true, mirrored, flat = (np.column_stack([x, y, height]) for height in (bow, -bow, 0 * bow))
    assert form_error(true @ R.T + t, true) < 1e-9
    assert flatness(mirrored) == pytest.approx(flatness(true), abs=1e-9) == pytest.approx(0.3, abs=1e-9)
    assert form_error(mirrored @ R.T + t, true) == pytest.approx(0.6, abs=1e-6)
    for measured, there in ((flat @ R.T + t, true), (true, flat)):
        assert form_error(measured, there) == pytest.approx(0.3, abs=1e-6)
    # A tilt is no error of form, and neither is a shift in the plane.
    assert form_error(true + np.column_stack([0 * x, 0 * x, 0.001 * x]), true) < 1e-6


@pytest.fixture(scope="module")
def row(scene: SceneFile) -> SceneFile:
    """The field with four check targets alone, in a straight row on a board."""
    targets = scene.check_targets[:3]
    fourth = targets[2].model_copy(update={"code": 507, "xy_mm": (-302, 170)})
    bars = tuple(bar for bar in scene.scale_bars if bar.role == "control")
    return scene.model_copy(
        update={"measuring_lines": (), "check_targets": (*targets, fourth), "scale_bars": bars, "acceptance": None}
    )


def test_targets_in_a_row_have_no_flatness(row: SceneFile) -> None:
    line = np.column_stack([np.linspace(0, 500, 6), np.zeros(6), np.zeros(6)])
    assert in_a_row(line) and in_a_row(line[:2]) and not in_a_row(line + np.eye(6, 3) * 20)
    world = build_world(row)
    assert planes(row, world, true_points(world)) == []
    beside = row.check_targets[3].model_copy(update={"xy_mm": (605, 345)})
    square = row.model_copy(update={"check_targets": (*row.check_targets[:3], beside)})
    world = build_world(square)
    assert [plane["targets"] for plane in planes(square, world, true_points(world))] == [4]


@pytest.mark.parametrize("free", [False, True])
def test_check_points_in_a_straight_row_are_judged_by_what_they_see(row: SceneFile, free: bool) -> None:
    """Nobody sees their turn about the row: 3n - 5 degrees of freedom, and no crash."""
    world = build_world(row)
    calibration, points = calibrated(world), true_points(world)
    if free:
        calibration = replace(calibration, board_names=(), boards=Poses.identity(0))
    n, rng = 4, np.random.default_rng(8)
    true, check = points.xyz_mm, np.isin(points.code, [501, 502, 503, 507])
    size = 3 * len(points)
    A = np.eye(size) + 0.3 * rng.standard_normal((size, size))
    A[0] *= 3
    root, values, p = 0.01 * A, [], []
    points = replace(points, cov_xyz_mm2=root @ root.T)
    for _ in range(150):
        noise = (root @ rng.standard_normal(size)).reshape(-1, 3)
        score = score_points(world, calibration, replace(points, xyz_mm=true + noise))
        assert np.abs(score.fitted_mm).max() < 1 and np.isfinite(score.anees_fitted)
        values.append(score.anees_fitted)
        p.append(pit_uniformity(decorrelated(score.error_mm.ravel(), score.cov_mm2))[1])
    assert check.sum() == n and np.mean(values) == pytest.approx(1, abs=3.3 * np.sqrt(2 / (150 * (3 * n - 5))))
    assert 0.005 < np.mean(np.array(p) < 0.05) < 0.11
    card, lengths = acceptance(row, world, calibration, replace(points, xyz_mm=true + noise))
    assert card["points"]["fitted_parameters"] == 5 and card["points"]["pit"]["values"] == 3 * n - 5 * free
    assert card["points"]["anees_band_95"] == list(nees_band(3 * n - 5 * free))
    assert accept_page(world, card, lengths, None, []).count("<svg") == 3


def test_a_row_is_brought_onto_the_true_one_by_the_smallest_turn() -> None:
    rng = np.random.default_rng(9)
    along = np.array([1.0, 2, -1]) / np.sqrt(6)
    true = 100 + np.outer([0, 100, 250, 400, 900], along)
    assert rigid_basis(true).shape == (15, 5) and rigid_basis(true[:1]).shape == (3, 3)
    assert np.linalg.matrix_rank(rigid_basis(true)) == 5
    for turn in (np.eye(3), np.linalg.qr(rng.standard_normal((3, 3)))[0], -np.eye(3)):
        turn = turn * np.sign(np.linalg.det(turn)) if turn[0, 0] > -1 else np.diag([-1.0, -1, 1])
        R, t = rigid_fit(true @ turn.T + 7, true)
        assert np.abs((true @ turn.T + 7) @ R.T + t - true).max() < 1e-9
        assert np.abs(R @ R.T - np.eye(3)).max() < 1e-12 and np.linalg.det(R) == pytest.approx(1)
    R, t = rigid_fit(-true, true)  # straight back
    assert np.abs(-true @ R.T + t - true).max() < 1e-9 and np.linalg.det(R) == pytest.approx(1)
    R, _ = rigid_fit(true + 1e-3 * rng.standard_normal(true.shape), true)
    assert np.abs(R - np.eye(3)).max() < 1e-4


def test_three_points_of_a_free_network_say_nothing_of_their_plane(scene: SceneFile) -> None:
    three = scene.model_copy(
        update={"measuring_lines": (), "check_targets": (*scene.check_targets[:2], scene.check_targets[4])}
    )
    world = build_world(three)
    calibration = replace(calibrated(world), board_names=(), boards=Poses.identity(0))
    points = true_points(world)
    noise = 0.01 * np.random.default_rng(10).standard_normal(points.xyz_mm.shape)
    card, _ = acceptance(three, world, calibration, replace(points, xyz_mm=points.xyz_mm + noise))
    assert card["points"]["pit"]["values"] == 3 and abs(card["points"]["en_worst"]) < 5
    assert card["points"]["coverage_95"] in (0, 1 / 3, 2 / 3, 1)


def test_true_claims_are_found_true_and_halved_ones_not(scene: SceneFile, exact: World) -> None:
    rng, points, calibration = np.random.default_rng(4), true_points(exact), calibrated(exact)
    figures_of: list[tuple[float, float, float]] = []
    for _ in range(20):
        noisy = replace(points, xyz_mm=points.xyz_mm + 0.01 * rng.standard_normal(points.xyz_mm.shape))
        card, _ = acceptance(scene, exact, calibration, noisy)
        p = card["points"]
        figures_of.append((p["anees"], p["coverage_95"], p["external_over_internal"]))
    anees, covered, ratio = np.mean(figures_of, axis=0)
    assert anees == pytest.approx(1, abs=0.07) and covered == pytest.approx(0.95, abs=0.025)
    assert ratio == pytest.approx(1, abs=0.03)
    bold = replace(noisy, cov_xyz_mm2=noisy.cov_xyz_mm2 / 4)
    card, _ = acceptance(scene, exact, calibration, bold)
    assert card["points"]["anees"] > card["points"]["anees_band_95"][1]
    assert card["points"]["coverage_95"] < card["points"]["coverage_band_99"][0]


def test_the_sheet_keeps_its_measuring_lines(scene: SceneFile, tmp_path: Path) -> None:
    field = build_world(scene).field
    field.save(tmp_path / "field.json")
    assert Field.load(tmp_path / "field.json").measuring_lines == field.measuring_lines
    assert len(field.measuring_lines) == 7


def test_a_line_whose_lengths_do_not_grow_is_refused() -> None:
    text = (SCENES / "vdi2634.toml").read_text().replace("[300, 900, 1850, 2400, 3201.562]", "[300, 900, 900]")
    with pytest.raises(TestfieldError, match="do not grow"):
        parse_scene(text, "scene")
    again = (SCENES / "vdi2634.toml").read_text().replace("first_code = 411", "first_code = 401")
    world = build_world(parse_scene(again, "scene"))

    with pytest.raises(TestfieldError, match="used twice"):
        codes_exist_and_differ(parse_scene(again, "scene"), world, "scene")


def test_a_run_without_measuring_lines_is_tested_on_its_check_targets(
    quick: Run, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    folder = tmp_path / "quick"
    shutil.copytree(quick.folder, folder, ignore=shutil.ignore_patterns("frames", "radiance", "truth", "*.html"))
    assert main(["accept", str(folder)]) == 0
    text = capsys.readouterr().out
    assert "no verdict" in text and "VDI/VDE 2634" in text and "conform" not in text
    page = (folder / "accept.html").read_text()
    assert "computed as in VDI/VDE 2634" in page and "conform" not in page and page.count("<svg") == 3
    for a_mm, verdict, status in ((1.0, "passed", 0), (1e-5, "failed", 1)):
        assert main(["accept", str(folder), "--a-mm", str(a_mm), "--json"]) == status
        card = json.loads(capsys.readouterr().out)
        assert card["verdict"]["verdict"] == verdict and card["verdict"]["arrangement_met"] is False
        assert "so this is not the test of part 1" in (folder / "accept.html").read_text()
        assert len(card["rows"]) == 29  # all pairs of eight targets, and the check bar
    assert "no measuring lines" in card["lengths"]["rule"]
    assert card["arrangement"] is None
    again = (folder / "accept.html").read_bytes()
    assert main(["accept", str(folder), "--a-mm", "1e-5"]) == 1
    assert "failed" in capsys.readouterr().out.splitlines()[0].lower()
    assert (folder / "accept.html").read_bytes() == again

    for more, word in ((["--k-ppm", "3"], "K or B alone"), (["--a-mm", "-1"], "no limit")):
        assert main(["accept", str(folder), *more]) == 2
        assert word in capsys.readouterr().err
    (folder / "points.parquet").unlink()
    assert main(["accept", str(folder)]) == 2
    assert "testfield reconstruct" in capsys.readouterr().err
    assert main(["accept", str(tmp_path)]) == 2
    assert "no run's folder" in capsys.readouterr().err


def test_a_field_without_lengths_is_told_so(scene: SceneFile) -> None:
    bare = scene.model_copy(update={"measuring_lines": (), "check_targets": (), "scale_bars": scene.scale_bars[:1]})
    world = build_world(bare)
    with pytest.raises(TestfieldError, match="no length to test"):
        acceptance(bare, world, calibrated(world), true_points(world))
