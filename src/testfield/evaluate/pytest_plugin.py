"""A rendered test field in somebody's own tests (entry point `pytest11`).

    @pytest.mark.field_scene("quick")
    def test_my_detector(field_scene, field_regression):
        field_regression.check({"rms_px": error_of(my_detector, field_scene.frames, field_scene.truth)})

A scene is named by its file, beside the test or from where pytest was started, or by the name of one that comes along.
It is rendered once for all processes and all times, below the user's cache folder (`--field-cache`). This module is
imported by every pytest of an environment, so it imports nothing heavy by itself.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from testfield.camera.images import Frame
    from testfield.chain.truth import Truth
    from testfield.evaluate.regress.for_tests import FieldRegression
    from testfield.evaluate.rendered import Rendered

MARK = "field_scene"


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options of rendered fields."""
    group = parser.getgroup("testfield", "rendered test fields")
    group.addoption("--field-record", action="store_true", help="write the baselines of field_regression anew")
    group.addoption("--field-cache", metavar="FOLDER", help="where rendered scenes are kept (default: user's cache)")


def pytest_configure(config: pytest.Config) -> None:
    """The marker by which a test names its scene."""
    config.addinivalue_line(
        "markers",
        f"{MARK}(scene, noise_seed=None): the scene file, or name, of the fixtures field_scene, field_frames, "
        "field_truth and field_scorecard",
    )


@pytest.fixture(scope="session")
def rendered_field(request: pytest.FixtureRequest) -> "Callable[..., Rendered]":
    """`rendered_field(scene, noise_seed=None)`: a rendered scene, by its file or name."""
    found: dict[str, Any] = {}

    def get(scene: str | Path, noise_seed: int | None = None) -> "Rendered":
        from testfield.evaluate.rendered import rendered
        from testfield.store.cache import users_cache

        option = request.config.getoption("--field-cache")
        key = str(scene)
        if key not in found:
            cache = Path(option) if option else users_cache() / "renders"
            with _uncaptured(request.config):  # rendering takes minutes, and says how far it is
                found[key] = _spoken(lambda: rendered(scene, cache))
        own: Rendered = found[key].under(noise_seed)
        return own

    return get


@pytest.fixture
def field_scene(request: pytest.FixtureRequest, rendered_field: "Callable[..., Rendered]") -> "Rendered":
    """The rendered scene that the test's mark `field_scene` names."""
    mark = request.node.get_closest_marker(MARK)
    if mark is None or not mark.args:
        pytest.fail(f"{request.node.nodeid}: no scene is named; mark the test with @pytest.mark.{MARK}('quick')", False)
    beside = request.path.parent / mark.args[0]
    return rendered_field(beside if beside.is_file() else mark.args[0], mark.kwargs.get("noise_seed"))


@pytest.fixture
def field_frames(field_scene: "Rendered") -> "list[Frame]":
    """The images of the test's scene."""
    return field_scene.frames


@pytest.fixture
def field_truth(field_scene: "Rendered") -> "Truth":
    """What is true of the test's scene."""
    return field_scene.truth


@pytest.fixture
def field_scorecard(field_scene: "Rendered") -> dict[str, Any]:
    """Every figure of the test's scene by its path, measured by the scene's own recipe."""
    return _spoken(lambda: field_scene.scorecard)


@pytest.fixture
def field_regression(request: pytest.FixtureRequest) -> "FieldRegression":
    """`field_regression.check(metrics)`: figures held against the test's baseline, which `--field-record` writes."""
    from testfield.evaluate.regress.for_tests import FieldRegression, name_of

    return FieldRegression(
        name_of(request.node.nodeid),
        request.path.parent / "field_baselines",
        request.config.getoption("--field-record"),
    )


def _uncaptured(config: pytest.Config) -> AbstractContextManager[None]:
    """What is printed meanwhile goes to the terminal."""
    capture = config.pluginmanager.getplugin("capturemanager")
    return nullcontext() if capture is None else capture.global_and_fixture_disabled()


def _spoken(get: Callable[[], Any]) -> Any:
    """What a person can mend fails the test with a sentence."""
    from testfield.errors import TestfieldError

    try:
        return get()
    except TestfieldError as error:
        pytest.fail(error.sentence(), pytrace=False)
