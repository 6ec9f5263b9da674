"""Cameras and points that programs and files give: several cameras, and reconstructors, true ones and wrong ones."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from several_cameras import stereo

from testfield.chain.run import Run
from testfield.chain.truth import Truth
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.pipeline import Measured, measure
from testfield.measure.recipe import Recipe
from testfield.score.points import score_points
from testfield.score.several import score_cameras, score_rigs


@pytest.fixture(scope="module")
def rig() -> tuple[Truth, Observations]:
    return stereo(4)


def true_cameras(truth: Truth, poses: bool) -> dict[str, Any]:
    """The file of the true cameras, with or without true poses."""
    world = truth.world
    found: dict[str, Any] = {"cameras": {name: one.interior.to_json() for name, one in truth.cameras.items()}}
    if poses:
        for key, names, at in (
            ("stations", world.station_name, world.camera_from_world),
            ("boards", [board.name for board in world.field.boards], world.world_from_board),
        ):
            found[key] = {
                name: {"R": R.tolist(), "t_mm": t.tolist()} for name, R, t in zip(names, at.R, at.t_mm, strict=True)
            }
    return found


def given(rig: tuple[Truth, Observations], folder: Path, file: dict[str, Any]) -> Measured:
    """What is measured with the cameras of a file, which a program hands on."""
    (folder / "own.json").write_text(json.dumps(file))
    (folder / "own.toml").write_text('[calibrator]\ncommand = "cp own.json {json}"\n')
    return measure(rig[1], rig[0].told, Recipe.load(folder / "own.toml"))


def test_several_true_cameras_that_a_program_gives_have_no_error(
    rig: tuple[Truth, Observations], tmp_path: Path
) -> None:
    truth, _ = rig
    own = measure(rig[1], truth.told, Recipe())
    for poses, tolerance_mm in ((False, 0.5), (True, 0.1)):
        file = true_cameras(truth, poses)
        found = given(rig, tmp_path, file)
        card = score_cameras(truth.cameras, found.calibration)
        assert set(card["cameras"]) == {"left", "right"} and card["corner_error_px"] < 1e-6
        points = score_points(truth.world, found.calibration, found.points)
        assert len(points.code) >= 12
        assert np.abs(points.fitted_mm).max() < tolerance_mm, poses
        of = dict(zip(found.calibration.station_names, found.calibration.image_camera, strict=True))
        assert all(found.calibration.camera_names[k] in name for name, k in of.items())
    rigs = [one | {"turn_rad": list(one["turn_rad"]), "t_mm": list(one["t_mm"])} for one in own.calibration.rigs]
    again = given(rig, tmp_path, file | {"rigs": rigs})
    (a,), (b,) = (score_rigs(truth.scene.rigs, one.calibration) for one in (again, own))
    assert a["translation_error_mm"] == pytest.approx(b["translation_error_mm"])
    file["cameras"]["left"]["fx"] += 5  # a wrong one loses
    wrong = score_cameras(truth.cameras, given(rig, tmp_path, file).calibration)
    assert wrong["cameras"]["left"]["corner_error_px"] > 0.1 > wrong["cameras"]["right"]["corner_error_px"]


def test_cameras_that_are_not_the_field_sheet_s_are_named(rig: tuple[Truth, Observations], tmp_path: Path) -> None:
    file = true_cameras(rig[0], False)["cameras"]
    rigs = [{"rig": "bar", "camera": "middle", "turn_rad": [0, 0, 0], "t_mm": [0, 0, 0]}]
    for wrong, said in (
        ({"interior": file["left"]}, "one `interior`.*2 cameras.*left, right"),
        ({"cameras": {"left": file["left"]}}, "no camera 'right'"),
        ({"cameras": file | {"rihgt": file["right"]}}, "'rihgt'.*right"),
        ({"cameras": file | {"right": file["right"] | {"width_px": 99}}}, "cameras.right.width_px"),
        ({"cameras": file, "interior": file["left"]}, "exclude each other"),
        ({"cameras": file, "rigs": rigs}, "'middle'"),
        ({"cameras": file, "labels": ["fx"], "covariance": [[1]]}, "camera:left.fx"),
        ({}, "cameras"),
    ):
        with pytest.raises(TestfieldError, match=said) as error:
            given(rig, tmp_path, wrong)
        assert "cp, camera.json" in error.value.sentence(), said


HEAD = "code,x_mm,y_mm,z_mm"
WRONG = {
    "a crash": ("echo 'no rays' >&2; exit 4", ("exit status 4", "no rays")),
    "silence": ("true", ("wrote no result",)),
    "nonsense": ("echo Hello > $1", ("no column code",)),
    "NaN": (f"printf '{HEAD}\\n1,2,3,4\\n2,nan,3,4\\n' > $1", ("line 3", "x_mm = nan")),
    "a word": (f"printf '{HEAD}\\n1,2,3,4\\n2,5,about 3,4\\n' > $1", ("line 3", "y_mm", "about 3")),
    "half a code": (f"printf '{HEAD}\\n1.5,2,3,4\\n' > $1", ("line 2", "code")),
    "twice": (f"printf '{HEAD}\\n7,2,3,4\\n7,2,3,4\\n' > $1", ("code '7' occurs twice",)),
    "beyond all size": (f"printf '{HEAD}\\n7,2,3,1e300\\n' > $1", ("line 2", "z_mm = 1e+300")),
    "no uncertainty": (f"printf '{HEAD},u_x_mm,u_y_mm,u_z_mm\\n7,2,3,1,1,-1,1\\n' > $1", ("line 2", "u_y_mm = -1")),
    "a million rows": (f"(echo {HEAD}; yes 1,2,3,4 | head -n 1000000) > $1", ("1,000,000 rows",)),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_a_reconstructing_program_does_wrong_is_said_in_one_sentence(name: str, tiny: Run, tmp_path: Path) -> None:
    body, words = WRONG[name]
    (tmp_path / "own").write_text(f"#!/bin/sh\n{body}\n")
    (tmp_path / "own").chmod(0o755)
    (tmp_path / "own.toml").write_text('[reconstructor]\ncommand = "own {csv}"\n')
    seen = Observations.load(tiny.folder / "observations.parquet", tiny.field)
    with pytest.raises(TestfieldError) as error:
        measure(seen, tiny.field, Recipe.load(tmp_path / "own.toml"))
    said = error.value.sentence()
    assert all(word in said for word in ("own, ", *words)), said
    assert "\n" not in said and len(said) < 500


def test_a_reconstructing_program_gets_all_that_there_is_and_its_uncertainty_counts(tiny: Run, tmp_path: Path) -> None:
    seen = Observations.load(tiny.folder / "observations.parquet", tiny.field)
    own = measure(seen, tiny.field, Recipe())
    u = np.sqrt(np.diag(own.points.cov_xyz_mm2)).reshape(-1, 3)
    rows = zip(own.points.code, np.hstack([own.points.xyz_mm, u]).tolist(), strict=True)
    text = f"{HEAD},u_x_mm,u_y_mm,u_z_mm\n" + "".join(f"{c},{','.join(map(repr, v))}\n" for c, v in rows)
    (tmp_path / "told.csv").write_text(text)
    (tmp_path / "own").write_text('#!/bin/sh\ntest -s "$1" && test -s "$2" && test -s "$3" && cp told.csv "$4"\n')
    (tmp_path / "own").chmod(0o755)
    command = '[reconstructor]\ncommand = "own {observations} {calibration} {sheet} {csv}"\n'
    (tmp_path / "own.toml").write_text(command)
    found = measure(seen, tiny.field, Recipe.load(tmp_path / "own.toml")).points
    assert found.method == "own" and np.array_equal(found.xyz_mm, own.points.xyz_mm)
    assert np.allclose(np.diag(found.cov_xyz_mm2), np.diag(own.points.cov_xyz_mm2)) and found.states_u
