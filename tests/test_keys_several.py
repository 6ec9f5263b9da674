"""Keys of several cameras, rigs and times: every value counts where it must, for the parts that it belongs to."""

from typing import Any

import numpy as np
import pytest
from conftest import SCENES

from testfield.chain import keys
from testfield.chain.truth import Truth
from testfield.evaluate.case import changed, scene_table
from testfield.scene.camera_parts import CameraPart
from testfield.scene.load import parse_scene
from testfield.scene.parts import parts_of
from testfield.scene.schema import SceneFile

POSE = {
    "generator": "pose",
    "name": "aside",
    "camera": "third",
    "position_mm": [0, -2500, 1200],
    "rotation_deg": [90.0, 0.0, 0.0],
}
MOVE = {"position_mm": [0, -80, 1600], "direction": [1.0, 0.1, 0.0], "normal": [0.0, -1.0, 0.0]}
KINDS = {
    "arc": {"radius_mm": 2600, "height_mm": 1150, "count": 1},
    "ring": {"radius_mm": 300, "centre_mm": [0, -2500, 1200], "count": 1},
    "grid": {"low_mm": [0, -2500, 1200], "high_mm": [0, -2500, 1200], "counts": [1, 1, 1]},
    "random": {"low_mm": [0, -2500, 1200], "high_mm": [1, -2500, 1200], "count": 1},
    "single": {"position_mm": [0, -2500, 1200]},
}


def base(kind: str = "arc") -> dict[str, Any]:
    """A rig of two cameras at one place, a third camera beside it, and a bar that is moved once."""
    table = scene_table(SCENES / "stereo_rig.toml")
    third = table["cameras"][0] | {"name": "third"}
    station = {"generator": kind, "rig": "bar", "look_at_mm": [0, -100, 1050], **KINDS[kind]}
    bars = [table["scale_bars"][0] | {"moves": [MOVE]}, table["scale_bars"][1]]
    return table | {"cameras": [*table["cameras"], third], "stations": [station, POSE], "scale_bars": bars}


def scene_of(table: dict[str, Any]) -> SceneFile:
    import tomli_w

    return parse_scene(tomli_w.dumps(table), "several.toml")


def keys_of(table: dict[str, Any]) -> dict[str, dict[tuple[str, int], Any]]:
    """Of every stage the keys of each part, by camera and time; the calibration has one of all."""
    scene = scene_of(table)
    truth = Truth.of(scene, "several.toml")
    found: dict[str, dict[tuple[str, int], Any]] = {"render": {}, "expose": {}, "calibrate": {}}
    for part, world in zip(truth.parts, truth.worlds, strict=True):
        own = part.camera, part.time
        found["render"][own] = keys.render_keys(part.scene, world).images
        found["expose"][own] = keys.expose_key(part.scene, world.station_name[0], "radiance", part.sensor_seed)
    found["calibrate"]["all", 0] = keys.calibrate_key(scene, truth.told, "observations")
    return found


LEFT, RIGHT, THIRD = "left", "right", "third"
TABLE: list[tuple[str, Any, dict[str, set[str]]]] = [
    ("cameras.1.focal_length_mm", 8.3, {"render": {RIGHT}}),
    ("cameras.1.f_number", 9, {"expose": {RIGHT}}),
    ("cameras.1.sensor", {"read_noise_e": 5}, {"expose": {RIGHT}}),
    ("cameras.1.exposure", {"time_ms": 5}, {"expose": {RIGHT}}),
    ("cameras.1.width_px", 1300, {"render": {RIGHT}, "calibrate": {"all"}}),
    ("rigs.0.cameras.0.position_mm", [-310, 0, 0], {"render": {LEFT}, "calibrate": {"all"}}),
    ("rigs.0.cameras.1.rotation_deg", [0, -9, 0], {"render": {RIGHT}, "calibrate": {"all"}}),
    ("rigs.0.cameras.1.u_position_mm", 0.6, {"calibrate": {"all"}}),
    ("rigs.0.cameras.1.u_rotation_deg", 0.3, {"calibrate": {"all"}}),
    ("stations.1.position_mm", [0, -2600, 1200], {"render": {THIRD}}),
    ("stations.1.rotation_deg", [90, 0, 5], {"render": {THIRD}}),
    ("stations.1.name", "apart", {"render": {THIRD}, "expose": {THIRD}}),
]


def stated(table: dict[str, Any]) -> dict[str, Any]:
    """With a stated relative orientation, so that its uncertainties can change."""
    return changed(table, {"rigs.0.cameras.1.u_position_mm": 0.5, "rigs.0.cameras.1.u_rotation_deg": 0.2})


@pytest.mark.parametrize(("path", "value", "expected"), TABLE, ids=[line[0] for line in TABLE])
def test_a_value_of_one_camera_changes_its_own_keys_and_no_other(path: str, value: Any, expected: dict) -> None:
    old, new = keys_of(stated(base())), keys_of(changed(stated(base()), {path: value}))
    found = {stage: {own[0] for own in old[stage] if new[stage].get(own) != old[stage][own]} for stage in old}
    assert {stage: who for stage, who in found.items() if who} == expected


@pytest.mark.parametrize("field", ["position_mm", "direction", "normal"])
def test_where_a_bar_is_moved_to_changes_the_images_of_that_time_alone(field: str) -> None:
    value = {"position_mm": [0, -90, 1600], "direction": [1, 0.2, 0], "normal": [0.1, -1, 0]}[field]
    old, new = keys_of(base())["render"], keys_of(changed(base(), {f"scale_bars.0.moves.0.{field}": value}))["render"]
    assert {time for camera, time in old if new[camera, time] != old[camera, time]} == {1}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_station_takes_a_rig_or_a_camera(kind: str) -> None:
    rigged = parts_of(scene_of(base(kind)))
    assert {part.camera for part in rigged} == {LEFT, RIGHT, THIRD}
    alone = changed(base(kind), {"stations.0.camera": THIRD})
    del alone["stations"][0]["rig"]
    alone["rigs"] = []
    assert {part.camera for part in parts_of(scene_of(alone))} == {THIRD}


def test_a_named_camera_hands_on_every_field_of_its_body() -> None:
    other = {
        "aspect": 1.1,
        "diffraction": True,
        "focus_mm": 3000.0,
        "natural_vignetting": True,
        "psf_sigma_px": 0.7,
        "principal_point_offset_px": (1.0, 2.0),
        "vignetting": (0.1, 0.0, 0.0),
        "lens": "rational",
        "k4": 0.01,
        "s1": 0.001,
    }
    scene = scene_of(base())
    camera = scene.cameras[2].model_copy(update=other)
    (part,) = [
        one
        for one in parts_of(scene.model_copy(update={"cameras": (*scene.cameras[:2], camera)}))
        if (one.camera, one.time) == (THIRD, 0)
    ]
    for field in CameraPart.model_fields:
        assert getattr(part.scene.camera, field) == getattr(camera, field), field


def test_cameras_of_one_scene_have_fixed_patterns_of_their_own() -> None:
    seeds = {part.camera: part.sensor_seed for part in parts_of(scene_of(base()))}
    assert len(set(seeds.values())) == 3
    assert np.unique([part.scene.seed for part in parts_of(scene_of(base()))]).size == 1
