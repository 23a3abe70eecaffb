"""Tests of the bench: access, uploads, order of the verbs, files on disk."""

from __future__ import annotations

import io
import re
import socket
import stat
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import click
import pytest

pytest.importorskip("starlette", reason="needs the extra [serve]")
pytest.importorskip("httpx2", reason="needs httpx2")
pytest.importorskip("sqlalchemy", reason="needs the extra [serve]")

from starlette.testclient import TestClient

from delta_calibration.bench import flow, runner
from delta_calibration.bench.app import application, opened, serve, write_door
from delta_calibration.bench.cases import (
    ASKING,
    BAG,
    DONE,
    FAILED,
    TABLE,
    WORKING,
    Case,
    Cases,
    file_name,
)
from delta_calibration.bench.flow import Said, answered, arguments, begun, ended, first_steps
from delta_calibration.bench.guard import HEADERS, Secrets
from delta_calibration.bench.runner import Runner
from delta_calibration.bench.shown import files
from delta_calibration.bench.state import Bench
from delta_calibration.bench.upload import Dropped, take_all
from delta_calibration.cli.main import group
from delta_calibration.errors import InputError, MistakeError
from delta_calibration.report import read_about

HOST = "127.0.0.1:8765"
HOME = f"http://{HOST}"
FOREIGN = "http://elsewhere.example"
MOST = 300_000  # bytes of an upload
PATIENCE_S = 20.0


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with opened(tmp_path / "data", MOST, watch=False) as made:
        yield made


@pytest.fixture
def stranger(bench: Bench) -> Iterator[TestClient]:
    """A browser that was not opened with the token."""
    app = application(bench, frozenset([HOST]))
    with TestClient(app, base_url=HOME, follow_redirects=False) as client:
        yield client


@pytest.fixture
def browser(bench: Bench, stranger: TestClient) -> TestClient:
    """A browser that was opened with the token."""
    assert stranger.get(f"/?token={bench.secrets.token}").status_code == 303
    stranger.headers["origin"] = HOME
    return stranger


def case(**given: object) -> Case:
    plain = Case("20261124-221530-3f2a", BAG, "night", "", "srbd", "2026-11-24T22:15:30+00:00")
    return replace(plain, session="bag/night", **given)


# --- access


@pytest.mark.parametrize("host", ["elsewhere.example", f"elsewhere.example:{8765}", "127.0.0.1:1"])
def test_another_name_of_the_server_gets_nothing(stranger: TestClient, host: str) -> None:
    answer = stranger.get("/", headers={"host": host})
    assert answer.status_code == 421
    assert "<" not in answer.text


@pytest.mark.parametrize("path", ["/", "/static/bench.js", "/machines", "/cell", "/no/such/page"])
def test_without_the_token_nothing_is_shown(stranger: TestClient, path: str) -> None:
    for cookie in ("", f"delta_cal_8765={'0' * 64}"):
        answer = stranger.get(path, headers={"cookie": cookie})
        assert answer.status_code == 403
        assert "open the link" in answer.text


def test_a_wrong_token_is_refused(stranger: TestClient) -> None:
    answer = stranger.get("/?token=wrong")
    assert answer.status_code == 403
    assert "wrong" not in answer.text.replace("not valid, or no longer valid", "")
    assert not answer.cookies


def test_the_token_becomes_a_cookie_and_leaves_the_address(
    bench: Bench, stranger: TestClient
) -> None:
    answer = stranger.get(f"{HOME}//elsewhere.example?token={bench.secrets.token}&x=1")
    assert answer.headers["location"] == "/elsewhere.example?x=1"
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=lax" in cookie
    assert bench.secrets.token not in cookie
    assert stranger.get("/").status_code == 200


def test_the_token_is_its_owners_and_stays(tmp_path: Path) -> None:
    with opened(tmp_path / "d", MOST, watch=False) as first:
        mode = stat.S_IMODE((tmp_path / "d" / "token").stat().st_mode)
    with opened(tmp_path / "d", MOST, watch=False) as second:
        assert second.secrets == first.secrets
    assert mode == 0o600
    assert stat.S_IMODE((tmp_path / "d").stat().st_mode) == 0o700


