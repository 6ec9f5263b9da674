"""An option that means nothing for what was asked is refused, whatever its default is."""

from pathlib import Path

import pytest

from testfield.cli.main import main

RING = ["--target", "ring14"]


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["detect", "RUN", "--no-dense"], "--no-dense"),
        (["detect", "RUN", "--no-shade"], "--no-shade"),
        (["detect", "a.png", "--target", "checkerboard:9x6", "--no-dense"], "--no-dense"),
        (["detect", "a.png", "--target", "cctag:3", "--no-shade"], "--no-shade"),
        (["measure", "a.png", "--target", "checkerboard:9x6:25", "--no-dense"], "--no-dense"),
        (["measure", "a.png", "--target", "cctag:3", "--smallest-px", "7"], "--smallest-px"),
        (["measure", "a.png", "--target", "checkerboard:9x6:25", "--focal-px", "700"], "--focal-px"),
        (["measure", "--observations", "RUN", *RING, "--no-shade"], "--no-shade"),
        (["measure", "--observations", "RUN", *RING, "--bayer", "RGGB"], "--bayer"),
        (["measure", "a.png", *RING, "--size-px", "640x480"], "--size-px"),
        (["uncertainty", "RUN", "--depth", "exposure", "--shortest"], "--shortest"),
        (["list", "templates", "--pictures", "RUN", "--json"], "--json"),
        (["new", "algorithm", "mine", "--force"], "--force"),
        (["new", "wall", "mine", "--kind", "calibrator"], "--kind"),
        (["plan", "quick", "--force"], "--force"),
        (["bench", "recall", "--hard", "--quick"], "--quick"),
        (["bench", "recall", "--hard", "--kinds"], "--kinds"),
        (["bench", "recall", "--hard", "--pictures", "2"], "--pictures"),
        (["bench", "recall", "--quick", "--out", "RUN"], "--out"),
    ],
)
def test_an_option_without_effect_is_refused_by_name(
    words: list[str], option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "RUN").mkdir()
    if words[:2] == ["new", "wall"]:
        from testfield.author.templates import templates

        words = ["new", next(iter(templates())), *words[2:]]
    assert main(words) == 2
    said = capsys.readouterr().err.strip()
    assert option in said and len(said.splitlines()) == 1
