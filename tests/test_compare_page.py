"""The page of a comparison in a real browser: alone, by hand, by night and on paper."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_comparison import APERTURE, made_comparison, made_page, made_rows

from testfield.evaluate.compare import Compared
from testfield.evaluate.paired import Word

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium here; .ci/setup installs it")

LUMINANCE = """colour => {
  const parts = colour.match(/[\\d.]+/g).slice(0, 3).map(v => v / 255);
  const [r, g, b] = parts.map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}"""
GROUND = """element => {
  for (let e = element; e; e = e.parentElement ?? e.getRootNode().host) {
    const colour = getComputedStyle(e).backgroundColor;
    if (!colour.endsWith(', 0)')) return colour;
  }
  return 'rgb(255, 255, 255)';
}"""
FIGURE = "[...Bokeh.documents[0]._all_models.values()].filter(m => m.type == 'Figure')"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Compared]:
    """Four recipes on three scenes over four apertures."""
    return made_page(made_comparison(4, 3, 3, (APERTURE,)), tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


def opened(browser: Any, path: Path, **options: Any) -> Any:
    """The page, once its plots stand."""
    page = browser.new_page(viewport={"width": 1280, "height": 900}, **options)
    page.goto(f"file://{path}")
    page.wait_for_function("window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle", timeout=60_000)
    return page


@pytest.fixture
def page(browser: Any, made: tuple[Path, Compared]) -> Iterator[Any]:
    shown = opened(browser, made[0])
    yield shown
    shown.close()


@pytest.mark.parametrize("scenes", [pytest.param(1, marks=pytest.mark.slow), 3])
def test_it_needs_no_network_and_nothing_goes_wrong(
    browser: Any, made: tuple[Path, Compared], scenes: int, tmp_path: Path
) -> None:
    if scenes == 1:
        made = made_page(made_comparison(2, 1, 1), tmp_path, floor_px=None)
    context = browser.new_context(offline=True)
    asked, wrong = [], []
    context.on("request", lambda request: asked.append(request.url))
    shown = context.new_page()
    shown.on("console", lambda said: wrong.append(said.text) if said.type in ("error", "warning") else None)
    shown.on("pageerror", lambda error: wrong.append(str(error)))
    shown.goto(f"file://{made[0]}")
    shown.wait_for_function("window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle", timeout=60_000)
    assert asked == [f"file://{made[0]}"] and not wrong
    assert shown.locator(".bk-Figure canvas").count() > 0 and shown.locator(".bk-DataTable").count() >= 6
    context.close()


def test_a_value_speaks_when_the_mouse_is_over_it(page: Any, made: tuple[Path, Compared]) -> None:
    place = page.evaluate(
        f"""() => {{
          const figure = {FIGURE}[0], view = Bokeh.index.find_one(figure);
          const points = figure.renderers.find(r => r.glyph.type == 'Scatter'), data = points.data_source.data;
          const box = view.el.getBoundingClientRect();
          return [box.x + view.frame.x_scale.compute(data.difference[0]),
                  box.y + view.frame.y_scale.compute(data.place[0]), data.difference[0]];
        }}"""
    )
    one = made[1].differences["recipe 1", "detection.centre_rms_px"]
    assert place[2] == pytest.approx(one.estimate.value)
    page.mouse.move(place[0] - 30, place[1] - 30)
    page.mouse.move(*place[:2])
    tip = page.locator(".bk-Tooltip", has_text="recipe 1").first
    tip.wait_for(timeout=5000)
    assert tip.get_by_text(one.word.value).count() >= 1 and tip.get_by_text("all scenes").count() >= 1


def test_a_click_on_a_name_hides_it_and_another_shows_it_again(page: Any) -> None:
    drawn = f"() => {FIGURE}[0].renderers.filter(r => !r.visible).length"
    assert page.evaluate(drawn) == 0
    name = page.locator(".bk-Legend .bk-item", has_text="recipe 2").first
    name.click()
    assert page.evaluate(drawn) == 2  # its points and their intervals
    name.click()
    assert page.evaluate(drawn) == 0


def test_another_figure_is_shown_by_its_name(page: Any) -> None:
    visible = "f => Bokeh.index.find_one(f)?.el.checkVisibility({checkVisibilityCSS: true})"
    seen = f"() => {FIGURE}.filter({visible}).map(f => f.below[0].axis_label)"
    assert page.evaluate(seen)[0].endswith("px")
    page.locator(".bk-tab", has_text="check points, RMSE").first.click()
    page.wait_for_function(f"() => ({seen})()[0].endsWith('um')", timeout=5000)


def test_a_click_on_a_head_sorts_the_table(page: Any, made: tuple[Path, Compared]) -> None:
    table = page.locator(".bk-DataTable").first
    table.scroll_into_view_if_needed()
    heads = table.locator(".slick-header-column")
    column = next(k for k in range(heads.count()) if heads.nth(k).inner_text().strip() == "difference")

    def values() -> list[float]:
        cells = table.locator(f".slick-cell.l{column}")
        pairs = [(c.bounding_box()["y"], float(c.inner_text().replace("−", "-"))) for c in cells.all()]
        return [value for _, value in sorted(pairs)]

    true = sorted(one.estimate.value for one in made[1].differences.values())
    assert values() != sorted(values())
    heads.nth(column).click()
    assert values() == sorted(values()) and values()[0] == pytest.approx(true[0], rel=1e-3)
    heads.nth(column).click()
    assert values() == sorted(values(), reverse=True)


@pytest.mark.parametrize("scheme", [pytest.param("light", marks=pytest.mark.slow), "dark"])
def test_it_can_be_read_by_day_and_by_night(browser: Any, made: tuple[Path, Compared], scheme: str) -> None:
    shown = opened(browser, made[0], color_scheme=scheme)

    def brightness(css: str, of: str) -> float:
        element = shown.locator(css).first
        return element.evaluate(f"(element, of) => ({LUMINANCE})(getComputedStyle(element)[of])", of)

    ground = brightness("main", "backgroundColor")
    assert (ground < 0.05) == (scheme == "dark") and (ground > 0.9) == (scheme == "light")
    for text in ("h1", "p", "td", ".verdict", ".lead"):
        low, high = sorted([ground, brightness(text, "color")])
        assert (high + 0.05) / (low + 0.05) >= 4.5, text
    for inside in (".slick-row .slick-cell", ".slick-header-column", ".bk-tab.bk-active"):
        own = shown.locator(inside).first.evaluate(GROUND)
        low, high = sorted([brightness(inside, "color"), shown.evaluate(LUMINANCE, own)])
        assert (high + 0.05) / (low + 0.05) >= 4.5, inside
    # Words of plots are drawn, so they have one colour for both.
    colour = shown.evaluate(f"() => {FIGURE}[0].below[0].axis_label_text_color")
    rgb = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    low, high = sorted([ground, shown.evaluate(LUMINANCE, str(rgb))])
    assert (high + 0.05) / (low + 0.05) >= 3.4
    shown.close()


def test_on_paper_there_are_drawings_and_whole_tables(page: Any, made: tuple[Path, Compared]) -> None:
    assert page.locator(".paper svg:visible").count() == 0
    page.emulate_media(media="print")
    assert page.locator(".screen:visible").count() == 0
    assert page.locator(".paper svg:visible").count() >= 5 + 5
    text = page.locator(".paper:visible").all_inner_texts()
    assert sum(one.count("recipe 3") for one in text) > len(made[1].scenes) / 3  # a row for each, none scrolled away
    sheets = page.pdf(format="A4")
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", sheets)) <= 15


@pytest.mark.slow
def test_ten_recipes_on_ten_scenes_take_less_than_five_megabytes(tmp_path: Path) -> None:
    path, _ = made_page(made_comparison(10, 10, 2, (APERTURE,)), tmp_path)
    assert path.stat().st_size < 5e6


@pytest.mark.parametrize("dead", [(1,), (2,), (1, 2, 3)])
def test_recipes_without_any_result_leave_a_page_that_says_so(tmp_path: Path, dead: tuple[int, ...]) -> None:
    comparison = made_comparison(4, 2, 3)
    rows = made_rows(comparison)
    of_dead = rows.recipe.isin([comparison.recipes[k].name for k in dead])
    for name in rows.columns.difference(["scene", "factor", "level", "draw", "recipe"]):
        rows.loc[of_dead, name] = np.nan if rows[name].dtype.kind in "fiu" else None
    rows.loc[of_dead, ["failure", "failure_kind", "failure_stage"]] = ("did not end within 2 s", "timed out", "detect")
    place, compared = made_page(comparison, tmp_path, rows=rows)
    first = comparison.recipes[dead[0]].name
    words = {key: one.word for (recipe, key), one in compared.differences.items() if recipe == first}
    assert set(words.values()) == {Word.NOTHING}, words
    assert "did not end within 2 s" in place.read_text(encoding="utf-8")
