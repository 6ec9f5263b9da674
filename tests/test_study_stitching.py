"""The study on stitched boards: growth along a chain, its scenes, its scores and its findings."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from testfield.calibrate.calibration import Calibration
from testfield.camera.pose import Poses, rotation
from testfield.errors import TestfieldError
from testfield.evaluate.case import Case, changed
from testfield.evaluate.execute import case_key, execute
from testfield.scene.bend import curvature_of, extent_mm
from testfield.scene.build import build_world
from testfield.scene.check import check_scene
from testfield.scene.load import parse_scene
from testfield.scene.schema import SceneFile
from testfield.scene.truth import see
from testfield.scene.world import World
from testfield.score.camera import true_in_datum
from testfield.score.chain_growth import chain_errors, grown, link_of_marks
from testfield_studies.stitching import experiment as stitching
from testfield_studies.stitching import plan as stitching_plan
from testfield_studies.stitching import scenes as stitching_scenes


def _scene(table: stitching_scenes.Table) -> SceneFile:
    return parse_scene(tomli_w.dumps(table), table["name"], Path())


def _truth(world: World, moved: Poses | None = None) -> Calibration:
    """A calibration that knows the truth, but for the boards' poses if `moved`."""
    names = tuple(sheet.name for sheet in world.field.boards)
    _, boards = true_in_datum(world, names)
    labels = tuple(f"board:{n}.{axis}" for n in names[1:] for axis in ("rx", "ry", "rz", "tx", "ty", "tz"))
    return Calibration(
        method="true",
        interior=world.interior,
        station_names=world.station_name,
        stations=world.camera_from_world,
        board_names=names,
        boards=moved or boards,
        scale=1.0,
        covariance=np.diag(np.tile([1e-10] * 3 + [1e-4] * 3, len(names) - 1)),
        labels=labels,
        sigma0=1.0,
        freedom=1,
        reprojection_rms_px=0.0,
        used=0,
    )


def test_growth_has_the_check_value_of_methods() -> None:
    assert grown(np.array(20), 0.01, 2e-5, 500.0) ** 0.5 == pytest.approx(0.4990, abs=5e-5)
    rng = np.random.default_rng(1)
    shifts, turns = 0.01 * rng.standard_normal((4000, 20)), 2e-5 * rng.standard_normal((4000, 20))
    heading = np.cumsum(turns, axis=1) - turns  # a link's turn moves what comes after it
    end = (shifts + 500 * heading).sum(axis=1)
    assert end.std() == pytest.approx(0.4990, rel=0.03)
    assert grown(np.array(20), 0.01, 2e-5, 500.0) > 2 * (20 * 0.01**2 + (20 * 500 * 2e-5) ** 2 / 20)


def test_growth_counts_what_shift_and_turn_of_a_link_share() -> None:
    rng = np.random.default_rng(2)
    turns = 2e-5 * rng.standard_normal((20000, 7))
    shifts = 300 * turns + 0.002 * rng.standard_normal(turns.shape)
    end = (shifts + 440 * (np.cumsum(turns, axis=1) - turns)).sum(axis=1)
    s, shared = shifts.std(), float((shifts * turns).mean())
    assert end.std() == pytest.approx(grown(np.array(7), s, 2e-5, 440.0, shared) ** 0.5, rel=0.02)
    assert end.std() > 1.1 * grown(np.array(7), s, 2e-5, 440.0) ** 0.5


def test_marks_turn_a_board_by_their_noise_over_the_root_of_their_squared_distances() -> None:
    xy = stitching_scenes.sub_board_marks_mm()
    sheet = build_world(_scene(stitching_scenes.field("flat", 1, 1))).field.boards[0].marks.xy_mm
    np.testing.assert_allclose(np.sort(xy, axis=0), np.sort(sheet, axis=0), atol=1e-9)
    rng, away = np.random.default_rng(5), xy - xy.mean(axis=0)
    noise = rng.normal(0, 0.01, (4000, *xy.shape))
    turns = (away[:, 0] * noise[..., 1] - away[:, 1] * noise[..., 0]).sum(axis=1) / (away**2).sum()
    shift, turn = link_of_marks(xy, 0.01)
    assert turns.std() == pytest.approx(turn, rel=0.04)
    assert noise.mean(axis=1)[:, 0].std() == pytest.approx(shift, rel=0.04)


