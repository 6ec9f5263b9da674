"""Figures of several cameras and of rigs, on cards, pages and in measurements, against arithmetic by hand."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hand_made import HandMade, Page
from scipy.spatial.transform import Rotation

from testfield.calibrate.calibration import Calibration
from testfield.camera.images import Frame, SensorSheet
from testfield.camera.interior import Interior
from testfield.detect.observations import MEASURED
from testfield.measure.photographs import Measurement
from testfield.report.measured import write_measurement
from testfield.report.page import write_report
from testfield.scene.camera_parts import RigMemberPart, RigPart
from testfield.scene.load import load_scene
from testfield.scene.world import World
from testfield.score.camera import score_camera
from testfield.score.scorecard import scorecard, write_scorecard
from testfield.score.several import OF_ONE, score_cameras, score_rigs
from testfield.targets.field_file import FieldFile

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
AXES = ("rx", "ry", "rz", "tx", "ty", "tz")
BAR = RigPart(
    name="bar",
    cameras=(
        RigMemberPart(camera="near", position_mm=(10, 0, 0)),
        RigMemberPart(camera="far", position_mm=(410, 0, 0), rotation_deg=(0, 90, 0)),
    ),
)
"""Far stands 400 mm right of near and looks to the right, so that near stands 400 mm behind it."""


@pytest.fixture(scope="module")
def two(by_hand: HandMade) -> Calibration:
    """The hand-made calibration as that of near, which took left; far, which took right, is off by 5 px in fx."""
    c = by_hand.calibration
    far = Interior(1000, 800, np.array([2005.0, 2000, 499.5, 399.5, 0, 0, 0, 0, 0]))
    own = {"cx", "fx", "fy"}
    labels = (
        *(f"camera:near.{label}" if label in own else label for label in c.labels),
        "camera:far.fx",
        *(f"member:bar/far.{axis}" for axis in AXES),
    )
    u = [2.0, 1e-4, 2e-4, 2e-4, 0.2, 0.3, 0.6]  # far's fx; turns of the rig in rad, shifts in mm
    n = len(c.labels)
    covariance = np.zeros((len(labels), len(labels)))
    covariance[:n, :n], covariance[n:, n:] = c.covariance, np.diag(np.square(u))
    return replace(
        c,
        labels=labels,
        covariance=covariance,
        more_cameras=(far,),
        camera_names=("near", "far"),
        image_camera=np.array([0, 1]),
        residual_camera=np.array([0, 0, 1, 0, 1, 1, 1]),
        residual_at_px=np.array([[100.0, 100], [900, 150], [510, 710], [500, 700], [90, 110], [910, 160], [480, 300]]),
        residual_px=np.array([[0.1, 0.0]] * 7),
        rigs=(rig(),),
    )


def rig() -> dict[str, Any]:
    """Far turned 0.3 mrad too far about x, and shifted by (0.2, -0.6, 0.9) mm."""
    right = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])  # its axes as rows: x backward, y down, z to near's right
    turn = Rotation.from_rotvec([0.0003, 0, 0]).as_matrix() @ right
    t_mm = np.array([0.2, -0.6, -400 + 0.9])
    return {
        "rig": "bar",
        "camera": "far",
        "turn_rad": Rotation.from_matrix(turn).as_rotvec().tolist(),
        "t_mm": t_mm.tolist(),
    }


@pytest.fixture(scope="module")
def worlds(by_hand: HandMade) -> dict[str, World]:
    """What near and far see: far's true camera has a focal length of 2000 px."""
    long = Interior(1000, 800, np.array([2000.0, 2000, 499.5, 399.5, 0, 0, 0, 0, 0]))
    return {"near": by_hand.world, "far": replace(by_hand.world, interior=long)}


def test_the_relative_orientation_of_a_rig_is_compared_in_mrad_and_mm(two: Calibration) -> None:
    (one,) = score_rigs((BAR,), two)
    assert (one["rig"], one["camera"]) == ("bar", "far")
    assert one["rotation_error_mrad"] == pytest.approx(0.3, rel=1e-7)
    assert one["translation_error_mm"] == pytest.approx(1.1, rel=1e-9)  # 0.04 + 0.36 + 0.81
    assert one["u_rotation_mrad"] == pytest.approx(0.3, rel=1e-9)  # 0.01 + 0.04 + 0.04
    assert one["u_translation_mm"] == pytest.approx(0.7, rel=1e-9)  # 0.04 + 0.09 + 0.36
    # x: 0.3 mrad under 0.1; 0.2 mm under 0.2, 0.6 under 0.3, 0.9 under 0.6
    assert one["anees"] == pytest.approx((9 + 1 + 4 + 2.25) / 6, rel=1e-6)


def test_each_camera_has_its_own_figures_and_the_worst_stands_in_front(
    by_hand: HandMade, two: Calibration, worlds: dict[str, World]
) -> None:
    card = score_cameras(worlds, two)
    near, far = card["cameras"]["near"], card["cameras"]["far"]
    alone = score_camera(by_hand.world, by_hand.calibration)
    assert near.keys() == far.keys() == set(OF_ONE)
    # Three of the seven residuals are near's: those that it has alone.
    assert {key: near[key] for key in ("interior_error", "interior_u")} == {
        key: alone[key] for key in ("interior_error", "interior_u")
    }
    assert near["corner_errors_px"] == alone["corner_errors_px"]
    for key in ("interior_anees", "imaging_error_px", "imaging_u_px", "imaging_anees"):
        assert near[key] == pytest.approx(alone[key], rel=1e-9), key
    assert far["interior_error"] == {"fx": pytest.approx(5.0)} and far["interior_u"] == {"fx": pytest.approx(2.0)}
    assert far["interior_anees"] == pytest.approx(6.25)
    assert far["corner_error_px"] > near["corner_error_px"]
    assert card["corner_error_px"] == far["corner_error_px"] and card["interior_anees"] == far["interior_anees"]
    assert (card["observations"], card["rejected"]) == (321, 2)


