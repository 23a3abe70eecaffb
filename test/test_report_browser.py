"""The page in a browser: no request to any host, no error, plots drawn, at two widths."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("jinja2", reason="needs the extra [report]")
pytest.importorskip("plotly", reason="needs the extra [report]")
image = pytest.importorskip("matplotlib.image", reason="needs the extra [report]")

from delta_calibration.report import report_of, write_page  # noqa: E402
from headless import Browser, browser, chromium  # noqa: E402
from report_bench import HOSTILE, JOINTS, PROVENANCE, found  # noqa: E402

pytestmark = pytest.mark.skipif(
    chromium() is None, reason="no Chromium on this machine: apt install chromium"
)
WIDE, NARROW, TALL = 1280, 400, 20_000


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "page.html"
    write_page(path, report_of(found(), HOSTILE, PROVENANCE))
    return path


@pytest.fixture(scope="module")
def chrome() -> Iterator[Browser]:
    with browser() as opened:
        yield opened


def plots(chrome: Browser) -> list[str]:
    return chrome.run("[...document.querySelectorAll('.plot')].map(p => p.id)")


def opened(chrome: Browser, page: Path, width: int) -> None:
    """Open the page in a window high enough to draw every plot."""
    chrome.open(page, width, TALL)
    for _ in range(60):
        if chrome.run("document.querySelectorAll('.plot:not(.js-plotly-plot)').length") == 0:
            return
        chrome.settle(0.2)
    raise AssertionError("some plots were not drawn")


@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_no_error_no_request_and_the_plots_are_drawn(
    chrome: Browser, page: Path, width: int
) -> None:
    opened(chrome, page, width)
    assert chrome.errors == []
    hosts = [url for url in chrome.requests if not url.startswith(("file:", "data:", "blob:"))]
    assert hosts == []
    assert [url for url in chrome.requests if url.startswith("file:")] == [page.as_uri()]
    ids = plots(chrome)
    assert len(ids) > 15
    whole = image.imread(io.BytesIO(chrome.screenshot()))[..., :3]
    for id_ in ids:
        x, y, wide, high = chrome.run(
            f"(() => {{ const b = document.getElementById('{id_}').querySelector('.main-svg')"
            ".getBoundingClientRect(); return [b.x, b.y + scrollY, b.width, b.height]; })()"
        )
        inside = whole[int(y) : int(y + high), int(x) : int(x + wide)]
        coloured = (np.ptp(inside, axis=-1) > 0.15).mean()  # data are coloured, axes are grey
        assert coloured > 5e-4, id_


@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_nothing_sticks_out_of_the_window(chrome: Browser, page: Path, width: int) -> None:
    opened(chrome, page, width)
    assert chrome.run("document.documentElement.scrollWidth") <= width
    too_wide = chrome.run(
        "[...document.querySelectorAll('.plot svg, h1, h2, h3, p, dd')]"
        f".filter(e => e.getBoundingClientRect().right > {width} + 1)"
        ".map(e => e.outerHTML.slice(0, 80))"
    )
    assert too_wide == []
    assert chrome.run("document.querySelector('.scale .bar').clientHeight") > 8
    assert chrome.run("document.querySelector('.plot svg').getBoundingClientRect().width") > 180


def test_a_window_made_narrow_draws_again(chrome: Browser, page: Path) -> None:
    opened(chrome, page, WIDE)
    width = "document.querySelector('#figure-error_line .plot svg').getBoundingClientRect().width"
    before = chrome.run(width)
    chrome.resize(NARROW, TALL)
    chrome.settle(1.5)
    assert chrome.run(width) < NARROW < before


def test_a_square_picture_has_no_empty_frame_in_a_narrow_window(
    chrome: Browser, page: Path
) -> None:
    """The names of the correlations take half of the width, and each needs a line of text."""
    opened(chrome, page, NARROW)
    chrome.settle(0.5)
    high, drawn, names = chrome.run(
        "(() => { const p = document.getElementById('plot-correlations-0');"
        "const box = (s) => p.querySelector(s).getBoundingClientRect();"
        "return [box('.main-svg').height, box('.heatmaplayer').height,"
        "p.querySelectorAll('.ytick').length]; })()"
    )
    assert high < drawn + 90
    assert names * 14 < drawn


def test_a_window_made_wide_draws_as_if_it_had_been(chrome: Browser, page: Path) -> None:
    """After a narrow window, pictures have their height and names again."""
    look = (
        "(() => { const p = document.getElementById('plot-correlations-0');"
        "return [p.clientHeight, p.querySelector('.main-svg').getBoundingClientRect().height,"
        "p.querySelectorAll('.ytick').length]; })()"
    )
    opened(chrome, page, WIDE)
    chrome.settle(0.5)
    wanted = chrome.run(look)
    for width in (NARROW, WIDE):
        chrome.resize(width, TALL)
        chrome.settle(1.0)
    assert chrome.run(look) == wanted


def test_names_are_text(chrome: Browser, page: Path) -> None:
    opened(chrome, page, WIDE)
    text = chrome.run("document.body.innerText + document.querySelector('main').textContent")
    for name in JOINTS:
        assert name in text
    assert chrome.run("document.querySelectorAll('.plot script, .plot img, .plot a').length") == 0


def test_it_is_printed_with_its_plots(chrome: Browser, page: Path) -> None:
    """Plots of a page that was not scrolled have to be drawn before printing."""
    chrome.open(page, WIDE, 600)
    drawn = "document.querySelectorAll('.js-plotly-plot').length"
    assert chrome.run(drawn) < len(plots(chrome))
    assert chrome.pdf().startswith(b"%PDF")
    assert chrome.run(drawn) == len(plots(chrome))
    assert chrome.errors == []