@pytest.mark.parametrize("path", ["/", "/no/such/page", "/static/bench.css"])
def test_every_answer_has_the_headers(browser: TestClient, path: str) -> None:
    headers = browser.get(path).headers
    assert {name: headers[name] for name in HEADERS} == dict(HEADERS)
    assert "unsafe" not in HEADERS["content-security-policy"]


def test_pages_have_no_script_or_style_in_them(browser: TestClient) -> None:
    for path in ("/", "/machines", "/cell", "/cell/confirm?node=/n&order=fit"):
        page = browser.get(path).text
        assert re.findall(r"<script(?! src=)|<style| style=| on\w+=", page) == []


@pytest.mark.parametrize("origin", [None, FOREIGN, "null", f"https://{HOST}.example"])
def test_what_changes_anything_comes_from_a_page_of_the_bench(
    bench: Bench, browser: TestClient, origin: str | None
) -> None:
    del browser.headers["origin"]
    headers = {} if origin is None else {"origin": origin}
    answer = browser.post("/sessions", data={"key": bench.secrets.key}, headers=headers)
    assert (answer.status_code, answer.text) == (
        403,
        "this request does not come from a page of this bench\n",
    )


@pytest.mark.parametrize(
    "path",
    [
        "/sessions",
        "/sessions/{id}/answer",
        "/sessions/{id}/stop",
        "/sessions/{id}/exports/c",
        "/machine/log",
        "/cell/order",
    ],
)
def test_a_form_without_the_key_changes_nothing(
    bench: Bench, browser: TestClient, path: str
) -> None:
    id_ = bench.cases.new_id()
    bench.cases.add(case(id=id_, state=ASKING, question="mistakes"))
    before = bench.cases.all()
    answer = browser.post(path.format(id=id_), data={"answer": "force", "key": "0" * 64})
    assert answer.status_code == 403
    assert bench.cases.all() == before


def test_reading_changes_nothing(browser: TestClient) -> None:
    for path in ("/sessions", "/machine/log", "/cell/order"):
        assert browser.get(path).status_code == 405


# --- uploads


def packed(*files: tuple[str, bytes], compress: int = zipfile.ZIP_DEFLATED) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", compress) as archive:
        for name, content in files:
            archive.writestr(name, content)
    return made.getvalue()


def with_link() -> bytes:
    entry = zipfile.ZipInfo("s/data.mcap")
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        archive.writestr(entry, "/etc/passwd")
    return made.getvalue()


def locked() -> bytes:
    """A zip whose entry is marked as encrypted."""
    plain = bytearray(packed(("s/data.mcap", b"x" * 10), compress=zipfile.ZIP_STORED))
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        plain[plain.index(mark) + offset] |= 1
    return bytes(plain)


def lying() -> bytes:
    """A zip whose list states a much smaller content."""
    plain = bytearray(packed(("s/data.mcap", bytes(2 * MOST))))
    for mark, offset in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        at = plain.index(mark) + offset
        plain[at : at + 4] = (100).to_bytes(4, "little")
    return bytes(plain)