def test_card_and_page_show_every_camera_and_the_rig(
    by_hand: HandMade, two: Calibration, worlds: dict[str, World], tmp_path: Path
) -> None:
    folder = tmp_path
    names = [folder / name for name in ("observations.parquet", "calibration.json", "points.parquet")]
    by_hand.observations.save(names[0])
    two.save(names[1])
    by_hand.points.save(names[2])
    card = scorecard(by_hand.world, by_hand.views, *names, worlds, (BAR,))
    assert card["rigs"] == score_rigs((BAR,), two)
    write_scorecard(card | {"time_s": {"render": 1.5}}, folder / "scorecard.json")
    (folder / "frames").mkdir()
    grey = np.full((800, 1000), 900, np.uint16)
    Frame("left", grey, SensorSheet(2.6, 2.3, 64.0, 12)).save(folder / "frames/left.png")
    write_report(by_hand.world, by_hand.views, load_scene(QUICK), folder, {}, folder / "report.html", worlds)
    page = Page((folder / "report.html").read_text(encoding="utf-8"))
    near = {row[0]: row[1:] for row in page.table("camera near", "true", "found")}
    far = {row[0]: row[1:] for row in page.table("camera far", "true", "found")}
    assert near["fx"] == ["1000.0000", "1001.0000", "1", "1"] and near["cx"] == ["499.5000", "499.8000", "0.3", "0.1"]
    assert far["fx"] == ["2000.0000", "2005.0000", "5", "2"] and far["cx"] == ["499.5000", "499.5000", "0", "–"]
    assert page.table("relative orientation", "rotation error, mrad") == [
        ["bar: far", "0.3000", "0.3000", "1.1000", "0.7000", "2.71"],
    ]


def test_a_measurement_tells_every_camera_and_the_rig(by_hand: HandMade, two: Calibration, tmp_path: Path) -> None:
    o = by_hand.observations
    o = replace(o, point=np.where(o.status == MEASURED, 0, -1))
    for name in o.stations:
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((800, 1000), 90, np.uint8))
    field = FieldFile.model_validate({"target": {"kind": "ring14"}})
    summary = write_measurement(Measurement(o, two, by_hand.points, (), "by hand"), field, tmp_path, ("a.jpg", "b.jpg"))
    assert json.loads((tmp_path / "measurement.json").read_text(encoding="utf-8"))["rigs"] == summary["rigs"]
    assert list(summary["cameras"]) == ["near", "far"]
    assert summary["cameras"]["near"]["interior_u"] == pytest.approx({"cx": 0.1, "fx": 1.0, "fy": 1.0})
    assert summary["cameras"]["far"]["interior_u"] == pytest.approx({"fx": 2.0})
    assert (summary["cameras"]["near"]["interior"]["fx"], summary["cameras"]["far"]["interior"]["fx"]) == (1001, 2005)
    (one,) = summary["rigs"]
    assert one["u_turn_rad"] == pytest.approx(3e-4, rel=1e-9) and one["u_mm"] == pytest.approx(0.7, rel=1e-9)
    assert "1001.00, 2005.00 px" in [value for _, value in summary["figures"]]
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert ["fx", "2005.000", "2"] in page.table("camera far", "found", "u")
    assert ["fx", "1001.000", "1"] in page.table("camera near", "found", "u")
    turn, t = (np.array(rig()[key]) for key in ("turn_rad", "t_mm"))
    assert page.table("relative orientation", "turn x, mrad") == [
        ["bar: far", *(f"{1000 * v:.3f}" for v in turn), *(f"{v:.3f}" for v in t), "0.7000"]
    ]


def test_a_rig_whose_covariance_nobody_states_has_errors_and_no_nees(two: Calibration) -> None:
    n = len(two.labels) - 6
    silent = replace(two, labels=two.labels[:n], covariance=two.covariance[:n, :n])
    (one,) = score_rigs((BAR,), silent)
    assert one["rotation_error_mrad"] == pytest.approx(0.3, rel=1e-7)
    assert one["translation_error_mm"] == pytest.approx(1.1, rel=1e-9)
    assert all(np.isnan(one[key]) for key in ("u_rotation_mrad", "u_translation_mm", "anees"))


def test_a_turn_about_all_axes_counts_them_all(two: Calibration) -> None:
    right = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    turn = Rotation.from_rotvec([0.0002, -0.0003, 0.0006]).as_matrix() @ right
    turned = rig() | {"turn_rad": Rotation.from_matrix(turn).as_rotvec().tolist()}
    (one,) = score_rigs((BAR,), replace(two, rigs=(turned,)))
    assert one["rotation_error_mrad"] == pytest.approx(0.7, rel=1e-7)
    # 0.2 mrad under 0.1, 0.3 and 0.6 under 0.2; the shifts as before
    assert one["anees"] == pytest.approx((4 + 2.25 + 9 + 1 + 4 + 2.25) / 6, rel=1e-6)
