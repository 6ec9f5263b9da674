"""Templates are valid scenes whose stated accuracy is the one that a plan predicts; nothing is overwritten."""

import re
from pathlib import Path

import pytest
from PIL import Image

from testfield.author.templates import described, templates, write_template
from testfield.chain.run import Run, check_algorithms, examined
from testfield.cli.main import main
from testfield.cli.preview import seen
from testfield.errors import TestfieldError
from testfield.plan.card import card_of
from testfield.plan.job import Job
from testfield.plan.network import planned
from testfield.plan.predict import predict
from testfield.report.preview import COLOURS, SMALL_PX, draw_small
from testfield.scene.document import load_document
from testfield.scene.load import scene_from
from testfield.score.scorecard import plain
from testfield.store.ledger import Ledger

SCENES = Path(__file__).parents[1] / "scenes"
SAID = re.compile(r"u ([\d.]+) mm of a check target's coordinate \(rms, k = 1\), by `testfield plan`")


@pytest.mark.parametrize("template", templates())
def test_a_template_runs_as_it_is_and_states_what_its_plan_predicts(template: str, tmp_path: Path) -> None:
    path, *_ = write_template(template, "mine", tmp_path)
    document = load_document(path)
    scene = scene_from(document)
    assert scene.name == "mine"
    check_algorithms(scene, str(path))
    warnings = examined(Run(tmp_path, scene, str(path), Ledger(tmp_path)), document)
    assert not [one for one in warnings if "saturate" in one or "dark" in one]
    card = plain(card_of(predict(planned(Job.of(scene, str(path))))))
    assert card["points"]["measured"] == card["points"]["expected"]
    said = SAID.match(described(path)[1])
    assert said is not None
    assert float(said[1]) == pytest.approx(card["points"]["u_rms_mm"], rel=0.1)


def test_there_are_ten_templates_or_more_and_each_is_short() -> None:
    assert len(templates()) >= 10
    assert max(len(path.read_text().splitlines()) for path in templates().values()) < 180


def test_nothing_is_overwritten_without_force(tmp_path: Path) -> None:
    assert main(["new", "aircraft_wing", "one", "--out", str(tmp_path)]) == 0
    before = (tmp_path / "one.toml").read_bytes()
    (tmp_path / "wing.stl").write_text("my own")
    with pytest.raises(TestfieldError) as refused:
        write_template("aircraft_wing", "two", tmp_path)
    assert "wing.stl" in refused.value.sentence()
    assert not (tmp_path / "two.toml").exists()
    assert main(["new", "aircraft_wing", "one", "--out", str(tmp_path)]) == 2
    assert (tmp_path / "one.toml").read_bytes() == before
    assert main(["new", "aircraft_wing", "one", "--out", str(tmp_path), "--force"]) == 0
    assert (tmp_path / "wing.stl").read_bytes() != b"my own"


@pytest.mark.parametrize(
    ("template", "name", "words"),
    [
        ("aircraft_wings", "x", "did you mean 'aircraft_wing'"),
        ("charuco", "../x", "no scene's name"),
        ("charuco", "", "no scene's name"),
    ],
)
def test_what_is_no_template_or_no_name_is_refused(
    template: str, name: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert main(["new", template, name, "--out", str(tmp_path)]) == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_templates_are_listed_with_what_they_expect(capsys: pytest.CaptureFixture) -> None:
    assert main(["list", "templates"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in templates())


def test_the_gallery_shows_every_template_with_the_accuracy_that_it_states() -> None:
    page = (SCENES / "README.md").read_text()
    for name, path in templates().items():
        picture = SCENES / "gallery" / f"{name}.png"
        assert picture.stat().st_size < 15_000
        said = SAID.match(described(path)[1])
        assert said is not None
        assert f"(gallery/{name}.png)<br>`{name}`, {said[1]} mm" in page


def test_a_small_picture_is_drawn_of_a_scene(tmp_path: Path) -> None:
    run, view, _ = seen(Path(__file__).parent / "torture/tiny.toml")
    draw_small(run.world, view, tmp_path / "small.png")
    with Image.open(tmp_path / "small.png") as image:
        assert image.size == SMALL_PX
        assert 2 < len(image.getcolors() or []) <= COLOURS
    assert main(["list", "boards", "--pictures", str(tmp_path)]) == 2