REFUSED: dict[str, tuple[str, bytes, str]] = {
    "another kind": ("notes.pdf", b"%PDF", "is not a file that can be used here"),
    "no ending": ("session", b"x", "is not a file that can be used here"),
    "empty": ("a.mcap", b"", "is empty"),
    "too large": ("a.mcap", bytes(MOST + 1), "limit of"),
    "no zip": ("a.zip", b"PK but no zip", "is not a readable zip file"),
    "cut zip": ("a.zip", packed(("s/data.mcap", b"x" * 999))[:-30], "is not a readable zip file"),
    "nothing in it": ("a.zip", packed(("s/readme.md", b"x")), "no .mcap or .db3 file"),
    "two recordings": ("a.zip", packed(("s/a.mcap", b"x"), ("t/b.mcap", b"x")), "in 2 folders"),
    "unpacks too large": ("a.zip", packed(("s/data.mcap", bytes(2 * MOST))), "limit of"),
    "list that lies": ("a.zip", lying(), "unpacked: .* limit|is not a readable zip file"),
    "too many files": ("a.zip", packed(*((f"s/{k}.mcap", b"x") for k in range(201))), "201 files"),
    "up and out": ("a.zip", packed(("../../x.mcap", b"x")), "lies outside the folder"),
    "out, beside": (
        "a.zip",
        packed(("s/a.mcap", b"x"), ("s/../../y", b"x")),
        "outside the folder",
    ),
    "from the root": ("a.zip", packed(("/tmp/x.mcap", b"x")), "lies outside the folder"),
    "another system's": ("a.zip", packed(("c:/x.mcap", b"x")), "lies outside the folder"),
    "a link": ("a.zip", with_link(), "is a link or a device"),
    "a password": ("a.zip", locked(), "is protected by a password"),
    "odd name": ("a.zip", packed(("s/a b\n.mcap", b"x")), "letters, digits"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_dropped_may_be_refused_and_leaves_nothing(
    bench: Bench, browser: TestClient, kind: str
) -> None:
    name, content, why = REFUSED[kind]
    answer = browser.post(
        "/sessions",
        data={"key": bench.secrets.key, "robot": "srbd"},
        files={"files": (name, content)},
    )
    assert answer.status_code in (400, 413)
    assert re.search(why, answer.text), answer.text
    assert "Traceback" not in answer.text
    assert bench.cases.all() == ()
    assert list((bench.data / "cases").iterdir()) == []


@pytest.mark.parametrize(
    ("files", "there"),
    [
        ([("night.mcap", b"x")], {"night.mcap"}),
        ([("night_0.mcap", b"x"), ("metadata.yaml", b"y")], {"night_0.mcap", "metadata.yaml"}),
        (
            [
                (
                    "a.zip",
                    packed(
                        ("deep/night_0/night_0.mcap", b"x"),
                        ("deep/night_0/metadata.yaml", b"y"),
                        ("deep/notes.txt", b"z"),
                        ("__MACOSX/deep/night_0/._night_0.mcap", b"z"),
                    ),
                )
            ],
            {"night_0.mcap", "metadata.yaml"},
        ),
        ([("night_0.zip", packed(("data.mcap", b"x")))], {"data.mcap"}),
    ],
)
def test_what_is_taken_is_the_recording_alone(
    tmp_path: Path, files: list[tuple[str, bytes]], there: set[str]
) -> None:
    found = take_all([(io.BytesIO(content), name) for name, content in files], tmp_path, MOST)
    assert found == Dropped(BAG, Path(found.path).name, found.path)
    assert found.name in ("night", "night_0")
    assert {path.name for path in (tmp_path / found.path).iterdir()} == there
    assert {path.name for path in tmp_path.iterdir()} == {"bag"}


@pytest.mark.parametrize("name", ["commands.txt", "commands.csv", "check.log"])
def test_a_table_is_never_taken_for_a_file_of_the_bench(tmp_path: Path, name: str) -> None:
    taken = take_all([(io.BytesIO(b"1,2"), name)], tmp_path, MOST)
    assert (taken.path, taken.name) == (f"table/{name}", name.split(".")[0])


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"robot": "../../etc/passwd"}, "not a robot of the package"),
        ({}, "not a robot of the package"),
        ({"robot": "srbd", "machine": "a\nb"}, "one line"),
        ({"robot": "srbd", "machine": "x" * 300}, "one line"),
        ({"robot": "srbd", "preset": "no_such"}, "not known"),
        ({"robot": "srbd", "by": "--out"}, "does not offer"),
    ],
)
def test_fields_are_held_to_what_the_page_offers(
    bench: Bench, browser: TestClient, fields: dict[str, str], why: str
) -> None:
    answer = browser.post(
        "/sessions",
        data={"key": bench.secrets.key, **fields},
        files={"files": ("a.csv", b"a,b\n1,2\n")},
    )
    assert answer.status_code == 400
    assert why in answer.text
    assert bench.cases.all() == ()


