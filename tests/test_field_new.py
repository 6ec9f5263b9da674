"""A field sheet proposed from photographs: boards that were moved are told apart; `measure` takes what is written."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation
from test_self_calibration import CAMERA

from testfield.calibrate.ties import coded_ties
from testfield.camera.project import project_camera
from testfield.cli.main import main
from testfield.detect.observations import MEASURED, Observations
from testfield.detect.photograph import Found
from testfield.detect.target_spec import parse_target
from testfield.measure.photographs import measure
from testfield.measure.proposed_field import planes, propose
from testfield.measure.proposed_text import field_text
from testfield.measure.settings import arranged
from testfield.measure.single_tags import as_coded
from testfield.scene.frames import camera_looking
from testfield.targets.field import TIME
from testfield.targets.field_file import FieldFile, load_field_file

SIZE = (4096, 3000)
SIGMA_PX = 0.03
REAL = Path(__file__).parents[1] / "../shared/real"


def boards() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Codes and places in mm of three flat boards of 16 codes, each in its own frame."""
    x, y = np.meshgrid(np.arange(4) * 150.0, np.arange(4) * 110.0)
    flat = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]) - [225, 165, 0]
    return {name: (1 + 20 * k + np.arange(16), flat) for k, name in enumerate("abc")}


def stood(moved: bool) -> dict[int, np.ndarray]:
    """Where each code is, before and after boards b and c were moved, each by a motion of its own."""
    at = {
        "a": (Rotation.identity(), [0, 0, 0]),
        "b": (Rotation.from_rotvec([0, 0.6, 0]), [750, 40, 120]),
        "c": (Rotation.from_rotvec([0.5, -0.1, 0.2]), [80, 620, 160]),
    }
    if moved:
        at["b"] = (Rotation.from_rotvec([0.2, -0.4, 0.5]), [690, -210, 200])
        at["c"] = (Rotation.from_rotvec([-0.3, 0.4, 0]), [-120, 560, 60])
    places = {}
    for name, (codes, flat) in boards().items():
        turn, shift = at[name]
        places |= dict(zip(codes.tolist(), turn.apply(flat) + shift, strict=True))
    return places


def photographed(settings: tuple[bool, ...] = (False, True), each: int = 5) -> tuple[tuple[str, ...], list[Found]]:
    """Five photographs of each arrangement, drawn by the camera of `test_self_calibration`."""
    rng = np.random.default_rng(4)
    names, found = [], []
    for s, moved in enumerate(settings):
        places = stood(moved)
        code, xyz = np.array(list(places)), np.array(list(places.values()))
        for k in range(each):
            angle = 2 * np.pi * (k + 0.3 * s) / each
            origin = np.array([300 + 900 * np.cos(angle), 250 + 900 * np.sin(angle), 1700 + 200 * (k % 2)])
            R, t = camera_looking(origin, np.array([300, 250, 0.0]), np.pi / 2 * (k % 4))
            xy = project_camera(CAMERA, xyz @ R.T + t)
            inside = np.isfinite(xy).all(axis=1) & (xy > 20).all(axis=1) & (xy < np.array(SIZE) - 20).all(axis=1)
            inside &= rng.random(len(code)) > 0.1
            n = int(inside.sum())
            found.append(
                Found(
                    Observations(
                        stations=(f"p{s}{k}",),
                        station=np.zeros(n, int),
                        xy_px=xy[inside] + SIGMA_PX * rng.standard_normal((n, 2)),
                        cov_px2=np.broadcast_to(SIGMA_PX**2 * np.eye(2), (n, 2, 2)).copy(),
                        moments_px2=np.broadcast_to(9.0 * np.eye(2), (n, 2, 2)).copy(),
                        code=code[inside],
                        board=np.full(n, -1),
                        point=np.full(n, -1),
                        chi2=np.ones(n),
                        status=np.full(n, MEASURED, object),
                        centre_of_disc=False,
                    ),
                    np.full((n, 2), -1),
                    (),
                )
            )
            names.append(f"p{s}{k}")
    return tuple(names), found


