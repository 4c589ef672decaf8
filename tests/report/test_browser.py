"""The page in a real browser: figures drawn, nothing complained about, nothing fetched, no sideways scrolling."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser, chromium

pytestmark = pytest.mark.skipif(chromium() is None, reason="no chromium")

FIGURES = """[...document.querySelectorAll('svg.plot')].map(s => {
  const marks = [...s.querySelectorAll('path, use')].filter(e => { const b = e.getBoundingClientRect();
    return !e.closest('.frame') && (b.width > 0.5 || b.height > 0.5) &&
      getComputedStyle(e).visibility === 'visible'; });
  const box = s.getBoundingClientRect();
  return [s.getAttribute('aria-label'), box.width, box.height, marks.length,
          s.querySelectorAll('text').length]; })"""
SIDEWAYS = """[...document.querySelectorAll('body *')].filter(e => !e.closest('.scroll, svg, .skip, thead') &&
  !(e.closest('.panels') && getComputedStyle(e.closest('.panels')).overflowX === 'auto') &&
  e.getBoundingClientRect().right > document.documentElement.clientWidth + 1).map(e => e.outerHTML.slice(0, 90))"""
SMALLEST_TEXT = """Math.min(...[...document.querySelectorAll('svg.plot text')].map(t => {
  const s = t.closest('svg'); const scale = s.getBoundingClientRect().width / s.viewBox.baseVal.width;
  return parseFloat(getComputedStyle(t).fontSize) * scale; }))"""
CONTRAST = """(() => {
  const style = getComputedStyle(document.documentElement), probe = document.createElement('span');
  document.body.append(probe);
  const light = name => { probe.style.color = style.getPropertyValue('--' + name);
    const c = getComputedStyle(probe).color.match(/[0-9.]+/g).slice(0, 3).map(v => v / 255)
      .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; };
  const ratio = (a, b) => (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  const out = Object.fromEntries(['ink', 'muted', 'blue', 'orange', 'green', 'purple', 'ochre', 'good', 'bad']
    .map(n => [n, ratio(light(n), light('panel'))]));
  probe.remove(); return out; })()"""


COVERED = """[...document.querySelectorAll('h3 + .tools')].filter(tools => {
  const words = document.createRange(); words.selectNodeContents(tools.previousElementSibling);
  const b = tools.getBoundingClientRect();
  return [...words.getClientRects()].some(
    a => a.right > b.left && a.left < b.right && a.bottom > b.top && a.top < b.bottom);
}).map(tools => tools.previousElementSibling.textContent)"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as started:
        yield started


@pytest.mark.parametrize(
    ("page", "width", "least"),
    [
        *((page, 380, 8.0) for page in ("paper_page", "gap_page", "fit_page", "other_page")),
        *(("paper_page", 1600, 8.9), ("gap_page", 1600, 11.0), ("fit_page", 1600, 11.0)),
    ],
)
def test_every_figure_is_drawn_and_read_nothing_is_fetched_covered_or_sticks_out(
    browser: Browser, page: str, width: int, least: float, request: pytest.FixtureRequest
) -> None:
    file: Path = request.getfixturevalue(page)
    seen = browser.open(file, width)
    assert seen.complaints == []
    assert seen.urls == [file.resolve().as_uri()]
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    assert browser.evaluate(SIDEWAYS) == []
    figures = browser.evaluate(FIGURES)
    assert len(figures) > 10
    for label, box_width, box_height, marks, texts in figures:
        assert box_width > 120, label
        assert box_height > 90, label
        assert marks > 0, label  # of the data: the frame alone is not a figure
        assert texts > 3, label
    assert browser.evaluate(SMALLEST_TEXT) >= least
    assert browser.evaluate("document.querySelectorAll('h3 + .tools').length") > 5
    assert browser.evaluate(COVERED) == [], "buttons over titles"
    if (page, width) == ("paper_page", 1600):
        for key in ("pairs", "atlas"):  # numbers in dense maps
            assert browser.evaluate(SMALLEST_TEXT.replace("svg.plot", f"#{key} svg.plot")) >= 11.0, key


@pytest.mark.parametrize(("page", "width"), [("gap_page", 760), ("gap_page", 1600), ("paper_page", 1200)])
def test_no_table_is_cut_off(browser: Browser, page: str, width: int, request: pytest.FixtureRequest) -> None:
    """But numbers under the figures of a study, some of which have a column for every start: they scroll."""
    browser.open(request.getfixturevalue(page), width)
    browser.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    cut = """[...document.querySelectorAll('.scroll')].filter(
        e => !e.closest('#figures, #beyond, #alternatives') && e.scrollWidth > e.clientWidth + 1
        ).map(e => e.textContent.slice(0, 60))"""
    assert browser.evaluate("document.querySelectorAll('.scroll').length") > 8
    assert browser.evaluate(cut) == []


@pytest.mark.parametrize("page", ["paper_page", "gap_page"])
def test_on_a_phone_a_table_that_scrolls_keeps_its_title_and_its_buttons_in_view(
    browser: Browser, page: str, request: pytest.FixtureRequest
) -> None:
    browser.open(request.getfixturevalue(page), 380)
    outside = """[...document.querySelectorAll('.scroll caption > span')].filter(e => {
      const words = document.createRange(); words.selectNodeContents(e);
      return e.offsetParent && words.getBoundingClientRect().right > 380; }).map(e => e.textContent)"""
    assert browser.evaluate("document.querySelectorAll('.scroll caption > span').length") > 8
    assert browser.evaluate(outside) == []


def test_a_phone_shows_the_verdict_on_a_published_statement_at_once(browser: Browser, paper_page: Path) -> None:
    browser.open(paper_page, 380)
    hidden = """(box => { const edge = box.getBoundingClientRect().right;
      const column = [...box.querySelectorAll('thead th')].findIndex(th => th.textContent === 'Verdict');
      return [...box.querySelectorAll('tr')].filter(
        row => row.cells[column].getBoundingClientRect().right > edge).length; })(document.querySelector('.tall'))"""
    assert browser.evaluate("document.querySelectorAll('.tall tbody tr').length") > 20
    assert browser.evaluate(hidden) == 0


def test_on_a_phone_the_page_is_not_a_scroll_of_cards(browser: Browser, paper_page: Path) -> None:
    """The list of published statements scrolls in its own box, and many panels stand in rows that scroll."""
    browser.open(paper_page, 380)
    heights = browser.evaluate("""[...document.querySelectorAll('.tall, .panels')].map(
      e => e.getBoundingClientRect().height)""")
    assert len(heights) > 10
    assert max(heights) < 1300
    rows = "document.querySelectorAll('.tall tbody tr').length"
    assert browser.evaluate(rows) > 20
    assert browser.evaluate("(e => e.scrollHeight > e.clientHeight)(document.querySelector('.tall'))")
    browser.evaluate("document.querySelector('.tall').scrollTop = 1e6")
    last = "document.querySelector('.tall tbody tr:last-child').getBoundingClientRect().bottom"
    assert browser.evaluate(f"{last} <= document.querySelector('.tall').getBoundingClientRect().bottom + 2")
    browser.send("Emulation.setEmulatedMedia", media="print")
    try:
        cut = "(e => e.scrollHeight > e.clientHeight + 1)(document.querySelector('.tall'))"
        assert not browser.evaluate(cut)
    finally:
        browser.send("Emulation.setEmulatedMedia", media="")


def test_text_and_series_stand_out_from_the_page_in_light_and_dark(browser: Browser, paper_page: Path) -> None:
    for scheme, background in (("light", "rgb(246, 248, 250)"), ("dark", "rgb(13, 16, 20)")):
        browser.open(paper_page, 1600, scheme=scheme)
        assert browser.evaluate("getComputedStyle(document.body).backgroundColor") == background
        for name, ratio in browser.evaluate(CONTRAST).items():
            assert ratio >= 4.5, (scheme, name)


def test_the_keyboard_reaches_the_results_first(browser: Browser, paper_page: Path) -> None:
    browser.open(paper_page, 1000)
    for kind in ("keyDown", "keyUp"):
        browser.send("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab", windowsVirtualKeyCode=9)
    assert browser.evaluate("document.activeElement.className") == "skip"
    assert browser.evaluate("document.activeElement.getBoundingClientRect().left") >= 0


def test_the_pointer_reads_the_value_that_was_plotted(browser: Browser, paper_page: Path) -> None:
    """Over the mean of a bar of Fig. 5, at its place on the screen."""
    browser.open(paper_page, 1600)
    name, x, y, value = browser.evaluate("""(() => {
      const figure = document.getElementById('estimates'), svg = figure.querySelector('svg.plot');
      figure.scrollIntoView({behavior: 'instant'});
      const panel = JSON.parse(figure.querySelector('script.readings').textContent)[0];
      const bars = panel.series.find(s => s.n === '5 N·m'), box = svg.getBoundingClientRect();
      const at = (a, v) => a[0] + (v - a[2]) / (a[3] - a[2]) * (a[1] - a[0]);
      const scale = box.width / svg.viewBox.baseVal.width;
      return [bars.n, box.left + scale * at(panel.x, bars.x[1]), box.top + scale * at(panel.y, bars.y[1]), bars.y[1]];
    })()""")
    browser.send("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    shown = browser.evaluate("document.querySelector('.tip').textContent")
    assert shown.startswith(name)
    assert f": {value:.4g} ± " in shown


def test_a_click_on_a_heading_sorts_its_column_as_numbers(browser: Browser, paper_page: Path) -> None:
    browser.open(paper_page, 1600)
    truths = browser.evaluate("""(() => {
      const table = document.querySelector('#estimates table');
      table.closest('details').open = true;
      table.tHead.rows[0].cells[1].querySelector('button').click();
      return [...table.tBodies[0].rows].map(r => parseFloat(r.cells[1].textContent));
    })()""")
    assert len(truths) == 12
    assert truths == sorted(truths)


def test_numbers_with_a_true_minus_sort_and_copy_as_numbers(browser: Browser, paper_page: Path) -> None:
    browser.open(paper_page, 1600)
    shown, saved = browser.evaluate("""(async () => {
      const table = document.querySelector('table.stack');
      table.tHead.rows[0].cells[3].querySelector('button').click();
      let blob, real = URL.createObjectURL;
      URL.createObjectURL = b => { blob = b; return real(b); };
      HTMLAnchorElement.prototype.click = () => {};
      [...table.caption.querySelectorAll('button')].find(b => b.textContent === 'CSV').click();
      return [[...table.tBodies[0].rows].map(r => r.cells[3].textContent), await blob.text()];
    })()""")
    found = [re.match(r"−?\d+(\.\d+)?(e−?\d+)?", text) for text in shown]
    numbers = [float(m[0].replace("−", "-")) for m in found if m is not None]
    assert min(numbers) < 0 < max(numbers)
    assert numbers == sorted(numbers)
    assert "−" not in saved
    assert f"{min(numbers):g} ± " in saved


def test_every_figure_offers_files_and_its_svg_stands_alone(browser: Browser, paper_page: Path) -> None:
    browser.open(paper_page, 1600)
    saved = browser.evaluate("""(async () => {
      const seen = {}, real = URL.createObjectURL;
      URL.createObjectURL = blob => { seen[blob.type] = blob; return real(blob); };
      HTMLAnchorElement.prototype.click = () => {};
      for (const b of document.querySelectorAll('#estimates h3 + .tools button'))
        if (b.textContent !== 'Enlarge') b.click();
      for (let i = 0; i < 100 && !seen['image/png']; i++) await new Promise(r => setTimeout(r, 50));
      return Object.fromEntries(await Promise.all(Object.entries(seen).map(
        async ([k, b]) => [k, k === 'image/png' ? String(b.size) : await b.text()])));
    })()""")
    assert int(saved["image/png"]) > 1000
    assert "var(--" not in saved["image/svg+xml"]
    assert "K11 (N·m/rad)" in saved["image/svg+xml"]
    assert "K11,5 N·m," in saved["text/csv"]


def test_without_scripts_everything_is_visible_and_nothing_is_offered_in_vain(
    browser: Browser, paper_page: Path
) -> None:
    browser.send("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(paper_page, 1600)
        assert browser.evaluate("document.querySelectorAll('button').length") == 0
        assert browser.evaluate("[...document.querySelectorAll('table')].filter(t => !t.checkVisibility()).length") == 0
    finally:
        browser.send("Emulation.setScriptExecutionDisabled", value=False)


@pytest.mark.parametrize(("page", "most"), [("paper_page", 12), ("gap_page", 5)])
def test_print_shows_the_numbers_behind_every_figure_on_few_pages(
    browser: Browser, page: str, most: int, request: pytest.FixtureRequest
) -> None:
    browser.open(request.getfixturevalue(page), 1000)
    browser.send("Emulation.setEmulatedMedia", media="print")
    hidden = browser.evaluate(
        "[...document.querySelectorAll('details table')].filter(t => !t.checkVisibility()).length"
    )
    assert hidden == 0
    apart = "[...document.querySelectorAll('.panels')].filter(e => getComputedStyle(e).breakInside !== 'avoid').length"
    assert browser.evaluate(apart) == 0
    # A browser leaves boxes, such as buttons, out of the headings that it repeats on the next page.
    boxes = "[...document.querySelectorAll('thead button')].map(e => getComputedStyle(e).display)"
    assert set(browser.evaluate(boxes)) == {"contents"}
    pdf = browser.printed()
    assert pdf.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page[^s]", pdf)) <= most


ENLARGED = """(async () => {
  const out = [], box = document.querySelector('dialog');
  for (const figure of document.querySelectorAll('figure')) {
    const button = [...figure.querySelectorAll('.tools button')].find(b => b.textContent === 'Enlarge');
    if (!button) continue;
    const svgs = [...figure.querySelectorAll('svg.plot')], before = svgs[0].getBoundingClientRect().width;
    button.focus();
    button.click();
    const held = box.open && svgs.every(s => box.contains(s)), size = svgs[0].getBoundingClientRect();
    const bottom = Math.max(...svgs.map(s => s.getBoundingClientRect().bottom));
    const left = Math.min(...svgs.map(s => s.getBoundingClientRect().left));
    const sideways = box.scrollWidth > box.clientWidth + 1;
    const closed = new Promise(done => box.addEventListener('close', done, { once: true }));
    box.querySelector('button').click();
    await closed;
    out.push({ id: figure.id, held, factor: size.width / before, bottom, left, sideways,
      back: svgs.every(s => figure.contains(s)) && svgs[0].getBoundingClientRect().width === before,
      focus: document.activeElement === button });
  }
  return out; })()"""


@pytest.mark.parametrize(("page", "width"), [("paper_page", 1200), ("gap_page", 380), ("fit_page", 1200)])
def test_enlarge_shows_every_figure_larger_over_the_window_and_puts_it_back(
    browser: Browser, page: str, width: int, request: pytest.FixtureRequest
) -> None:
    seen = browser.open(request.getfixturevalue(page), width)
    figures = browser.evaluate(ENLARGED)
    assert len(figures) == browser.evaluate("[...document.querySelectorAll('figure:has(svg.plot)')].length") > 5
    for f in figures:
        assert f["held"], f
        assert f["factor"] > 1.2, f
        assert f["left"] >= 0, f
        assert f["back"], f
        assert f["focus"], f
        assert width < 600 or not f["sideways"], f
    assert seen.complaints == []


def test_escape_closes_an_enlarged_figure_and_values_are_read_in_it(browser: Browser, fit_page: Path) -> None:
    browser.open(fit_page, 1200)
    key = "[...document.querySelectorAll('.tools button')].find(b => b.textContent === 'Enlarge')"
    browser.evaluate(f"{key}.focus()")
    for kind in ("rawKeyDown", "char", "keyUp"):
        browser.send(
            "Input.dispatchKeyEvent", type=kind, key="Enter", code="Enter", windowsVirtualKeyCode=13, text="\r"
        )
    assert browser.evaluate("document.querySelector('dialog').open")
    assert browser.evaluate("document.querySelector('dialog').ariaLabel.length") > 3
    x, y = browser.evaluate(
        "(() => { const r = document.querySelector('dialog svg.plot').getBoundingClientRect();"
        " return [r.x + r.width / 2, r.y + r.height / 2]; })()"
    )
    browser.send("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    assert browser.evaluate("document.querySelector('dialog .tip').checkVisibility()")
    for kind in ("rawKeyDown", "keyUp"):
        browser.send("Input.dispatchKeyEvent", type=kind, key="Escape", code="Escape", windowsVirtualKeyCode=27)
    assert not browser.evaluate("document.querySelector('dialog').open")
    for _ in range(100):  # the browser tells of the closing later
        if browser.evaluate("document.querySelectorAll('dialog svg.plot').length") == 0:
            break
        time.sleep(0.05)
    assert browser.evaluate("document.querySelectorAll('dialog svg.plot').length") == 0
