"""A rendered scene for somebody's own tests: frames, field sheet, truth and scorecard; rendered once for everybody."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from testfield.camera.images import Frame
from testfield.chain.run import Run
from testfield.chain.stages import run_stage
from testfield.chain.truth import Truth
from testfield.evaluate.case import Case, case
from testfield.evaluate.execute import run_name, run_of
from testfield.evaluate.measured import frames_of, scorecard_row
from testfield.measure.recipe import Recipe
from testfield.scene.shipped import find_scene
from testfield.score.floor import renderer_digest
from testfield.store.lock import only_writer
from testfield.targets.field import Field

RENDERED_WITHIN_S = 3600.0
"""How long a process waits for another one that renders the same scene."""


@dataclass(frozen=True)
class Rendered:
    """A scene whose images are rendered, in a folder that all processes share.

    `frames` are its images with the noise of `noise_seed` (None: the scene's own), `sheet` is what a measuring person
    is told of the field, `truth` what is true.
    """

    case: Case
    run: Run

    @property
    def frames(self) -> list[Frame]:
        """The images, in the order of the stations. Anew each time: whoever changes one changes nobody else's."""
        return frames_of(self.case, self.run)

    @property
    def sheet(self) -> Field:
        """The field sheet."""
        return self.run.field

    @property
    def truth(self) -> Truth:
        """The truth: `truth.world` with all marks, `truth.views` with what each image truly shows."""
        return self.run.truth

    @cached_property
    def scorecard(self) -> dict[str, Any]:
        """Every figure by its path, measured by the scene's own recipe."""
        return self.measured()

    def measured(self, recipe: Recipe | Path | str | None = None) -> dict[str, Any]:
        """Every figure by its path, measured by a recipe, or that of a file (None: the scene's own)."""
        if isinstance(recipe, Path | str):
            recipe = Recipe.load(Path(recipe))
        return scorecard_row(replace(self.case, recipe=recipe), self.run)[0]

    def under(self, noise_seed: int | None) -> "Rendered":
        """The same scene under another draw of noise; nothing is rendered again."""
        return Rendered(replace(self.case, noise_seed=noise_seed), self.run)


def rendered(scene: Path | str, cache: Path, noise_seed: int | None = None) -> Rendered:
    """A scene by its file or the name of one that comes along, rendered below `cache` where that was not done.

    Of several processes one renders, and the others wait. Another renderer has folders of its own. Raises
    `TestfieldError` where the scene is none, or `cache` cannot be written.
    """
    own = case(find_scene(Path(scene)), noise_seed=noise_seed)
    place = cache / renderer_digest()[:8]
    with only_writer(place / "runs" / str(run_name(own)), RENDERED_WITHIN_S):
        run = run_of(own, place)
        run_stage(run, "render")
        run_stage(run, "expose")
    return Rendered(own, run)