def test_a_robot_file_that_is_none_is_refused(bench: Bench, browser: TestClient) -> None:
    files = [("files", ("a.mcap", b"x")), ("robot_file", ("r.yaml", b"a: [1, 2"))]
    answer = browser.post("/sessions", data={"key": bench.secrets.key}, files=files)
    assert answer.status_code == 400
    assert bench.cases.all() == ()


def test_a_body_is_bounded_whatever_it_announces(bench: Bench, browser: TestClient) -> None:
    announced = browser.post("/sessions", headers={"content-length": str(10**12)}, content=b"x")
    assert announced.status_code == 413

    def endless() -> Iterator[bytes]:
        for _ in range(100):
            yield bytes(1 << 20)

    kind = {"content-type": "multipart/form-data; boundary=b"}
    assert browser.post("/sessions", headers=kind, content=endless()).status_code == 413


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("night.mcap", "night.mcap"),
        ("../../etc/passwd", "passwd"),
        (r"C:\data\night shift.zip", "night_shift.zip"),
        (".bashrc", "bashrc"),
        ("-rf", "rf"),
        ("<b>ö</b>", "b"),
        ("..", "default"),
        ("x" * 300, "x" * 80),
    ],
)
def test_names_become_plain(given: str, name: str) -> None:
    assert file_name(given, "default") == name


def test_files_of_a_session_other_than_results_are_not_handed_out(
    bench: Bench, browser: TestClient
) -> None:
    id_ = bench.cases.new_id()
    bench.cases.add(case(id=id_, state=DONE))
    folder = bench.cases.folder(id_)
    (folder / "report.html").write_text("<script>1</script>")
    for name in ("case.json", "..%2f..%2ftoken", "%2e%2e/case.json", "verdict.json"):
        assert browser.get(f"/sessions/{id_}/files/{name}").status_code == 404
    taken = browser.get(f"/sessions/{id_}/files/report.html")
    assert taken.headers["content-disposition"].startswith("attachment")
    shown = browser.get(f"/sessions/{id_}/files/report.html?show=1")
    assert shown.headers["content-security-policy"].startswith("sandbox allow-scripts;")
    assert "allow-same-origin" not in shown.headers["content-security-policy"]


def test_names_are_shown_and_not_obeyed(bench: Bench, browser: TestClient) -> None:
    id_ = bench.cases.new_id()
    hostile = "<img src=x onerror=ask(1)>"
    bench.cases.add(case(id=id_, state=FAILED, machine=hostile, said=hostile))
    for path in ("/", f"/sessions/{id_}"):
        page = browser.get(path).text
        assert "<img" not in page
        assert "&lt;img" in page


# --- order of the verbs


@pytest.mark.parametrize("step", flow.STEPS)
def test_every_step_is_a_verb_that_takes_these_options(step: str) -> None:
    """Values that begin with a hyphen remain values."""
    form = "" if step == "columns" else "kuka"
    options = {"table": "t.csv", "targets": "targets.csv", "preset": form}
    given = case(machine="--store=x", options=options, topics=("states=/a",), forced=True)
    verb, *rest = arguments(given, step, "/data/history.sqlite")
    command = group.get_command(None, verb)
    if verb == "history":
        name, *rest = rest
        command = command.get_command(None, name)
    context = command.make_context(verb, rest)
    if verb == "history":
        assert context.params["machine"] == "--store=x"
        assert context.params["url"] == "/data/history.sqlite"


def walk(start: Case, folder: Path, codes: dict[str, int]) -> tuple[list[str], Case]:
    """Steps that are executed with these exit codes, up to a question or the end."""
    done, now = [], start
    while now.state == WORKING:
        now = begun(now)
        done.append(now.step)
        now = ended(now, Said(codes.get(now.step, 0), "", "why"), folder)
    return done, now


def test_a_sound_session_goes_through(tmp_path: Path) -> None:
    done, last = walk(case(machine="m", waiting=first_steps(BAG, "")), tmp_path, {})
    assert done == ["check", "fit", "diagnose", "keep"]
    assert (last.state, last.said) == (DONE, "")


