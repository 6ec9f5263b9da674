"""Programs, loaded files and results made elsewhere: what they give is measured, what goes wrong is said by name."""

import json
import os
import stat
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from testfield import registry
from testfield.camera.images import Frame, SensorSheet
from testfield.chain.run import Run
from testfield.cli.main import main
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.detector import eight_bits, pgm
from testfield.measure.pipeline import detect, detect_all, measure
from testfield.measure.recipe import Recipe
from testfield.measure.results import EXPORT, image_digest, recipe_at
from testfield.score.scorecard import plain, score_measured
from testfield.store.code import code_digest

HEAD = "x_px,y_px,code,board,point\n"
CRASH = "echo reading; echo 'cannot read: no PNG' >&2; exit 3"


pytestmark = pytest.mark.usefixtures("forget_ones_own")


@pytest.fixture(scope="module")
def frame(tiny: Run) -> Frame:
    name = tiny.stations[0]
    return Frame.load(tiny.folder / f"frames/{name}.png", name)


def program(folder: Path, body: str, more: str = "") -> Recipe:
    """A recipe whose detector is a shell script."""
    script = folder / "own_detector"
    script.write_text(f"#!/bin/sh\n{body}\n")
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    (folder / "own.toml").write_text(f'[detector]\ncommand = "own_detector {{image}} {{csv}}"\n{more}')
    return Recipe.load(folder / "own.toml")


def table(seen: Observations) -> str:
    rows = zip(seen.xy_px.tolist(), seen.code, seen.board, seen.point, strict=True)
    return HEAD + "".join(f"{x!r},{y!r},{c},{b},{p}\n" for (x, y), c, b, p in rows)


def test_what_a_program_writes_is_observed(tiny: Run, frame: Frame, tmp_path: Path) -> None:
    own = detect(frame, tiny.field, Recipe()).measured
    (tmp_path / "told.csv").write_text(table(own))
    recipe = program(tmp_path, 'test -s "$1" && cp told.csv "$2"')
    found = detect(frame, tiny.field, recipe)
    assert np.array_equal(found.xy_px, own.xy_px) and np.array_equal(found.point, own.point)
    assert not found.states_u.any() and (found.status == "measured").all()


def test_centres_without_names_get_those_of_the_marks_that_are_there(tiny: Run, frame: Frame, tmp_path: Path) -> None:
    own = detect(frame, tiny.field, Recipe()).measured
    moved = own.xy_px + np.random.default_rng(1).uniform(-0.5, 0.5, own.xy_px.shape)
    lines = "".join(f"{x!r},{y!r}\n" for x, y in moved.tolist())
    (tmp_path / "told.csv").write_text("x_px,y_px\n" + lines + "1.5,2.5\n")
    found = detect(frame, tiny.field, program(tmp_path, 'cp told.csv "$2"'))
    assert np.array_equal(found.xy_px[:-1], moved)
    for name in ("code", "board", "point"):
        assert np.array_equal(getattr(found, name)[:-1], getattr(own, name))
    assert found.code[-1] == 0 and found.board[-1] == -1


def test_the_time_of_a_program_is_told_without_our_naming(tiny: Run, tmp_path: Path) -> None:
    from testfield.evaluate.compared import Until, _measured

    frames = [Frame.load(tiny.folder / f"frames/{name}.png", name) for name in tiny.stations]
    for k, frame in enumerate(frames):
        own = detect(frame, tiny.field, Recipe()).measured
        rows = "".join(f"{x!r},{y!r}\n" for x, y in own.xy_px.tolist())
        (tmp_path / f"{k}.csv").write_text("x_px,y_px\n" + rows)
    recipe = program(tmp_path, 'sleep 0.05; cat 0.csv > "$2"')
    row = _measured(frames, tiny, recipe, Until.DETECT)
    assert row["time_naming_s"] > 0 and row["time_detect_s"] > 0.2
    begun = time.perf_counter()
    again = _measured(frames, tiny, recipe, Until.DETECT)
    both = again["time_naming_s"] + again["time_detect_s"]
    assert both < time.perf_counter() - begun and again["cpu_detect_s"] < both
    assert "time_naming_s" not in _measured(frames, tiny, Recipe(), Until.DETECT)


