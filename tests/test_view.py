"""The 3-D page: its data are the scene's and the plan's, it loads nothing, and in a browser it answers clicks."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from testfield.author.prints import Sector, print_of, sectors_of
from testfield.author.view_data import ViewData, view_data
from testfield.author.view_prints import panel_prints
from testfield.author.view_run import actual_of
from testfield.author.view_surfaces import MOST_FACES, _coarser
from testfield.camera.project import project_camera
from testfield.chain.recipe import recipe_of
from testfield.cli.main import main
from testfield.measure.pipeline import Measured, measure
from testfield.plan.job import Job
from testfield.plan.predict import Prediction, predict_scene
from testfield.report.view_page import FINEST, MOST_BYTES, arrays, view_page
from testfield.scene.load import load_scene, parse_scene
from testfield.scene.world import TrueMesh
from testfield.targets.field import TIME
from testfield.targets.marks import RADII, USUAL, Marks

TINY = Path(__file__).parent / "torture" / "tiny.toml"
CHROMIUM = shutil.which("chromium")
BROWSER = pytest.mark.skipif(CHROMIUM is None, reason="no chromium here; .ci/setup installs it")


@pytest.fixture(scope="module")
def job() -> Job:
    return Job.of(load_scene(TINY), "tiny.toml")


@pytest.fixture(scope="module")
def found(job: Job) -> Prediction:
    return predict_scene(job)


@pytest.fixture(scope="module")
def data(job: Job) -> ViewData:
    return view_data(job)


@pytest.fixture(scope="module")
def measured(job: Job) -> Measured:
    return measure(job.observations, job.told, recipe_of(job.scene))


def test_ellipsoids_are_the_covariances_of_the_plan(data: ViewData, found: Prediction) -> None:
    R = found.planned.datum.R[0]
    codes = data.job.world.marks.code[data.target]
    assert set(codes) == set(found.code)
    for code, axes in zip(codes, data.axes_mm, strict=True):
        block = found.blocks[np.flatnonzero(found.code == code)[0]]
        assert axes @ axes.T == pytest.approx(R @ block @ R.T, abs=1e-12 + 1e-9 * np.abs(block).max())
    assert data.u_mm == pytest.approx([np.linalg.norm(found.u_mm[found.code == c]) for c in codes], rel=1e-9)


def test_rays_and_angles_are_those_of_the_plan(data: ViewData, found: Prediction) -> None:
    order = np.searchsorted(found.code, data.job.world.marks.code[data.target])
    assert data.rays[data.target] == pytest.approx(found.rays[order])
    assert data.angle_deg[data.target] == pytest.approx(found.angle_deg[order], abs=1e-6)
    assert data.rays.sum() == len(data.job.expected) == data.drawings.first[-1]


def test_drawings_are_the_observations_that_are_expected(data: ViewData) -> None:
    rows, drawn = data.job.expected, data.drawings
    order = np.lexsort((rows.mark, rows.station))
    packed = arrays(data)["drawn_xy"] * (data.stations.size_px.max() / FINEST)
    assert np.abs(packed - rows.xy_px[order]).max() < 0.05
    assert 2 * np.sqrt(drawn.axes_px.prod(axis=1)) == pytest.approx(rows.diameter_px[order], rel=1e-6)
    # The rims of the dots, imaged by the lens, lie on the ellipses.
    world, poses = data.job.world, data.job.poses
    turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    for s, m, centre, axes, angle in zip(
        rows.station[order], rows.mark[order], drawn.xy_px, drawn.axes_px, drawn.angle_rad, strict=True
    ):
        circle = world.marks.diameter_mm[m] / 2 * np.column_stack([np.cos(turn), np.sin(turn)])
        rim = world.panels.place(np.full(16, world.marks.panel[m]), world.marks.xy_mm[m] + circle)[0]
        off = project_camera(world.interior, rim @ poses.R[s].T + poses.t_mm[s]) - centre
        along = off @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) / axes
        assert np.linalg.norm(along, axis=1) == pytest.approx(np.ones(16), abs=0.05)
    assert len(drawn.outline_px) == 4


def test_prints_are_those_that_are_printed(data: ViewData) -> None:
    world, prints = data.job.world, data.prints
    one = print_of(world.field.boards[0], world.field)
    panel = int(world.marks.panel[np.argmax(world.marks.board == 0)])
    assert len(prints.dots) == len(world.marks)
    assert prints.dots[prints.dots_panel == panel][:, :2] == pytest.approx(one.marks.xy_mm)
    assert (prints.sectors_panel == panel).sum() == len(one.sectors)
    loose = prints.sectors[np.isin(prints.sectors_panel, world.marks.panel[data.target])]
    assert len(loose) > len(data.target)


def test_targets_that_move_carry_their_print_to_every_place() -> None:
    world = Job.of(load_scene(TINY.parents[2] / "scenes" / "camera_cell.toml"), "camera_cell.toml").world
    prints = panel_prints(world)
    moved = np.flatnonzero(world.marks.code > TIME)
    assert len(moved)
    for mark in moved:
        panel, xy = world.marks.panel[mark], world.marks.xy_mm[mark]
        own = (prints.sectors_panel == panel) & (np.abs(prints.sectors[:, :2] - xy).max(axis=1) < 1e-9)
        assert own.sum() == len(sectors_of_code(int(world.marks.code[mark] % TIME), world.field.bits))


def sectors_of_code(code: int, bits: int) -> tuple[Sector, ...]:
    marks = Marks(np.zeros((1, 2)), np.ones(1), np.array([code]), bits)
    return sectors_of(marks, RADII[USUAL])


def test_a_frustum_ends_where_the_corners_of_the_image_point(data: ViewData) -> None:
    poses, interior = data.job.poses, data.job.world.interior
    for k in range(len(poses)):
        at_camera = data.stations.corners_mm[k] @ poses.R[k].T + poses.t_mm[k]
        assert project_camera(interior, at_camera) == pytest.approx(interior.corners_px, abs=1e-6)


def test_a_scene_that_cannot_be_predicted_is_shown_and_says_why() -> None:
    text = TINY.read_text(encoding="utf-8").replace("look_at_mm = [0, 0, 400]", "look_at_mm = [0, -9000, 400]")
    data = view_data(Job.of(parse_scene(text.encode(), "away.toml"), "away.toml"))
    assert np.isnan(data.axes_mm).all()
    assert any("away.toml" in note and "no station sees" in note for note in data.notes)
    assert "no station sees" in view_page(data)


def test_large_meshes_become_coarser_and_keep_their_shape() -> None:
    n = 300
    u, v = np.meshgrid(np.linspace(0, 1000, n), np.linspace(0, 500, n))
    vertices = np.column_stack([u.ravel(), v.ravel(), 50 * np.sin(u.ravel() / 200)])
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.column_stack([a, a + 1, a + n]), np.column_stack([a + 1, a + n + 1, a + n])])
    (one,), notes = _coarser((TrueMesh("sheet", vertices, faces, 0.5, False),))
    assert MOST_FACES / 4 < len(one.faces) <= MOST_FACES
    assert f"{len(faces):,}" in notes[0]
    assert np.abs(one.vertices_mm[:, 2] - 50 * np.sin(one.vertices_mm[:, 0] / 200)).max() < 0.5
    assert one.normals[:, 2].min() > 0.9


def test_a_run_that_measured_the_truth_has_no_error(data: ViewData, measured: Measured) -> None:
    world = data.job.world
    actual = actual_of(world, data.target, measured.calibration, measured.points)
    # Noise-free observations of a world whose prints differ from their sheets: what is left is theirs.
    assert np.linalg.norm(actual.error_mm, axis=1).max() < 3 * data.u_mm.max()
    shifted = measured.points.xyz_mm.copy()
    code = int(measured.points.code[0])
    shifted[0] += [0.3, -0.2, 0.1]
    moved = actual_of(world, data.target, measured.calibration, replace(measured.points, xyz_mm=shifted))
    here = int(np.flatnonzero(world.marks.code[data.target] == code)[0])
    difference = moved.error_mm - actual.error_mm
    R = world.world_from_board.R[0]
    assert difference[here] == pytest.approx(R @ [0.3, -0.2, 0.1], abs=1e-9)
    assert np.delete(difference, here, axis=0) == pytest.approx(0, abs=1e-12)
    u = np.linalg.norm(np.sqrt(np.diag(measured.points.cov_xyz_mm2)).reshape(-1, 3)[0])
    assert np.sqrt((actual.axes_mm[here] ** 2).sum()) == pytest.approx(u, rel=1e-9)


def test_the_page_is_one_file_that_loads_nothing(data: ViewData) -> None:
    text = view_page(data)
    assert len(text.encode()) < MOST_BYTES
    # The name of a language in a call of three.js is no address that is loaded.
    assert set(re.findall(r"https?://[^\s\"'`<)]+", text)) <= {"http://www.w3.org/1999/xhtml"}
    assert not re.search(
        r"<(?:link|img|iframe)\b|\bsrc=|@import|\burl\(", re.sub(r"<script>.*?</script>", "", text, flags=re.S)
    )
    assert "default-src 'none'" in text
    assert "The MIT License" in text and "three.js authors" in text


def test_what_cannot_be_shown_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def refused(*arguments: str) -> str:
        assert main(["view", *arguments]) == 2
        said = capsys.readouterr().err
        assert "Traceback" not in said
        return said

    assert "quick" in refused("quikc")
    assert "no run's folder" in refused(str(tmp_path))
    (tmp_path / "scene.toml").write_bytes(TINY.read_bytes())
    assert "points.parquet" in refused(str(tmp_path)) and "testfield reconstruct" in refused(str(tmp_path))
    assert ".html" in refused(str(TINY), "--out", str(tmp_path / "page.png"))


@pytest.fixture(scope="module")
def page_of_run(tmp_path_factory: pytest.TempPathFactory, measured: Measured) -> Path:
    folder = tmp_path_factory.mktemp("run")
    (folder / "scene.toml").write_bytes(TINY.read_bytes())
    measured.points.save(folder / "points.parquet")
    measured.calibration.save(folder / "calibration.json")
    assert main(["view", str(folder)]) == 0
    return folder / "view.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    drawn = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=CHROMIUM, args=drawn)
        yield opened
        opened.close()


@BROWSER
def test_a_click_shows_a_targets_numbers_and_modes_change_colours(
    browser: Any, page_of_run: Path, data: ViewData
) -> None:
    page = browser.new_page(viewport={"width": 900, "height": 600}, color_scheme="dark")
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda request: faults.append(request.url) if not request.url.startswith("file:") else None)
    page.goto(page_of_run.as_uri())
    page.wait_for_selector("html[data-ready]", timeout=60_000)
    code = int(np.flatnonzero(data.job.world.marks.code[data.target] == 212)[0])
    at = page.evaluate(f"view.screenOf('mark', view.markOf({code}))")
    page.mouse.click(at["x"], at["y"])
    said = page.inner_text("#chosen")
    assert "Target 212" in said
    for value in data.job.world.mark_world_mm[data.target[code]]:
        assert f"{value:.2f}" in said
    for value in np.sqrt((data.axes_mm[code] ** 2).sum(axis=1)):
        assert f"{value:.4f}" in said
    assert "actual error" in said and f"{data.rays[data.target[code]]} images" in said
    page.select_option("#mode", "rays")
    assert str(data.rays[data.target].max()) in page.inner_text("#legend")
    page.select_option("#mode", "ratio")
    page.click("#chosen a[data-station]")
    seen = int((data.job.world.marks.board[data.job.expected.mark[data.job.expected.station == 0]] < 0).sum())
    assert f"{seen} of {len(data.target)}" in page.inner_text("#chosen")
    page.select_option("#cut", "z")
    assert "z = " in page.inner_text("#cut_said")
    page.fill("#find_target", "211")
    page.press("#find_target", "Enter")
    assert "Target 211" in page.inner_text("#chosen")
    page.click("#theme")
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    page.wait_for_timeout(200)
    assert not faults
    page.close()


LARGE = """
import json, resource, sys
from pathlib import Path
from testfield.author.view_data import view_data
from testfield.bench.plan_scenes import large_field
from testfield.plan.job import Job
from testfield.report.view_page import view_page
Path(sys.argv[1]).write_text(view_page(view_data(Job.of(large_field(5000, 100), "large field"))), encoding="utf-8")
used = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps([used.ru_utime + used.ru_stime, used.ru_maxrss / 1e6]))
"""


@pytest.mark.slow
@BROWSER
def test_five_thousand_targets_and_a_hundred_stations(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "large.html"
    threads = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    made = subprocess.run(
        [sys.executable, "-c", LARGE, str(path)], capture_output=True, text=True, check=True, env=os.environ | threads
    )
    processor_s, peak_gb = json.loads(made.stdout)
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-ready]", timeout=120_000)
    before = descendants_s()
    spun = page.evaluate("view.spin(60)")
    frame_ms = 1000 * (descendants_s() - before) / 60
    page.close()
    size_mb = path.stat().st_size / 1e6
    print(f"\n{processor_s:.1f} s, {peak_gb:.2f} GB, {size_mb:.1f} MB; {frame_ms:.0f} ms of processor a frame; {spun}")
    assert processor_s < 20 and peak_gb < 2 and path.stat().st_size < MOST_BYTES
    assert frame_ms < 120  # time that passes is another program's on a shared machine


def descendants_s() -> float:
    """Processor time of all processes that this one has started and that still run."""
    found: dict[int, tuple[int, float]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parts = stat.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue  # it has just ended
        found[int(stat.parent.name)] = int(parts[1]), (int(parts[11]) + int(parts[12])) / os.sysconf("SC_CLK_TCK")

    def is_ours(parent: int) -> bool:
        return parent == os.getpid() or (parent in found and is_ours(found[parent][0]))

    return sum(seconds for parent, seconds in found.values() if is_ours(parent))
