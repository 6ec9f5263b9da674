"""Planted defects still apply, each names a test that is there; `make mutants` runs them."""

import ast
import sys
from pathlib import Path

import pytest

import testfield

sys.path.insert(0, str(Path(__file__).parent / "mutants"))

from defects import DEFECTS
from planting import Defect, plant

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def package() -> Path:
    return Path(testfield.__file__).parent


def test_every_defect_still_finds_its_one_place_and_leaves_sound_source(package: Path) -> None:
    lost = []
    for defect in DEFECTS:
        try:
            planted = plant(defect, package)
        except LookupError as error:
            lost.append(str(error))
            continue
        if planted.path.suffix == ".py":
            ast.parse(planted.text)
        assert planted.text != planted.path.read_text(encoding="utf-8"), defect.name
    assert not lost


def test_there_are_sixty_defects_and_more_each_with_a_name_of_its_own() -> None:
    assert len(DEFECTS) >= 60
    assert len({defect.name for defect in DEFECTS}) == len(DEFECTS)


def test_every_defect_names_a_test_that_is_there() -> None:
    for defect in DEFECTS:
        path, _, name = defect.test.partition("::")
        functions = {
            node.name
            for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8")))
            if isinstance(node, ast.FunctionDef)
        }
        assert name.partition("[")[0] in functions, defect.test


def test_a_shape_survives_another_layout_and_other_names(tmp_path: Path) -> None:
    (tmp_path / "moved.py").write_text(
        "class A:\n    def f(self, e):\n        return g(sqrt(\n            (e ** 2).mean()))\n"
    )
    planted = plant(Defect("rms", "A.f", "sqrt((__x__**2).mean())", "__x__.mean()", ""), tmp_path)
    assert "g((e.mean()))" in planted.text
    for within, find in (("A.g", "sqrt((__x__**2).mean())"), ("f", "sqrt((__x__**3).mean())"), ("", "__x__")):
        with pytest.raises(LookupError):
            plant(Defect("lost", within, find, "0", ""), tmp_path)