def test_without_a_machine_nothing_is_kept(tmp_path: Path) -> None:
    done, last = walk(case(waiting=first_steps(BAG, "")), tmp_path, {})
    assert done == ["check", "fit", "diagnose"]
    assert "no machine was named" in last.said


def test_few_places_are_fitted_with_the_history_of_their_machine(tmp_path: Path) -> None:
    start = case(machine="m", waiting=first_steps(BAG, ""))
    done, last = walk(start, tmp_path, {"fit": 1})
    assert done == ["check", "fit", "update", "keep_update"]
    assert (last.state, last.said) == (DONE, "")
    done, last = walk(start, tmp_path, {"fit": 1, "update": 2})
    assert (done[-1], last.state) == ("update", FAILED)
    assert last.said == "why; with the history of m: why"
    done, last = walk(replace(start, forced=True), tmp_path, {"fit": 1})
    assert done == ["check", "fit", "update"]  # with a mistake: not kept
    done, last = walk(case(waiting=first_steps(BAG, "")), tmp_path, {"fit": 1})
    assert (done, last.state) == (["check", "fit"], FAILED)


def test_the_calibration_of_an_update_is_not_called_geometry_only(tmp_path: Path) -> None:
    (tmp_path / "calibration.yaml").write_text("")
    (tmp_path / "fit.out").write_text("")
    assert files(tmp_path) == [("calibration.yaml", "Calibration, geometry only")]
    (tmp_path / "update.out").write_text("carried over from 12 sessions: geometry and backlash")
    ((_, said),) = files(tmp_path)
    assert "the history" in said
    assert "geometry only" not in said


def test_a_mistake_is_asked_about_and_mended(tmp_path: Path) -> None:
    (tmp_path / "check-0.json").write_text("{}")
    done, asking = walk(case(waiting=first_steps(BAG, "")), tmp_path, {"check": 1})
    assert (done, asking.state, asking.question) == (["check"], ASKING, "mistakes")
    (tmp_path / "mended-1" / "night").mkdir(parents=True)
    (tmp_path / "mended-1" / "night_robot.yaml").write_text("")
    mended = ended(begun(answered(asking, "mend")), Said(1, "", ""), tmp_path)
    assert flow.again(mended) == mended  # a restarted server does not repair it twice
    done, last = walk(answered(asking, "mend"), tmp_path, {"mend": 1})
    assert done == ["mend", "check", "fit", "diagnose"]
    assert (last.session, last.robot) == ("mended-1/night", "mended-1/night_robot.yaml")


def test_what_cannot_be_mended_is_asked_about_again(tmp_path: Path) -> None:
    asking = case(state=ASKING, question="mistakes")
    _, again = walk(answered(asking, "mend"), tmp_path, {"mend": 1})
    assert (again.state, again.question, again.said) == (ASKING, "mistakes", "why")


def test_going_on_by_force_keeps_nothing(tmp_path: Path) -> None:
    forced = answered(case(state=ASKING, question="mistakes", machine="m"), "force")
    done, last = walk(forced, tmp_path, {})
    assert done == ["fit", "diagnose"]
    assert "in spite of a mistake" in last.said
    assert "--force" in arguments(last, "diagnose", "h.sqlite")


def test_a_check_that_cannot_be_made_is_no_question(tmp_path: Path) -> None:
    done, last = walk(case(waiting=first_steps(BAG, "")), tmp_path, {"check": 1})
    assert (done, last.state, last.said) == (["check"], FAILED, "why")


def test_a_table_is_asked_about_and_a_wrong_mapping_again(tmp_path: Path) -> None:
    (tmp_path / flow.MAPPING).write_text("")
    start = case(kind=TABLE, waiting=first_steps(TABLE, ""))
    done, asking = walk(start, tmp_path, {})
    assert (done, asking.question) == (["columns"], "columns")
    done, again = walk(answered(asking, "take"), tmp_path, {"import": 2})
    assert (done, again.question, again.said) == (["import"], "columns", "why")
    done, _ = walk(answered(again, "take"), tmp_path, {})
    assert done == ["import", "check", "fit", "diagnose"]