@pytest.mark.parametrize("black", [64, 64.0])
def test_eight_bits_go_from_black_to_full_and_a_pgm_holds_every_pixel(black: float) -> None:
    pixels = np.array([[0, 64, 2079, 4095]] * 2, np.uint16)
    frame = Frame("one", pixels, SensorSheet(2.6, 2.3, black, 12))
    assert eight_bits(frame)[0].tolist() == [0, 0, 127, 255]
    head, data = pgm(frame).split(b"65535\n")
    assert head == b"P5\n4 2\n" and np.array_equal(np.frombuffer(data, ">u2").reshape(2, 4), pixels)


WRONG = {
    "a crash": (CRASH, ("exit status 3", "cannot read: no PNG")),
    "a signal": ("kill -SEGV $$", ("SIGSEGV",)),
    "silence": ("exit 0", ("wrote no result",)),
    "nonsense": ('echo "Hello, world" > "$2"', ("no columns x_px, y_px",)),
    "binary nonsense": ('head -c 5000 /dev/urandom > "$2"', ("centres.csv",)),
    "NaN": (f'printf "{HEAD}1,2,1,-1,-1\\nnan,3,2,-1,-1\\n" > "$2"', ("line 3", "x_px")),
    "infinity": (f'printf "{HEAD}inf,3,2,-1,-1\\n" > "$2"', ("line 2", "x_px", "not a finite number")),
    "a word": (f'printf "{HEAD}1,2,1,-1,-1\\nabout 7,3,2,-1,-1\\n" > "$2"', ("line 3", "x_px", "about 7")),
    "another board": (f'printf "{HEAD}1,2,0,4,1\\n" > "$2"', ("line 2", "board = 4")),
    "a million rows": (
        f'(printf "{HEAD}"; yes 1,2,1,-1,-1 | head -n 1000000) > "$2"',
        ("1,000,000 rows",),
    ),
    "far outside": (f'printf "{HEAD}9000,2,1,-1,-1\\n" > "$2"', ("x_px = 9000", "far outside")),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_goes_wrong_with_a_program_is_said_in_one_sentence(
    name: str, tiny: Run, frame: Frame, tmp_path: Path
) -> None:
    body, words = WRONG[name]
    with pytest.raises(TestfieldError) as error:
        detect(frame, tiny.field, program(tmp_path, body))
    said = error.value.sentence()
    for word in ("own_detector", frame.station, *words):
        assert word in said
    assert len(said) < 700 and "\n" not in said


def test_a_program_that_hangs_is_ended_with_all_that_it_started(tiny: Run, frame: Frame, tmp_path: Path) -> None:
    recipe = program(tmp_path, "sleep 60 & echo $! > child; echo waiting; wait", "time_limit_s = 0.5\n")
    begun = time.monotonic()
    with pytest.raises(TestfieldError, match=r"did not end within 0.5 s and says 'waiting'"):
        detect(frame, tiny.field, recipe)
    assert time.monotonic() - begun < 20
    child = int((tmp_path / "child").read_text())
    stopped = not Path(f"/proc/{child}").exists() or "Z" in Path(f"/proc/{child}/stat").read_text().split()[2]
    assert stopped


def test_a_program_that_writes_without_end_is_ended(
    tiny: Run, frame: Frame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.modules["testfield.measure.programs"], "MOST_BYTES", 10_000_000)
    with pytest.raises(TestfieldError, match="10,000,000 bytes"):
        detect(frame, tiny.field, program(tmp_path, 'yes > "$2"'))


def test_no_shell_reads_the_command(tiny: Run, frame: Frame, tmp_path: Path) -> None:
    program(tmp_path, 'echo "$@" > said; exit 1')
    (tmp_path / "own.toml").write_text('[detector]\ncommand = "own_detector {csv} ; touch $HOME > x `id`"\n')
    with pytest.raises(TestfieldError):
        detect(frame, tiny.field, Recipe.load(tmp_path / "own.toml"))
    assert (tmp_path / "said").read_text().endswith("; touch $HOME > x `id`\n")
    assert not (tmp_path / "x").exists()


def test_a_recompiled_program_is_another_recipe(tmp_path: Path) -> None:
    first = program(tmp_path, "exit 1")
    assert program(tmp_path, "exit 1") == first
    assert program(tmp_path, "exit 2") != first


BAD = {
    '[detector]\ncommand = "no_such_program {image} {csv}"': ("detector.command", "no_such_program"),
    '[detector]\ncommand = "sh {image}"': ("detector.command", "{csv}"),
    '[detector]\ncommand = "sh {picture} {csv}"': ("detector.command", "{picture}"),
    '[detector]\ncommand = "sh \'{csv}"': ("detector.command", "quotation"),
    '[detector]\ncommand = "sh {csv}"\ntime_limit_s = 0': ("detector.time_limit_s", "value 0"),
    '[detector]\ncommand = "sh {csv}"\nfolder = "x"': ("detector", "command and folder"),
    '[detector]\ncommand = "sh {csv}"\ngain = 3': ("detector", "gain"),
    '[detector]\nfolder = "nowhere"': ("detector.folder", "nowhere"),
    '[detector]\nname = "star"': ("detector", "star"),
    '[centroid]\ncommand = "sh {csv}"': ("centroid", "[detector]"),
    'load = "nowhere.py"': ("load", "nowhere.py"),
    'finder = "mine"': ("finder", "mine"),
    "[environment]\npackages = []": ("environment.packages", "1 or more"),
}


@pytest.mark.parametrize("text", BAD, ids=range(len(BAD)))
def test_a_wrong_recipe_of_ones_own_is_refused_by_file_and_field(text: str, tmp_path: Path) -> None:
    (tmp_path / "r.toml").write_text(text)
    with pytest.raises(TestfieldError) as error:
        Recipe.load(tmp_path / "r.toml")
    for word in ("r.toml", *BAD[text]):
        assert word in error.value.sentence()


OWN = '''
import numpy as np
from testfield import register
from testfield.detect.centre import Centres

@register("centroids", "{name}")
def {name}({arguments}):
    """{doc}"""
    {body}
'''


def own_file(folder: Path, name: str, **parts: str) -> Path:
    told = {
        "arguments": "image_dn, sheet, xy_px, moments_px2, gain=1.0",
        "doc": "Mine.",
        "body": "return Centres.empty(len(xy_px))",
    }
    path = folder / f"{name}_file.py"
    path.write_text(OWN.format(**told | parts, name=name))
    return path


def test_a_file_is_loaded_listed_and_counts_with_what_it_does(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = own_file(tmp_path, "mine", doc="Centres that nobody else has.")
    assert main(["list", "centroids", "--load", str(path)]) == 0
    assert "Centres that nobody else has." in capsys.readouterr().out
    module = registry.module_of("centroids", "mine")
    code_digest.cache_clear()
    before = code_digest(module)
    own_file(tmp_path, "mine", body="return None")
    code_digest.cache_clear()
    assert code_digest(module) != before


def test_a_centroid_that_states_places_alone_finds_the_codes_too(tiny: Run, frame: Frame, tmp_path: Path) -> None:
    whole, places = "found = star(image_dn, sheet, xy_px, moments_px2)", "xy_px=found.xy_px, ok=found.ok"
    body = f"from dataclasses import replace; from testfield.detect.centre_star import star; {whole}"
    seen = {}
    for name, back in (("whole", "found"), ("bare", f"replace(Centres.empty(len(xy_px)), {places})")):
        own_file(tmp_path, name, body=f"{body}; return {back}")
        (tmp_path / f"{name}.toml").write_text(f'load = "{name}_file.py"\n[centroid]\nname = "{name}"\n')
        seen[name] = detect(frame, tiny.field, Recipe.load(tmp_path / f"{name}.toml")).measured
    assert (seen["whole"].code > 0).any()
    assert np.array_equal(seen["bare"].code, seen["whole"].code)
    assert np.array_equal(seen["bare"].xy_px, seen["whole"].xy_px)


SIGNATURES = {
    "too few": ("image_dn, sheet", "cannot be called"),
    "swapped": ("sheet, image_dn, xy_px, moments_px2", "'sheet' where it is given 'image_dn'"),
    "one more": ("image_dn, sheet, xy_px, moments_px2, threshold", "threshold"),
}


@pytest.mark.parametrize("name", SIGNATURES)
def test_a_signature_is_checked_before_anything_is_rendered(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    arguments, said = SIGNATURES[name]
    path = own_file(tmp_path, f"mine_{len(name)}{name[0]}", arguments=arguments)
    from conftest import TINY

    own = path.stem.removesuffix("_file")
    scene = tmp_path / "tiny.toml"
    scene.write_text(TINY.read_text() + f'\n[measure]\ncentroid = "{own}"\n')
    assert main(["validate", str(scene), "--load", str(path)]) == 2
    assert said in capsys.readouterr().err
    (tmp_path / "own.toml").write_text(f'load = "{path.name}"\ncentroid = "{own}"\n')
    with pytest.raises(TestfieldError, match=own):
        Recipe.load(tmp_path / "own.toml")


def test_a_file_that_cannot_be_imported_is_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "broken.py").write_text("import no_such_package\n")
    assert main(["list", "centroids", "--load", str(tmp_path / "broken.py")]) == 2
    said = capsys.readouterr().err
    assert "broken.py" in said and "no_such_package" in said


def test_a_broken_package_is_named_by_list_and_spoils_nothing_else(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    from importlib.metadata import EntryPoint

    broken = EntryPoint("theirs", "no_such_package.module", "testfield.centroids")
    points = registry._points("centroids")
    monkeypatch.setattr(registry, "_points", lambda kind: (*points, broken) if kind == "centroids" else ())
    assert main(["list", "centroids"]) == 0
    said = capsys.readouterr().out
    assert "BROKEN" in said and "no_such_package" in said and "forward_model" in said


def test_a_name_that_is_taken_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TestfieldError, match=r"'star' is there already, in testfield\.detect\.centre_star"):
        registry.load_file(own_file(tmp_path, "star"))


def test_a_crash_of_ones_own_names_the_line(tiny: Run, frame: Frame, tmp_path: Path) -> None:
    path = own_file(tmp_path, "crashing", body="return 1 / (len(xy_px) * 0)")
    (tmp_path / "own.toml").write_text(f'load = "{path.name}"\ncentroid = "crashing"\n')
    with pytest.raises(TestfieldError, match=r"crashing_file\.py, line \d+: centroid 'crashing' crashed.*ZeroDivision"):
        detect(frame, tiny.field, Recipe.load(tmp_path / "own.toml"))


PARTS = """
import numpy as np
from testfield import register
from testfield.detect.decode import decode
from testfield.detect.detect import detect
from testfield.detect.find import find_blobs

@register("finders", "theirs")
def theirs(image_dn, sheet, smallest_px, largest_px, most=1000):
    found = find_blobs(image_dn, sheet, smallest_px, largest_px)
    return found.xy_px[:most], found.moments_px2[:most]

@register("decoders", "theirs")
def reads(image_dn, xy_px, moments_px2, contrast_dn, background_dn, bits, radii):
    return decode(image_dn, xy_px, moments_px2, contrast_dn, background_dn, bits, radii)[0]

@register("detectors", "theirs")
def whole(frame, field, centroid="star"):
    return detect(frame, field, centroid, 5.0)
"""


def test_finder_decoder_and_detector_of_ones_own_take_the_places(tiny: Run, frame: Frame, tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text(PARTS)
    load = 'load = "parts.py"\ncentroid = "star"\n'
    found = {}
    for name, text in {
        "none": "",
        "finder": 'finder = "theirs"\n',
        "decoder": 'decoder = "theirs"\n',
        "detector": '[detector]\nname = "theirs"\n',
        "few": '[finder]\nname = "theirs"\nmost = 3\n',
    }.items():
        (tmp_path / f"{name}.toml").write_text(load + text)
        found[name] = detect(frame, tiny.field, Recipe.load(tmp_path / f"{name}.toml")).measured
    for name in ("finder", "decoder", "detector"):
        assert np.array_equal(found[name].code, found["none"].code), name
        assert np.allclose(found[name].xy_px, found["none"].xy_px), name
    assert len(found["few"]) <= 3


def test_results_made_elsewhere_belong_to_their_images(tiny: Run, tmp_path: Path) -> None:
    frames = [Frame.load(tiny.folder / f"frames/{name}.png", name) for name in tiny.stations]
    own = detect_all(frames, tiny.field, Recipe())
    there = tmp_path / "results" / "tiny"
    there.mkdir(parents=True)
    for k, name in enumerate(tiny.stations):
        (there / f"{name}.csv").write_text(table(own.take((own.station == k) & (own.status == "measured"))))
    (tmp_path / "own.toml").write_text('[detector]\nfolder = "results"\n')
    with pytest.raises(TestfieldError, match=f"no {tiny.stations[0]}.csv"):
        detect_all(frames, tiny.field, Recipe.load(tmp_path / "own.toml"))
    export = {"scene": "tiny", "seed": 7, "images": {frame.station: image_digest(frame) for frame in frames}}
    (there / EXPORT).write_text(json.dumps(export))
    recipe = Recipe.load(tmp_path / "own.toml")
    found = detect_all(frames, tiny.field, recipe_at(recipe, frames))
    assert np.array_equal(found.xy_px, own.measured.xy_px)
    other = [Frame(frame.station, frame.pixels_dn + 1, frame.sheet) for frame in frames]
    with pytest.raises(TestfieldError, match=rf"export\.json, images\.{tiny.stations[0]}: these results are of other"):
        recipe_at(recipe, other)


def test_a_scene_and_a_run_s_folder_start_nothing(tiny: Run, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    from conftest import TINY

    for text in (
        '[measure]\ndetector = { command = "touch started" }',
        '[measure]\nload = "own.py"',
        '[detector]\ncommand = "touch started {csv}"',
        'load = "own.py"',
        '[environment]\npackages = ["numpy"]',
    ):
        (tmp_path / "own.py").write_text("open('started', 'w')")
        scene = tmp_path / "s.toml"
        top = text if text.startswith("load") else ""
        scene.write_text(f"{top}\n{TINY.read_text()}\n{'' if top else text}\n")
        assert main(["validate", str(scene)]) == 2
        assert "unknown" in capsys.readouterr().err
    assert not list(tmp_path.glob("started*")) and not Path("started").exists()


def test_what_the_environment_names_is_loaded_by_no_command(tmp_path: Path) -> None:
    import subprocess

    (tmp_path / "own.py").write_text(f"open({str(tmp_path / 'started')!r}, 'w')")
    environment = os.environ | {registry.LOADED: str(tmp_path / "own.py")}
    command = [sys.executable, "-m", "testfield", "list", "centroids"]
    assert subprocess.run(command, env=environment, capture_output=True, check=False).returncode == 0
    assert not (tmp_path / "started").exists()


CALIBRATOR = """
import csv, json, sys
import cv2
import numpy as np

with open(sys.argv[1]) as file:
    rows = [row for row in csv.DictReader(file) if int(row["board"]) >= 0]
with open(sys.argv[2]) as file:
    sheet = json.load(file)
objects, images = [], []
for key in sorted({(row["station"], int(row["board"])) for row in rows}):
    mine = [row for row in rows if (row["station"], int(row["board"])) == key]
    board = sheet["boards"][key[1]]
    point = [int(row["point"]) for row in mine]
    plane = [(board["x_mm"][p], board["y_mm"][p], 0) for p in point]
    objects.append(np.array(plane, np.float32))
    images.append(np.array([(float(row["x_px"]), float(row["y_px"])) for row in mine], np.float32))
size = sheet["cameras"][0]["width_px"], sheet["cameras"][0]["height_px"]
flags = cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
start = np.array([[800, 0, size[0] / 2], [0, 800, size[1] / 2], [0, 0, 1.0]])
_, K, d, _, _ = cv2.calibrateCamera(objects, images, size, start, None, flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS)
interior = {"model": "brown", "width_px": size[0], "height_px": size[1]}
interior |= {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
interior |= dict(zip(("k1", "k2", "p1", "p2", "k3"), d.ravel().tolist()))
with open(sys.argv[3], "w") as file:
    json.dump({"interior": interior}, file)
"""


def test_a_program_calibrates_and_what_it_does_not_say_is_resected(tiny: Run, tmp_path: Path) -> None:
    (tmp_path / "calibrate.py").write_text(CALIBRATOR)
    command = f"{sys.executable} calibrate.py {{observations}} {{sheet}} {{json}}"
    (tmp_path / "own.toml").write_text(f"[calibrator]\ncommand = '{command}'\n")
    seen = Observations.load(tiny.folder / "observations.parquet", tiny.field)
    found = measure(seen, tiny.field, Recipe.load(tmp_path / "own.toml"))
    assert found.calibration.method == "calibrate.py" and found.calibration.labels == ()
    assert set(found.calibration.station_names) == set(tiny.stations)
    assert found.calibration.reprojection_rms_px < 0.1
    card = plain(score_measured(tiny.world, tiny.views, seen, found.calibration, found.points))
    assert card["calibration"]["corner_error_px"] < 1 and card["calibration"]["interior_anees"] is None
    assert card["points"]["measured"] == 2 and card["points"]["anees"] is None


def test_a_calibration_and_points_made_elsewhere_are_those_that_were_made(tiny: Run, tmp_path: Path) -> None:
    import shutil

    there = tmp_path / "theirs"
    there.mkdir()
    seen = Observations.load(tiny.folder / "observations.parquet", tiny.field)
    own = measure(seen, tiny.field, Recipe())
    own.calibration.save(there / "calibration.json")
    rows = zip(own.points.code, own.points.xyz_mm.tolist(), strict=True)
    (there / "points.csv").write_text(
        "code,x_mm,y_mm,z_mm\n" + "".join(f"{c},{x!r},{y!r},{z!r}\n" for c, (x, y, z) in rows)
    )
    (tmp_path / "own.toml").write_text('calibrator = { folder = "theirs" }\nreconstructor = { folder = "theirs" }\n')
    found = measure(seen, tiny.field, Recipe.load(tmp_path / "own.toml"))
    assert np.array_equal(found.calibration.covariance, own.calibration.covariance)
    assert np.array_equal(found.points.xyz_mm, own.points.xyz_mm) and not found.points.states_u
    # The same camera alone, and with its exterior orientations, which any frame may have.
    camera = {"interior": own.calibration.interior.without_modes.to_json()}
    shutil.rmtree(there)
    there.mkdir()
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    for more in (
        {},
        {
            "stations": {
                name: {"R": (R @ turn).tolist(), "t_mm": t.tolist()}
                for name, R, t in zip(
                    own.calibration.station_names,
                    own.calibration.stations.R,
                    own.calibration.stations.t_mm,
                    strict=True,
                )
            },
            "boards": {
                name: {"R": (turn.T @ R).tolist(), "t_mm": (turn.T @ t).tolist()}
                for name, R, t in zip(
                    own.calibration.board_names, own.calibration.boards.R, own.calibration.boards.t_mm, strict=True
                )
            },
        },
    ):
        (there / "camera.json").write_text(json.dumps(camera | more))
        (tmp_path / "own.toml").write_text('calibrator = { folder = "theirs" }\n')
        found = measure(seen, tiny.field, Recipe.load(tmp_path / "own.toml"))
        assert np.allclose(found.points.xyz_mm, own.points.xyz_mm, atol=0.05 if not more else 1e-3), more
        assert np.allclose(
            found.calibration.stations.t_mm, own.calibration.stations.t_mm, atol=0.5 if not more else 1e-6
        )


CAMERAS = {
    "no JSON": ("{", "not a readable camera file"),
    "no interior": ("{}", "interior"),
    "no lens": ('{"interior": {"model": "pin", "width_px": 640, "height_px": 512}}', "pin"),
    "NaN": (
        '{"interior": {"model": "brown", "width_px": 640, "height_px": 512, "fx": NaN, "fy": 800, "cx": 1, "cy": 1, '
        '"k1": 0, "k2": 0, "k3": 0, "p1": 0, "p2": 0}}',
        "not finite",
    ),
    "another size": (
        '{"interior": {"model": "brown", "width_px": 64, "height_px": 51, "fx": 800, "fy": 800, "cx": 1, "cy": 1, '
        '"k1": 0, "k2": 0, "k3": 0, "p1": 0, "p2": 0}}',
        "64 x 51",
    ),
    "labels alone": (
        '{"labels": ["fx"], "interior": {"model": "brown", "width_px": 640, "height_px": 512, "fx": 800, "fy": 800, '
        '"cx": 1, "cy": 1, "k1": 0, "k2": 0, "k3": 0, "p1": 0, "p2": 0}}',
        "belong together",
    ),
    "boards alone": (
        '{"boards": {"board": {"R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t_mm": [0, 0, 0]}}, "interior": '
        '{"model": "brown", "width_px": 640, "height_px": 512, "fx": 800, "fy": 800, "cx": 320, "cy": 256, '
        '"k1": 0, "k2": 0, "k3": 0, "p1": 0, "p2": 0}}',
        "boards without stations",
    ),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_file_that_cannot_be_is_named_with_the_program(name: str, tiny: Run, tmp_path: Path) -> None:
    text, said = CAMERAS[name]
    (tmp_path / "own.json").write_text(text)
    (tmp_path / "own.toml").write_text('[calibrator]\ncommand = "cp own.json {json}"\n')
    seen = Observations.load(tiny.folder / "observations.parquet", tiny.field)
    with pytest.raises(TestfieldError, match=said) as error:
        measure(seen, tiny.field, Recipe.load(tmp_path / "own.toml"))
    assert "cp, " in error.value.sentence() and "camera.json" in error.value.sentence()


@pytest.mark.parametrize("kind", ["station", "board"])
def test_a_pose_that_is_missing_is_named_also_where_the_other_kind_has_that_name(
    kind: str, tiny: Run, tmp_path: Path
) -> None:
    there = tmp_path / "theirs"
    there.mkdir()
    seen = Observations.load(tiny.folder / "observations.parquet", tiny.field)
    own = measure(seen, tiny.field, Recipe()).calibration
    pose = {"R": np.eye(3).tolist(), "t_mm": [0.0, 0.0, 900.0]}
    stations = {name: pose for name in own.station_names}
    boards = {name: pose for name in own.board_names}
    missing = (own.station_names if kind == "station" else own.board_names)[-1]
    mine, others = (stations, boards) if kind == "station" else (boards, stations)
    del mine[missing]
    mine["another"] = others[missing] = pose
    camera = {"interior": own.interior.without_modes.to_json(), "stations": stations, "boards": boards}
    (there / "camera.json").write_text(json.dumps(camera))
    (tmp_path / "own.toml").write_text('calibrator = { folder = "theirs" }\n')
    with pytest.raises(TestfieldError, match=f"no pose of {kind} '{missing}'") as error:
        measure(seen, tiny.field, Recipe.load(tmp_path / "own.toml"))
    assert f"camera.json, {kind}s" in error.value.sentence()


def test_failures_of_programs_are_counted_by_kind_and_spoil_no_comparison(tmp_path: Path) -> None:
    import pandas as pd
    from conftest import TINY

    bodies = {"crash": CRASH, "hang": "sleep 60", "nonsense": 'echo Hello > "$2"'}
    for name, body in bodies.items():
        folder = tmp_path / name
        folder.mkdir()
        program(folder, body, "time_limit_s = 0.3\n" if name == "hang" else "")
        recipe = folder / "own.toml"
        recipe.write_text(f'name = "{name}"\n{recipe.read_text()}')
    recipes = "".join(f'"{name}/own.toml", ' for name in bodies)
    (tmp_path / "c.toml").write_text(
        f'scenes = ["{TINY}"]\nrecipes = [{recipes}]\ncentroids = ["star"]\ndraws = 1\nuntil = "detect"\n'
    )
    assert main(["compare", str(tmp_path / "c.toml"), "--out", str(tmp_path / "out"), "--jobs", "1"]) in (0, 1)
    rows = pd.read_parquet(tmp_path / "out/results.parquet").set_index("recipe")
    assert rows.failure_kind[list(bodies)].tolist() == ["crashed", "timed out", "refused"]
    assert "cannot read: no PNG" in rows.failure["crash"] and "no columns x_px, y_px" in rows.failure["nonsense"]
    assert rows["detection.missed"]["crash"] == rows["detection.expected"]["crash"] > 0
    assert rows["detection.centre_rms_px"]["star"] < 0.1