@pytest.fixture
def no_halves(monkeypatch: pytest.MonkeyPatch) -> None:
    """The halves of the images are not measured too."""
    from importlib import import_module

    from testfield.uncertainty.halves import NO_HALVES

    monkeypatch.setattr(import_module("testfield.measure.photographs"), "compare_halves", lambda *_: NO_HALVES)


def proposed_file(tmp_path: Path, moved: bool = True) -> tuple[Path, tuple[str, ...], list[Found]]:
    names, found = photographed((False, moved))
    proposal = propose(names, found, SIZE)
    file = tmp_path / "FIELD.toml"
    file.write_text(field_text(proposal, {"kind": "ring14"}, "three boards"), encoding="utf-8")
    return file, names, found


def test_boards_that_were_moved_are_told_apart_and_keep_their_shape(tmp_path: Path) -> None:
    names, found = photographed()
    proposal = propose(names, found, SIZE)
    assert proposal.arranged.setting.tolist() in ([0] * 5 + [1] * 5, [1] * 5 + [0] * 5)
    assert [sorted(group.code.tolist()) for group in sorted(proposal.groups, key=lambda g: g.code.min())] == [
        sorted(codes.tolist()) for codes, _ in boards().values()
    ]
    assert len({group.body for group in proposal.groups}) == 3
    for group in proposal.groups:
        true = next(flat for codes, flat in boards().values() if codes[0] == group.code[0])
        ratio = pdist(group.xyz) / pdist(true)
        assert np.ptp(ratio) < 0.002 * ratio.mean()