def test_a_question_is_answered_once() -> None:
    after = answered(case(state=ASKING, question="mistakes"), "stop")
    with pytest.raises(MistakeError, match="already been answered"):
        answered(after, "mend")
    with pytest.raises(InputError, match="is not one of the answers to this question"):
        answered(case(state=ASKING, question="columns"), "force")


def test_the_second_answer_of_two_browsers_is_told_so(bench: Bench, browser: TestClient) -> None:
    id_ = bench.cases.new_id()
    bench.cases.add(case(id=id_, state=ASKING, question="mistakes"))
    answers = [
        browser.post(f"/sessions/{id_}/answer", data={"key": bench.secrets.key, "answer": "stop"})
        for _ in range(2)
    ]
    assert [answer.status_code for answer in answers] == [303, 409]
    assert bench.cases.get(id_).state == "stopped"


def test_an_export_that_fails_takes_nothing_from_the_verdict(tmp_path: Path) -> None:
    wanted = flow.wanted(case(state=DONE), "certificate", {})
    _, last = walk(wanted, tmp_path, {"certificate": 1})
    assert (last.state, last.said) == (DONE, "why")
    with pytest.raises(MistakeError, match="is being processed"):
        flow.wanted(case(state=WORKING, step="fit"), "c", {})


def test_a_certificate_states_what_was_given(
    bench: Bench, browser: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    scripted(monkeypatch, "pass")
    id_ = bench.cases.new_id()
    bench.cases.add(case(id=id_, state=DONE))
    path = f"/sessions/{id_}/exports/certificate"
    fields = {"key": bench.secrets.key, "number": "7", "machine_serial": "SN 1"}
    assert browser.post(path, data={**fields, "ambient": "warm"}).status_code == 400
    assert not (bench.cases.folder(id_) / "about.yaml").exists()
    assert browser.post(path, data={**fields, "tolerance_mm": "0,05"}).status_code == 303
    about = read_about(bench.cases.folder(id_) / "about.yaml", {})
    assert about.text("machine", "serial") == "SN 1"
    assert (about.text("number"), about.tolerance) == ("7", 5e-5)
    until(lambda: bench.cases.get(id_).state == DONE)


def test_exports_wait_for_one_another() -> None:
    first = begun(flow.wanted(case(state=DONE), "certificate", {}))
    both = flow.wanted(flow.wanted(first, "c", {}), "c", {})
    assert (both.step, both.waiting) == ("certificate", ("c",))


# --- work


def until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def scripted(monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """Run a script in place of every verb; the verb is its argument."""
    monkeypatch.setattr(runner, "command", lambda verb: [sys.executable, "-c", script, *verb])


def test_work_is_done_in_order_and_its_commands_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scripted(monkeypatch, "import sys; print(sys.argv[1])")
    cases = Cases(tmp_path)
    id_ = cases.new_id()
    cases.add(case(id=id_, waiting=("check", "fit")))
    working = Runner(cases, str(tmp_path / "h.sqlite"))
    until(lambda: cases.get(id_).state == DONE)
    working.close()
    folder = cases.folder(id_)
    assert runner.commands(folder) == [
        "delta-cal check bag/night --robot=srbd --json=check-0.json",
        "delta-cal fit bag/night --robot=srbd --out=calibration.yaml",
    ]
    assert (folder / "fit.out").read_text() == "fit\n"


def test_what_a_server_left_unfinished_the_next_one_begins_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scripted(monkeypatch, "import time; time.sleep(60)")
    cases = Cases(tmp_path)
    id_ = cases.new_id()
    cases.add(case(id=id_, waiting=("check", "fit")))
    first = Runner(cases, str(tmp_path / "h.sqlite"))
    until(lambda: cases.get(id_).step == "check" and first._children)
    first.close()
    assert cases.get(id_).state == WORKING
    scripted(monkeypatch, "pass")
    second = Runner(cases, str(tmp_path / "h.sqlite"))
    until(lambda: cases.get(id_).state == DONE)
    second.close()
    assert len(runner.commands(cases.folder(id_))) == 3


def test_work_can_be_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scripted(monkeypatch, "import time; time.sleep(60)")
    cases = Cases(tmp_path)
    id_ = cases.new_id()
    cases.add(case(id=id_, waiting=("check", "fit")))
    working = Runner(cases, str(tmp_path / "h.sqlite"))
    until(lambda: working._children)
    working.stop(id_)
    until(lambda: not working._children)
    working.close()
    assert (cases.get(id_).state, cases.get(id_).waiting) == ("stopped", ())


def test_what_an_export_wrote_before_is_gone_where_it_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scripted(monkeypatch, "raise SystemExit(2)")
    cases = Cases(tmp_path)
    id_ = cases.new_id()
    cases.add(case(id=id_, waiting=("commands",), options={"targets": "targets.csv"}))
    for name in ("commands.csv", "machine.c"):
        (cases.folder(id_) / name).write_text("old")
    working = Runner(cases, str(tmp_path / "h.sqlite"))
    until(lambda: cases.get(id_).state == DONE)
    working.close()
    assert not (cases.folder(id_) / "commands.csv").exists()
    assert (cases.folder(id_) / "machine.c").exists()


def test_one_worker_a_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Requested again and again while it is being processed, with idle workers."""
    scripted(monkeypatch, "import time; time.sleep(0.1)")
    cases = Cases(tmp_path)
    id_ = cases.new_id()
    cases.add(case(id=id_, state=DONE))
    working = Runner(cases, str(tmp_path / "h.sqlite"), workers=3)
    for step in ("c", "urdf", "certificate", "c", "urdf", "certificate"):
        cases.change(id_, lambda now, step=step: flow.wanted(now, step, {}))
        working.take(id_)
        time.sleep(0.02)
    until(lambda: cases.get(id_).state == DONE)
    working.close()
    steps = [line.split()[-1] for line in runner.commands(cases.folder(id_))]
    assert sorted(set(steps)) == ["--out=certificate.pdf", "--out=machine.c", "--out=machine.urdf"]
    assert len(steps) < 7
    assert cases.get(id_).waiting == ()


def test_how_far_a_step_is_comes_from_its_verb(tmp_path: Path) -> None:
    (tmp_path / "diagnose.err").write_text(
        "step 1 of 4, geometry: after 0 s\nstep 2 of 4, causes: after 3 s\n"
    )
    assert runner.doing(tmp_path, "diagnose") == runner.Doing(2, 4, "causes")
    assert runner.doing(tmp_path, "fit") is None


def test_the_page_that_opens_the_browser_is_its_owners(tmp_path: Path) -> None:
    for link in (f"{HOME}/?token=1", f"{HOME}/?token=2"):
        path = write_door(tmp_path, link)
        assert link in path.read_text()
        assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_port_that_is_taken_is_told_with_what_to_do(tmp_path: Path) -> None:
    with socket.socket() as other, opened(tmp_path, MOST, watch=False) as bench:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(InputError, match=f"--port {port}: .*give another --port, or 0"):
            serve(bench, "127.0.0.1", port, (), lambda _: None)


def test_the_usual_port_is_not_that_of_foxglove() -> None:
    """A cell may run foxglove_bridge, on 8765, beside the bench."""
    verb = group.get_command(click.Context(group), "serve")
    assert next(p.default for p in verb.params if p.name == "port") != 8765


def test_one_server_a_folder(tmp_path: Path) -> None:
    with (
        opened(tmp_path, MOST, watch=False),
        pytest.raises(InputError, match="another"),
        opened(tmp_path, MOST, watch=False),
    ):
        pass


def test_words_made_of_the_token_differ() -> None:
    secrets = Secrets("token")
    assert len({secrets.token, secrets.cookie, secrets.key}) == 3
    assert Secrets("other").cookie != secrets.cookie