def test_a_turned_link_moves_the_boards_behind_it() -> None:
    world = build_world(_scene(stitching_scenes.chain(4, 1, 1)))
    found = chain_errors(world, _truth(world))
    assert max(abs(found.place_mm).max(), abs(found.shift_mm).max(), abs(found.turn_rad).max()) < 1e-9
    # All boards from the third on are turned about the second's middle, towards the cameras and downwards.
    datum, true = true_in_datum(world, tuple(sheet.name for sheet in world.field.boards))
    turn = rotation(datum.R[0].T @ np.array([0.0, 2e-5, -1e-5]))
    R, t = true.R.copy(), true.t_mm.copy()
    for b in (2, 3):
        R[b], t[b] = turn @ R[b], t[1] + turn @ (t[b] - t[1])
    found = chain_errors(world, _truth(world, Poses(R, t)))
    pitch = stitching_scenes.PITCH_MM
    np.testing.assert_allclose(found.place_mm[:, 1], [0, pitch * 1e-5, 2 * pitch * 1e-5], atol=1e-7)
    np.testing.assert_allclose(found.place_mm[:, 2], [0, -pitch * 2e-5, -2 * pitch * 2e-5], atol=1e-7)
    # Seen from the second board the third is shifted, and turned; the last link is as it should be.
    np.testing.assert_allclose(found.turn_rad, [[0, 0], [1e-5, -2e-5], [0, 0]], atol=1e-9)
    np.testing.assert_allclose(found.shift_mm[1], [pitch * 1e-5, -pitch * 2e-5], atol=1e-7)
    assert found.nees[0] == pytest.approx(0, abs=1e-9) and found.nees[2] > found.nees[1] > 0.5


@pytest.mark.parametrize(
    "table",
    [
        stitching_scenes.field("planned", 12, 3),
        stitching_scenes.field("random", 6, 3, bow_mm=1.0),
        stitching_scenes.field("flat", 3, 3, scale_ppm=200.0),
        stitching_scenes.full(6, 3, bow_mm=1.0),
        stitching_scenes.charuco(3, 3),
        stitching_scenes.close("sub-board", 3),
        stitching_scenes.chain(3, 1, 3),
    ],
    ids=lambda table: table["name"],
)
def test_every_scene_passes_all_checks(table: stitching_scenes.Table) -> None:
    scene = _scene(table)
    world = build_world(scene)
    warnings = check_scene(scene, world, see(world), table["name"])
    assert not [w for w in warnings if "joins" in w or "too small to decode" in w]


def test_full_boards_have_as_many_marks_as_the_sub_boards() -> None:
    for count in stitching_scenes.FULL:
        full = build_world(_scene(stitching_scenes.full(count, 1))).field.boards
        parts = build_world(_scene(stitching_scenes.field("planned", count, 1))).field.boards
        assert len(parts) == count and sum(len(b.marks) for b in parts) == count * stitching_scenes.MARKS
        assert len(full[0].marks) == count * stitching_scenes.MARKS


def test_a_board_has_a_scale_of_its_own_that_no_sheet_knows() -> None:
    table = stitching_scenes.field("planned", 2, 5)
    plain, zero = (build_world(_scene(t)) for t in (table, changed(table, {"boards.1.scale_error_ppm": 0.0})))
    np.testing.assert_array_equal(plain.marks.xy_mm, zero.marks.xy_mm)
    larger = build_world(_scene(changed(table, {"boards.1.scale_error_ppm": 1000.0})))
    own = plain.marks.board == 1
    print_errors = {"rtol": 0, "atol": 1e-3 * 4 * 0.01}
    np.testing.assert_allclose(larger.marks.xy_mm[own], plain.marks.xy_mm[own] * 1.001, **print_errors)
    np.testing.assert_array_equal(larger.marks.xy_mm[~own], plain.marks.xy_mm[~own])
    np.testing.assert_array_equal(larger.field.boards[1].marks.xy_mm, plain.field.boards[1].marks.xy_mm)


def test_boards_bent_to_one_level_have_one_curvature_whatever_their_size_and_axis() -> None:
    for level in (0.1, 3.0):
        tables = stitching_scenes.field("planned", 6, 3, bow_mm=level), stitching_scenes.full(6, 3, bow_mm=level)
        boards = [board for table in tables for board in table["boards"]]
        extents = [extent_mm(board["size_mm"], np.radians(board["bow_axis_deg"])) for board in boards]
        assert max(extents[:-1]) > 1.2 * min(extents[:-1]) and extents[-1] == pytest.approx(2000)
        curved = [abs(curvature_of(board["bow_mm"], extent)) for board, extent in zip(boards, extents, strict=True)]
        np.testing.assert_allclose(curved, 8 * level / 400**2, rtol=0.005)
        assert len({np.sign(board["bow_mm"]) for board in boards}) == 2


def test_no_bar_means_that_its_ends_are_gone_and_nothing_else() -> None:
    scene, world, observations = stitching._pixels(stitching_scenes.field("planned", 3, 1))
    left = stitching.without_bars(observations, world)
    ends = np.isin(observations.code, world.field.scale_bars[0].codes)
    assert ends.any() and len(left) == len(observations) - ends.sum()
    assert (left.board >= 0).sum() == (observations.board >= 0).sum()
    with_bar, without = (stitching._judged(scene, world, observations, m) for m in ("stitched", stitching.NO_BAR))
    assert without["observations"] == with_bar["observations"] - ends.sum() and without["method"] == stitching.NO_BAR
    assert without["corner_px"] != with_bar["corner_px"]


