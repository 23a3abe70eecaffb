"""Tests of the bench in a real browser, by keyboard: from upload to certificate."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright")
axe_api = pytest.importorskip(
    "axe_playwright_python.sync_playwright", reason="needs axe-playwright-python"
)
pytest.importorskip("starlette", reason="needs the extra [serve]")
pytest.importorskip("sqlalchemy", reason="needs the extra [serve]")

from delta_calibration.processes import child_environment  # noqa: E402
from delta_calibration.recording import read_session, write_session  # noqa: E402
from headless import chromium  # noqa: E402

ROOT = Path(__file__).parents[1]
BAG = ROOT / "bags" / "srbd_plain"
TABLE = ROOT / "bags" / "srbd_plain.csv"
WIDE, NARROW = 1280, 400
PATIENCE_MS = 120_000
DELTA_CAL = (sys.executable, "-m", "delta_calibration.cli.main")
OTHERS = ("", "machines", "machine?name=press+3", "cell", "cell/confirm?node=/n&order=enable")
OPTIONS = ("--no-cell", "--most=20")
TABS = 60  # presses of the Tab key within which everything is reached
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        chromium() is None, reason="no Chromium on this machine: apt install chromium"
    ),
]


@dataclass
class Server:
    """A bench in a separate process."""

    link: str
    log: Path

    @property
    def home(self) -> str:
        return self.link.partition("?")[0]

    @property
    def token(self) -> str:
        return self.link.partition("token=")[2]


@contextmanager
def served(folder: Path) -> Iterator[Server]:
    log = folder / "serve.log"
    with log.open("w") as errors:
        process = subprocess.Popen(
            [*DELTA_CAL, "serve", "--port=0", f"--data={folder / 'data'}", *OPTIONS],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env=child_environment() | {"PYTHONPATH": ":".join([str(ROOT), *sys.path[1:]])},
        )
        try:
            assert process.stdout is not None
            process.stdout.readline()
            yield Server(process.stdout.readline().strip(), log)
        finally:
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=30)


@dataclass
class Seen:
    """Findings: accessibility violations and page widths, by the name of the page."""

    violations: dict[str, list[str]] = field(default_factory=dict)
    widths: dict[str, int] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)
    hosts: set[str] = field(default_factory=set)


@dataclass
class Story:
    """A session uploaded in degrees, repaired, diagnosed and certified."""

    server: Server
    seen: Seen
    path: str  # path of its page
    question: str
    elsewhere: str  # the same in a second browser
    verdict: str
    certificate: bytes
    numbers: dict


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with served(tmp_path_factory.mktemp("bench")) as running:
        yield running


@pytest.fixture(scope="module")
def chrome() -> Iterator[sync_api.Browser]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(FLAGS))
        yield browser
        browser.close()


def opened(chrome: sync_api.Browser, server: Server, seen: Seen) -> sync_api.Page:
    """A page of a browser that opens the link for the first time."""
    page = chrome.new_context(viewport={"width": WIDE, "height": 900}).new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.on("pageerror", lambda error: seen.errors.append(str(error)))
    page.on("console", lambda said: said.type == "error" and seen.errors.append(said.text))
    page.on("request", lambda asked: seen.hosts.add(asked.url.split("/")[2]))
    page.goto(server.link)
    return page


def look(page: sync_api.Page, seen: Seen, name: str) -> None:
    """Record what is wrong with a page, wide and narrow."""
    for width in (NARROW, WIDE):
        page.set_viewport_size({"width": width, "height": 900})
        found = axe_api.Axe().run(page).response["violations"]
        seen.violations[f"{name}, {width}"] = [
            f"{v['id']}: {v['nodes'][0]['html'][:200]}" for v in found
        ]
        seen.widths[f"{name}, {width}"] = page.evaluate("document.documentElement.scrollWidth")


def tab_to(page: sync_api.Page, selector: str) -> None:
    """Press Tab until an element has the focus; check that the focus is visible."""
    for _ in range(TABS):
        page.keyboard.press("Tab")
        if page.evaluate(f"document.activeElement.matches({json.dumps(selector)})"):
            outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
            assert outline != "none", f"{selector}: the focus is not seen"
            return
    raise AssertionError(f"{selector}: not reached by {TABS} presses of the Tab key")


def dropped(page: sync_api.Page, path: Path, machine: str) -> None:
    """Choose a file, fill in the form and send it, by keyboard."""
    page.once("filechooser", lambda chooser: chooser.set_files(path))
    tab_to(page, "#files")
    page.keyboard.press("Space")
    page.wait_for_selector("#files:valid")
    tab_to(page, "#machine")
    page.keyboard.type(machine)
    tab_to(page, "#robot")
    page.keyboard.type("srbd")
    tab_to(page, "form.drop button[type=submit]")
    page.keyboard.press("Enter")


@pytest.fixture(scope="module")
def degrees(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The zip of a session whose joints were recorded in degrees."""
    folder = tmp_path_factory.mktemp("degrees")
    plain = read_session(BAG)
    assert plain.command is not None
    assert plain.states is not None
    command, states = (
        replace(stream, position=np.rad2deg(stream.position))
        for stream in (plain.command, plain.states)
    )
    write_session(folder / "night_shift", replace(plain, command=command, states=states))
    with zipfile.ZipFile(folder / "night.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted((folder / "night_shift").iterdir()):
            archive.write(path, f"night_shift/{path.name}")
    return folder / "night.zip"


@pytest.fixture(scope="module")
def story(chrome: sync_api.Browser, server: Server, degrees: Path) -> Story:
    seen = Seen()
    page = opened(chrome, server, seen)
    look(page, seen, "home")
    dropped(page, degrees, "press 3")
    page.wait_for_url("**/sessions/*")
    look(page, seen, "work")
    page.wait_for_selector("#mend")
    second = opened(chrome, server, seen)
    second.get_by_role("link", name="night_shift").click()
    second.wait_for_selector("#mend")
    question, elsewhere = (each.inner_text("#state dl") for each in (page, second))
    look(page, seen, "question")
    tab_to(page, "#mend")
    page.keyboard.press("Enter")
    second.wait_for_selector("#state h1:has-text('held-out error')")
    second.wait_for_selector("progress", state="detached")
    page.wait_for_selector("progress", state="detached")
    verdict = page.inner_text("h1")
    assert second.inner_text("h1") == verdict
    look(page, seen, "verdict")
    tab_to(page, "#machine_serial")
    page.keyboard.type("SN 0815")
    tab_to(page, "form[action$=certificate] button")
    page.keyboard.press("Enter")
    page.wait_for_selector("a:has-text('Certificate, to print')")
    taken = {}
    for name in ("certificate.pdf", "certificate.json"):
        tab_to(page, f"a[href$='{name}']")
        with page.expect_download() as download:
            page.keyboard.press("Enter")
        taken[name] = Path(download.value.path()).read_bytes()
    look(page, seen, "certificate")
    for path in (
        "",
        "machines",
        "machine?name=press+3",
        "cell",
        "cell/confirm?node=/n&order=enable",
    ):
        page.goto(server.home + path)
        look(page, seen, path)
    return Story(
        server,
        seen,
        second.url.removeprefix(server.home),
        question,
        elsewhere,
        verdict,
        taken["certificate.pdf"],
        json.loads(taken["certificate.json"]),
    )


def test_a_doubt_is_asked_with_its_evidence_in_every_browser(story: Story) -> None:
    assert "Unit degrees in joint command: 57.2958 deg/rad" in story.question
    assert "Remedy: " in story.question
    assert story.elsewhere == story.question


def test_the_verdict_is_read(story: Story) -> None:
    assert story.verdict.startswith("The calibrated geometry explains the data")
    errors = [float(value) for value in re.findall(r"(\d\.\d+) mm", story.verdict)]
    assert errors[1] < 0.05 < 1.0 < errors[0]


def test_the_certificate_is_taken(story: Story) -> None:
    assert story.certificate.startswith(b"%PDF-")
    assert "SN 0815" in json.dumps(story.numbers)


def test_the_machine_is_in_the_history(
    chrome: sync_api.Browser, server: Server, story: Story
) -> None:
    page = opened(chrome, server, Seen())
    page.goto(f"{server.home}machine?name=press+3")
    rows = page.locator("#sessions tbody tr").all_inner_texts()
    assert len(rows) == 1
    assert rows[0].endswith("nothing beyond geometry")
    page.locator("#sessions tbody a").click()
    assert page.inner_text("h1") == story.verdict


def test_no_page_has_a_violation_of_accessibility(story: Story) -> None:
    assert {page: found for page, found in story.seen.violations.items() if found} == {}
    assert len(story.seen.violations) == 20


def test_nothing_sticks_out_of_the_window(story: Story) -> None:
    too_wide = {
        page: width
        for page, width in story.seen.widths.items()
        if width > int(page.rpartition(", ")[2])
    }
    assert too_wide == {}


def test_no_error_and_no_other_host(story: Story) -> None:
    assert story.seen.errors == []
    assert story.seen.hosts == {story.server.home.split("/")[2]}


def test_the_token_is_in_no_log(story: Story) -> None:
    assert story.server.token not in story.server.log.read_text()


def test_a_report_is_shown_apart_from_the_bench(
    chrome: sync_api.Browser, server: Server, story: Story
) -> None:
    """Its scripts run and draw; they have no origin, and reach nothing."""
    seen = Seen()
    page = opened(chrome, server, seen)
    page.goto(f"{server.home}{story.path}/files/report.html?show=1")
    page.wait_for_selector(".plot.js-plotly-plot")
    assert page.evaluate("self.origin") == "null"
    assert page.evaluate(f"fetch('{server.home}').then(() => 'reached', () => 'refused')") == (
        "refused"
    )


def test_a_table_is_shown_as_it_would_be_read_and_can_be_left(
    chrome: sync_api.Browser, server: Server
) -> None:
    seen = Seen()
    page = opened(chrome, server, seen)
    dropped(page, TABLE, "")
    page.wait_for_selector("#take")
    look(page, seen, "columns")
    rows = page.locator("#state tbody tr").all_inner_texts()
    assert len(rows) == 10
    assert rows[0].split("\t")[0] == "-10.3924"
    assert "joint_1, column: A1, unit: deg" in page.input_value("#mapping")
    tab_to(page, "#stop")
    page.keyboard.press("Enter")
    page.wait_for_selector("h1:has-text('Stopped')")
    assert [found for found in seen.violations.values() if found] == []
    assert seen.widths["columns, 400"] == NARROW


def drag(page: sync_api.Page, name: str, content: bytes) -> None:
    """Drag a file over the form and drop it there."""
    page.evaluate(
        """([name, bytes]) => {
            const held = new DataTransfer();
            held.items.add(new File([new Uint8Array(bytes)], name));
            const target = document.querySelector(".target");
            for (const kind of ["dragenter", "dragover", "drop"]) {
                const how = { dataTransfer: held, bubbles: true, cancelable: true };
                if (target.dispatchEvent(new DragEvent(kind, how))) throw new Error(kind);
            }
        }""",
        [name, list(content)],
    )


def test_what_is_refused_is_told_where_it_was_dropped(
    chrome: sync_api.Browser, server: Server, tmp_path: Path
) -> None:
    seen = Seen()
    page = opened(chrome, server, seen)
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("../x.mcap", "x")
    drag(page, "a.zip", (tmp_path / "a.zip").read_bytes())
    page.select_option("#robot", "srbd")
    page.click("form.drop button")
    page.wait_for_selector(".sent.problem:has-text('lies outside the folder')")
    (tmp_path / "large.mcap").write_bytes(bytes(21 << 20))
    page.set_input_files("#files", tmp_path / "large.mcap")
    page.click("form.drop button")
    page.wait_for_selector(".sent:has-text('More than 20 MB')")


def test_a_stranger_sees_nothing(chrome: sync_api.Browser, server: Server) -> None:
    page = chrome.new_context().new_page()
    answer = page.goto(server.home)
    assert answer is not None
    assert answer.status == 403
