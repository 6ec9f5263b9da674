"""What `import testfield as tf` offers. Every name here is stable; everything else may change."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testfield.author.builder import SceneText
from testfield.author.station_lists import Stations, arc, grid, pose, ring, scattered, station
from testfield.calibrate.calibration import Calibration
from testfield.camera.images import Frame
from testfield.chain.complete import complete
from testfield.chain.run import resume
from testfield.chain.truth import Truth
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.pipeline import Measured
from testfield.measure.pipeline import measure as measure_by
from testfield.measure.recipe import Recipe
from testfield.reconstruct.points import Points
from testfield.registry import register
from testfield.scene.changes import changes_of
from testfield.scene.load import load_scene as load_scene_file
from testfield.scene.schema import SceneFile
from testfield.scene.shipped import find_scene
from testfield.score.scorecard import figure, load_scorecard, plain, score_measured, ten_figures
from testfield.targets.field import Field

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Measured",
    "Recipe",
    "RunResult",
    "Scene",
    "Score",
    "Stations",
    "TestfieldError",
    "arc",
    "grid",
    "load_scene",
    "measure",
    "open_run",
    "pose",
    "register",
    "ring",
    "run",
    "scattered",
    "score",
    "station",
]


@dataclass(frozen=True)
class Score:
    """Everything measured against the truth. `figures` are those of scorecard.json (FORMATS.md)."""

    figures: dict[str, Any]

    def __getitem__(self, key: str) -> Any:
        """The figure under a dotted key, as `score["points.rmse_mm"]`. Raises `KeyError` where there is none."""
        return figure(self.figures, key)

    @property
    def passed(self) -> bool:
        """Whether nothing failed."""
        return bool(self["verdict.passed"])

    @property
    def failures(self) -> tuple[str, ...]:
        """What failed, one sentence each."""
        return tuple(self["verdict.failures"])

    @property
    def ten(self) -> dict[str, str]:
        """The ten figures that matter, as they are printed."""
        return dict(ten_figures(self.figures))

    def _repr_html_(self) -> str:
        """The ten figures and what failed, as a notebook shows them."""
        rows = "".join(f"<tr><td>{escape(what)}</td><td>{escape(value)}</td></tr>" for what, value in self.ten.items())
        failed = "".join(f"<li>{escape(sentence)}</li>" for sentence in self.failures)
        return f"<table>{rows}</table>" + (f"<ul>{failed}</ul>" if failed else "")


@dataclass(frozen=True)
class RunResult:
    """A finished run in its `folder`; its parts are read when they are asked for."""

    folder: Path

    @cached_property
    def scene(self) -> SceneFile:
        """The scene as run."""
        return load_scene_file(self.folder / "scene.toml")

    @cached_property
    def field(self) -> Field:
        """The field sheet: what the measuring side was told."""
        return Field.load(self.folder / "field.json")

    @cached_property
    def observations(self) -> Observations:
        """What detection found."""
        return Observations.load(self.folder / "observations.parquet", self.field)

    @cached_property
    def calibration(self) -> Calibration:
        """Cameras, exterior orientations and boards, with their joint covariance."""
        return Calibration.load(self.folder / "calibration.json")

    @cached_property
    def points(self) -> Points:
        """Targets that belong to no board, with their joint covariance."""
        return Points.load(self.folder / "points.parquet")

    @cached_property
    def score(self) -> Score:
        """Everything measured against the truth."""
        return Score(load_scorecard(self.folder / "scorecard.json"))

    def _repr_html_(self) -> str:
        """The folder, and the score, as a notebook shows them."""
        return f"<p>{escape(str(self.folder))}</p>{self.score._repr_html_()}"

    def frames(self) -> Iterator[Frame]:
        """The images, one after the other."""
        for name in self.observations.stations:
            yield Frame.load(self.folder / f"frames/{name}.png", name)

    def table(self, name: str) -> "pd.DataFrame":
        """A table as a data frame: observations, points, truth/marks or truth/views; FORMATS.md lists the columns."""
        import pandas as pd

        path = self.folder / f"{name}.parquet"
        if not path.is_file():
            raise TestfieldError("there is no such table", str(path), "observations, points, truth/marks, truth/views")
        return pd.read_parquet(path)


class Scene(SceneText):
    """A scene written in Python, as its file reads, and used from there:

    `tf.Scene("cell").camera(focal_length_mm=12).board("A", [0, 0, 500], kind="calib.io ChArUco A3 11x8").stations(
    tf.arc(12, 1500, 800, [0, 0, 500])).save("cell.toml")`

    `Scene.load("cell.toml").set("boards.A.bow_mm", 2).save()` keeps the file's comments.
    """

    def preview(self, out: str | Path | None = None, station: str | None = None) -> Path:
        """A PNG of plan, elevation and the view from a station, the first if none is named; its path.

        Raises `TestfieldError` where the scene is wrong, or has no such station.
        """
        from testfield.chain.run import checked
        from testfield.render.quick import quick_view
        from testfield.report.preview import draw_preview
        from testfield.store.atomic import whole

        run, _, _ = checked(self.described(), None, None, 1)
        name = station or run.stations[0]
        if name not in run.stations:
            raise TestfieldError(
                f"no station is called '{name}'", self.name, f"choose one of {', '.join(run.stations)}"
            )
        world, k = next((world, k) for _, world, k, image in run.truth.images() if image == name)
        path = Path("renders") / f"{self.name}-preview.png" if out is None else Path(out)
        with whole(path) as part:
            draw_preview(run.world, quick_view(world, k), name, part)
        return path

    def plan(self) -> dict[str, Any]:
        """What the scene will measure, predicted before any image: the object of `testfield plan --json`.

        Raises `TestfieldError` where the scene is wrong, or a part of it has no datum.
        """
        from testfield.plan.card import card_of
        from testfield.plan.job import Job
        from testfield.plan.network import planned
        from testfield.plan.predict import predict
        from testfield.scene.load import numbered, scene_from

        document = self.described()
        with numbered(document):
            card: dict[str, Any] = plain(card_of(predict(planned(Job.of(scene_from(document), document.source)))))
        return card

    def run(
        self,
        out: str | Path | None = None,
        *,
        seed: int | None = None,
        noise_seed: int | None = None,
        jobs: int = 1,
        force: bool = False,
    ) -> RunResult:
        """Render, measure and score the scene, saved or not, as `run` does."""
        folder = None if out is None else Path(out)
        finished, _ = complete(self.described(), folder, seed, noise_seed, jobs, force)
        return RunResult(finished.folder)


def load_scene(scene: str | Path) -> SceneFile:
    """The checked values of the scene at a path, or of the one of that name that comes along. To change, save, plan
    or run one from Python, `Scene.load` reads it.

    Raises `TestfieldError` with all that is wrong with it.
    """
    return load_scene_file(find_scene(scene))


def run(
    scene: str | Path,
    out: str | Path | None = None,
    *,
    seed: int | None = None,
    noise_seed: int | None = None,
    jobs: int = 1,
    force: bool = False,
    set: Mapping[str, Any] | None = None,
) -> RunResult:
    """Render, measure and score a scene, given by path or name; nothing whose inputs are the same is made again.

    `out` is the run's folder, renders/NAME where it is absent. Another `seed` is another world, another `noise_seed`
    other noise in the same one. `set` changes fields for this run alone: `{"camera.focal_length_mm": 35}`.

    Raises `TestfieldError` for a scene that cannot be run or measured.
    """
    changes, folder = changes_of(set or {}), None if out is None else Path(out)
    finished, _ = complete(Path(scene), folder, seed, noise_seed, jobs, force, changes=changes)
    return RunResult(finished.folder)


def open_run(folder: str | Path) -> RunResult:
    """The run in a folder. Raises `TestfieldError` where there is none."""
    return RunResult(resume(Path(folder), 1).folder)


def measure(seen: Observations | Sequence[Frame], field: Field, recipe: Recipe | None = None) -> Measured:
    """Observations, calibration and points that a recipe makes of frames, or of observations that are there already.

    `field` is the field sheet. Raises `TestfieldError` where frames and field do not determine the result.
    """
    return measure_by(seen, field, recipe or Recipe())


def score(scene: SceneFile | str | Path, measured: Measured) -> Score:
    """What was measured of a scene's images against the scene's truth."""
    true = scene if isinstance(scene, SceneFile) else load_scene(scene)
    truth = Truth.of(true, true.name)
    observations = truth.by_cameras(measured.observations)
    card = score_measured(
        truth.world, truth.views, observations, measured.calibration, measured.points, truth.cameras, true.rigs
    )
    return Score(plain(card))