@pytest.mark.slow
def test_single_tags_that_were_moved_are_boards_by_their_corners_and_are_measured(
    tmp_path: Path, no_halves: None
) -> None:
    names, found = photographed()
    tags = []
    for one in found:  # four codes are the corners of one tag, five tags' numbers a board's
        board, k = np.divmod(one.observations.code - 1, 20)
        tags.append(replace(one, observations=replace(one.observations, code=5 * board + k // 4, point=k % 4)))
    kind = "aruco:DICT_4X4_50"
    proposal = propose(names, as_coded(tags)[0], SIZE)
    assert sorted(sorted(group.code.tolist()) for group in proposal.groups) == [
        [10 * tag + c for tag in range(5 * board, 5 * board + 4) for c in (1, 2, 3, 4)] for board in range(3)
    ]
    file = tmp_path / "FIELD.toml"
    file.write_text(field_text(proposal, {"kind": kind}, "tags"), encoding="utf-8")
    result = measure(names, tags, SIZE, load_field_file(file), parse_target(kind))
    assert len(set((result.points.code // TIME).tolist())) == 2  # what was moved has points of its own each time
    assert len(result.calibration.station_names) == len(names)
    assert len(result.calibration.rejected) <= 0.01 * result.calibration.used


def test_where_nothing_moved_each_plane_is_a_board() -> None:
    still = stood(False)
    before = propose(*photographed((False, False), each=4), SIZE)
    assert not before.arranged.moved and len(before.groups) == 3  # three planes
    assert set(still) == {int(c) for group in before.groups for c in group.code}


def test_a_lens_of_strong_distortion_is_not_taken_for_a_motion() -> None:
    names, found = photographed((False, False))
    ties, _ = coded_ties(Observations.join([one.observations for one in found], names))
    middle = (np.array(SIZE) - 1) / 2
    off = (ties.xy_px - middle) / 4000
    bent = replace(ties, xy_px=middle + 4000 * off * (1 - 0.15 * (off**2).sum(axis=1, keepdims=True)))
    assert not arranged(bent, SIZE, "brown").moved


def test_a_proposed_file_is_measured_as_it_is_and_with_one_distance_gives_lengths(
    tmp_path: Path, no_halves: None
) -> None:
    file, names, found = proposed_file(tmp_path)
    target = parse_target("ring14")
    plain = measure(names, found, SIZE, load_field_file(file), target)
    assert "ARBITRARY" in plain.datum
    assert len(plain.calibration.station_names) == len(names)
    assert len(plain.calibration.rejected) <= 0.01 * plain.calibration.used
    text = file.read_text(encoding="utf-8")
    a, b = (int(v) for v in text.split("# codes = [")[1].split("]")[0].split(","))
    place = stood(False)
    length = float(np.linalg.norm(place[a] - place[b]))  # both on one board
    filled = text.replace("# [[distances]]", "[[distances]]").replace("# codes =", "codes =")
    filled = filled.replace("# length_mm = ", f"length_mm = {length}").replace("# u_mm = 0.1", "u_mm = 0.02")
    file.write_text(filled, encoding="utf-8")
    result = measure(names, found, SIZE, load_field_file(file), target)
    assert result.lengths and not result.calibration.failures
    points, apart = result.points, {}
    for codes, flat in boards().values():
        for k in range(1, 16):
            rows = points.rows([int(codes[0]), int(codes[k])])
            measured, u = points.distance(*rows)
            apart[int(codes[k])] = (measured - np.linalg.norm(flat[k] - flat[0])) / u
    z = np.array(list(apart.values()))
    assert 0.4 < np.sqrt((z**2).mean()) < 1.8


def test_stickers_may_be_missing_unknown_ones_are_free_and_a_moved_one_is_named(
    tmp_path: Path, no_halves: None
) -> None:
    file, names, found = proposed_file(tmp_path, moved=False)
    field = load_field_file(file)
    groups = [group.model_dump() for group in field.groups]
    first = groups[0]["points"]
    gone, stray = int(first[0]["code"]), int(first[5]["code"])
    first[0]["code"] = 999  # no photograph shows it, and the code that it was stands in no board
    first[5]["xyz"] = tuple(np.array(first[5]["xyz"]) + [0, 120, 0])
    changed = FieldFile.model_validate(field.model_dump() | {"groups": groups})
    result = measure(names, found, SIZE, changed, parse_target("ring14"))
    said = " ".join(result.calibration.notes)
    assert gone in result.points.code
    assert "999" in said and f"code {stray} by" in said


def test_planes_of_two_walls_are_two_boards_and_noise_is_none() -> None:
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(6) * 200.0, np.arange(5) * 200.0)
    flat = np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(-60, 60, (30, 2))
    a, b = np.column_stack([flat, np.zeros(30)]), np.column_stack([np.full(30, 1250.0), flat])
    plane = planes(np.vstack([a, b]), np.full(60, 2.0), np.full(60, 0.1))
    assert len(set(plane[:30])) == 1 and len(set(plane[30:])) == 1 and plane[0] != plane[-1]
    # A third board that the second's plane runs through keeps its codes.
    through = np.column_stack([1248 + 0.2 * flat[:, 0], 1150 + flat[:, 1], 300 - flat[:, 0] * 0.5])
    crossed = planes(np.vstack([b, through]), np.full(60, 2.0), np.full(60, 0.1))
    assert len(set(crossed[:30])) == 1 and (crossed[30:] != crossed[0]).all()
    cloud = planes(rng.uniform(0, 1000, (30, 3)), np.full(30, 1.0), np.full(30, 0.1))
    assert (cloud < 0).all()


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="the real photographs (../shared/real) are not here")
def test_a_plate_in_three_photographs_becomes_one_board(tmp_path: Path) -> None:
    assert main(["field", "new", str(REAL / "ring14_plate"), "--out", str(tmp_path)]) == 0
    field = load_field_file(tmp_path / "FIELD.toml")
    assert len(field.groups[0].points) >= 50
    assert all(2 <= point.code <= 74 for group in field.groups for point in group.points)
    assert (tmp_path / "board_1.png").is_file() and (tmp_path / "photograph.png").is_file()