def test_of_a_chain_that_breaks_in_one_world_the_others_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    calibrated = stitching._calibrated

    def breaking(scene: SceneFile, *rest: Any) -> Calibration:
        if scene.seed == 5:
            raise TestfieldError("nothing holds", "here", "look")
        return calibrated(scene, *rest)

    monkeypatch.setattr(stitching, "_calibrated", breaking)
    rows = stitching.draw_chain(Case({"boards": 2, "level": 0.0}, "", None, {"seeds": [4, 5, 6], "wide": (1,)}), None)
    assert [(row["world"], row["failed"], row.get("links")) for row in rows] == [
        (4, "", 1),
        (5, "nothing holds", None),
        (6, "", 1),
    ]


def test_a_chain_uses_of_close_views_only_the_two_boards_they_are_aimed_at() -> None:
    _, world, observations = stitching._pixels(stitching_scenes.chain(4, 2, 1))
    for wide in (0, 1):
        kept = stitching.chained(observations, world, wide)
        seen = {
            name: set(kept.board[kept.station == s].tolist()) - {-1}
            for s, name in enumerate(kept.stations)
            if (kept.station == s).any()
        }
        assert seen["link02a"] == {1, 2} and seen["link03b"] == {2, 3}
        assert [name for name in seen if name.startswith("wide")] == ["wide01a"][:wide]


def test_confined_observations_lie_in_the_middle_and_coverage_says_how_much() -> None:
    scene, world, observations = stitching._pixels(stitching_scenes.field("planned", 3, 1))
    inside = stitching.confined(observations, scene, 0.5)
    assert 0 < len(inside) < len(observations) and (inside.board >= 0).all()
    assert len(stitching.confined(observations, scene, 1.01)) == (observations.board >= 0).sum()
    assert (abs(inside.xy_px - [799.5, 599.5]) <= [400, 300]).all()
    assert len(stitching._as_many(observations, inside, world, 1)) == len(inside)
    calibration = _truth(world)
    for xy, part in (([[0.0, 0.0]], 1 / 48), ([[0.0, 0.0], [1599, 1199], [1600.2, 1199]], 2 / 48)):
        object.__setattr__(calibration, "residual_at_px", np.array(xy))
        assert stitching.coverage(calibration) == pytest.approx(part)


def test_drawn_boards_are_stitched_within_what_is_claimed() -> None:
    options = {
        "scene": ("field", "planned", 3),
        "values": {},
        "seeds": [11],
        "windows": (0.7,),
        "methods": ["stitched", "stitched_given"],
    }
    rows = stitching.draw_field(Case({"boards": 3}, "", None, options), None)
    assert [(row["method"], row["cut"]) for row in rows] == [
        ("stitched", ""),
        ("stitched_given", ""),
        ("stitched", "middle"),
        ("stitched", "spread"),
    ]
    assert rows[0]["boards_nees"] < 2.5 and rows[0]["check_points"] == 12 and rows[0]["corner_px"] < 0.3
    assert rows[1]["check_unfitted_mm"] < 0.7 * rows[0]["check_unfitted_mm"]
    assert rows[2]["observations"] == pytest.approx(rows[3]["observations"], rel=0.05)
    assert rows[2]["observations"] < 0.9 * rows[0]["observations"]
    assert rows[2]["coverage"] < rows[3]["coverage"]


def test_a_rendered_board_goes_through_the_same_cases_as_drawn_ones(tmp_path: Path) -> None:
    table = changed(
        stitching_scenes.close("sub-board", 1),
        {
            "camera.width_px": 800,
            "camera.height_px": 600,
            "camera.pixel_pitch_um": 9.0,
            "exposure.time_ms": 2.0,
            "render.light_paths": 32,
        },
    )
    table["stations"] = table["stations"][:4]
    table["measure"] = {"hold": ["k3"]}
    options = {"methods": ["stitched"]}
    rows = execute(
        [Case({"boards": 1}, "testfield_studies.stitching.experiment:measure_field", table, options)], tmp_path
    )
    assert rows["observations"][0] > 100 and rows["sigma0"][0] < 1.3 and "check_points" not in rows


def test_the_plans_are_whole_and_no_case_occurs_twice() -> None:
    quick, whole = stitching_plan.cases(True), stitching_plan.cases(False)
    for plan in (quick, whole):
        assert len({case_key(case) for case in plan}) == len(plan)
    tried = {(c.labels["target"], c.labels["boards"]) for c in whole if c.labels["experiment"] == "count"}
    assert {("planned", n) for n in (1, 2, 3, 4, 6, 9, 12)} <= tried
    assert {(t, n) for t in ("random", "flat", "full-size", "charuco") for n in (3, 6, 12)} <= tried
    assert len(quick) < len(whole) / 3
