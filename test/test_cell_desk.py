"""Capture, fit, save, reload, switch on, without ROS; failures leave everything unchanged."""

from __future__ import annotations

import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.cell import archive
from delta_calibration.cell.background import Background
from delta_calibration.cell.calibration_session import CalibrationSession, Settings
from delta_calibration.cell.health import Level
from delta_calibration.data import Session
from delta_calibration.errors import CalibrationError, ConfigError, DataError, InputError
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import days_later, draw_machine, simulate_session, visited

FAST = "rotary_delta"
TIMEOUT_S = 2.0


@pytest.fixture(scope="module")
def session() -> Session:
    robot = load_robot("srbd")
    plan = make_plan("identify", robot, count=20, dwell=0.4)
    return simulate_session(draw_machine(robot, 3), plan, 3)


def feed(desk: CalibrationSession, session: Session, stop: int | None = None) -> None:
    """Capture a session's messages as a node does."""
    desk.start_capture(0.0)
    for k in range(len(session.states.stamp_ns[:stop])):
        stamp = int(session.states.stamp_ns[k])
        desk.capture.add_command(stamp, session.command.position[k])
        desk.capture.add_states(stamp, session.states.position[k])
        desk.capture.add_tracker(stamp, session.tracker.position[k])
    desk.stop_capture()


@pytest.fixture(scope="module")
def fitted(session: Session) -> CalibrationSession:
    desk = CalibrationSession(Settings("srbd", model=FAST))
    feed(desk, session)
    desk.take(*desk.prepare_fit()())
    return desk


@pytest.fixture
def file(fitted: CalibrationSession, tmp_path: Path) -> Path:
    path = tmp_path / "calibration.yaml"
    fitted.save(str(path))
    return path


@pytest.mark.parametrize(
    ("name", "usual", "unit"),
    [
        ("srbd", 5.0, "rad"),
        ("five_axis", 1.5, "m"),
        ("linear_delta", 1.5, "m"),
        ("cdpr8", 300.0, "rad"),
        ("ur10", 5.0, "rad"),
    ],
)
def test_the_rate_of_corrections_is_of_the_joints_own_unit(
    name: str, usual: float, unit: str
) -> None:
    """5 m/s of a slider would limit nothing, 5 rad/s of a drum would limit normal corrections."""
    desk = CalibrationSession(Settings(name))
    assert desk.path.ramp.rate == pytest.approx(usual)
    desk.set_options("pass_through", 1.0, 0.25, 0.0, "refuse")
    assert desk.path.ramp.rate == 0.25
    desk.set_options("pass_through", 1.0, 0.0, 0.0, "refuse")
    assert desk.path.ramp.rate == pytest.approx(usual)
    with pytest.raises(InputError, match=rf"max_correction_rate is -1.0 {unit}/s; it has"):
        desk.set_options("pass_through", 1.0, -1.0, 0.0, "refuse")
    assert f"correction [{unit}]" in desk.health(0.0, TIMEOUT_S).values
    # A correction that moves the platform by the same distance takes the same time for any
    # mechanism.
    model = desk.robot.commanded
    slope = model.velocity_jacobian(
        model.home[None],
        model.forward(model.home[None], model.parameters.nominal),
        model.parameters.nominal,
    )[0, :3]
    fastest = np.linalg.norm(slope, axis=0).max() * usual  # [m/s]
    assert 0.5 < fastest < 10.0


def test_a_fit_says_its_result_and_is_loaded_but_not_enabled(session: Session) -> None:
    desk = CalibrationSession(Settings("srbd", model=FAST))
    with pytest.raises(DataError, match="no calibration"):
        desk.enable(True)
    feed(desk, session)
    sentence = desk.take(*desk.prepare_fit()())
    found = desk.fitted.found
    assert "rank 24 of 33" in sentence
    assert f"error left {found.frame_only.held_out * 1e3:.4f} mm before" in sentence
    assert f"{found.full.held_out * 1e3:.4f} mm calibrated" in sentence
    assert f"noise of a pose: {found.noise.floor * 1e3:.4f} mm" in sentence
    assert "loaded, not enabled" in sentence
    assert not desk.path.enabled
    assert "over 1 s" in desk.enable(True)
    again = desk.take(*desk.prepare_fit()())
    assert "compensation is on and changes over to it in 1 s" in again
    assert desk.path.enabled


def test_a_fit_without_data_or_with_too_little_keeps_what_was(
    fitted: CalibrationSession, session: Session
) -> None:
    with pytest.raises(DataError, match="nothing was captured"):
        CalibrationSession(Settings("srbd")).prepare_fit()
    before = fitted.calibration
    for stop, reason in ((60, "poses at rest|stands still"), (0, "nothing was captured")):
        feed(fitted, session, stop)
        with pytest.raises(DataError, match=reason):
            fitted.prepare_fit()()
    fitted.start_capture(0.0)
    fitted.capture.add_states(0, np.zeros(3))
    fitted.stop_capture()
    with pytest.raises(CalibrationError, match="no tracker readings"):
        fitted.prepare_fit()()
    assert fitted.calibration is before


def test_a_saved_calibration_is_the_one_that_is_loaded_again(
    fitted: CalibrationSession, file: Path
) -> None:
    other = CalibrationSession(Settings("srbd", calibration=str(file)))
    np.testing.assert_allclose(other.calibration.theta, fitted.calibration.theta, rtol=1e-12)
    other.enable(True)
    q = make_plan("line", other.robot, count=5).joint[2]
    other.path.set_options("pass_through", 0.0)
    sent = other.path.send(q, 0, 0.0)
    expected = fitted._compensator(fitted.calibration).compensate(q[None]).joint[0]
    np.testing.assert_allclose(sent.joint, expected, atol=1e-9)
    assert np.abs(sent.joint - q).max() > 1e-5


@pytest.mark.parametrize("harm", ["cut", "half", "empty", "gone", "changed", "binary"])
def test_a_file_that_is_no_good_leaves_the_one_in_force(
    fitted: CalibrationSession, file: Path, tmp_path: Path, harm: str
) -> None:
    desk = CalibrationSession(Settings("srbd", calibration=str(file)))
    desk.enable(True)
    before = desk.calibration
    bad, content = tmp_path / "bad.yaml", file.read_bytes()
    spoiled = {
        "cut": content[:-20],
        "half": content[: len(content) // 2],
        "empty": b"",
        "changed": content.replace(b"value: ", b"value: 1", 1),
        "binary": bytes(range(256)),
    }
    if harm in spoiled:
        assert spoiled[harm] != content
        bad.write_bytes(spoiled[harm])
    with pytest.raises(ConfigError, match=r"bad\.yaml"):
        desk.reload(str(bad))
    assert desk.calibration is before
    assert desk.path.enabled
    with pytest.raises(ConfigError, match=r"bad\.yaml"):
        CalibrationSession(Settings("srbd", calibration=str(bad)))


def test_a_table_is_made_when_a_calibration_is_loaded_and_compensates(
    fitted: CalibrationSession, file: Path
) -> None:
    """It is ready at the first command: nothing remains to be made, compiled or loaded."""
    desk = CalibrationSession(Settings("srbd", calibration=str(file), method="table", ramp_s=0.0))
    desk.enable(True)
    assert "compensating by table (" in desk.health(0.0, TIMEOUT_S).message
    assert "um off at" in desk.health(0.0, TIMEOUT_S).message
    newton = CalibrationSession(Settings("srbd", calibration=str(file), ramp_s=0.0))
    newton.enable(True)
    assert newton.health(0.0, TIMEOUT_S).message == "compensating by newton"
    for k, q in enumerate(make_plan("disc", desk.robot, count=9, radius=0.15).joint):
        sent, exact = (d.send(q, k, 0.01 * k, False) for d in (desk, newton))
        np.testing.assert_allclose(sent.joint, exact.joint, atol=3e-6)
        assert np.abs(sent.joint - q).max() > 1e-5


def test_orders_out_of_turn_are_refused_with_the_reason(
    fitted: CalibrationSession, tmp_path: Path
) -> None:
    desk = CalibrationSession(Settings("srbd"))
    with pytest.raises(DataError, match="nothing is being captured"):
        desk.stop_capture()
    desk.start_capture(0.0)
    with pytest.raises(DataError, match="capturing already"):
        desk.start_capture(0.0)
    with pytest.raises(DataError, match="nothing was fitted"):
        desk.save(str(tmp_path / "c.yaml"))
    with pytest.raises(InputError, match="output: is empty"):
        fitted.save("")
    with pytest.raises(ConfigError, match="cannot be written"):
        fitted.save(str(tmp_path / "no" / "such" / "c.yaml"))
    with pytest.raises(InputError, match="calibration: is empty"):
        desk.reload("")
    with pytest.raises(ConfigError, match="mechanism"):
        CalibrationSession(Settings("srbd", model="tripod"))


def test_health_tells_a_silent_tracker_in_a_capture_only() -> None:
    desk = CalibrationSession(Settings("srbd"))
    assert desk.health(100.0, TIMEOUT_S).level is Level.OK
    desk.start_capture(100.0)
    for now_s in (100.5, 101.0, 103.0):
        desk.watch.heard("joint_states", now_s)
    desk.watch.heard("tracker", 100.5)
    assert desk.health(102.0, TIMEOUT_S).level is Level.OK
    late = desk.health(103.0, TIMEOUT_S)
    assert late.level is Level.WARN
    assert "tracker silent for 2.5 s" in late.message
    assert "joint_states" not in late.message
    desk.stop_capture()
    assert desk.health(200.0, TIMEOUT_S).level is Level.OK


def test_health_tells_a_trouble_for_a_while_and_counts_it_for_ever() -> None:
    desk = CalibrationSession(Settings("srbd"))
    desk.watch.refuse("joint_states", "3 names, 2 positions", 10.0)
    now = desk.health(11.0, TIMEOUT_S)
    assert now.level is Level.WARN
    assert "joint_states: 3 names, 2 positions" in now.message
    later = desk.health(30.0, TIMEOUT_S)
    assert later.level is Level.OK
    assert later.values["joint_states refused"] == 1


def test_health_tells_what_a_full_capture_lost() -> None:
    desk = CalibrationSession(Settings("srbd", capture_limit=3))
    desk.start_capture(0.0)
    for k in range(5):
        desk.capture.add_states(k, np.zeros(3))
    health = desk.health(0.1, TIMEOUT_S)
    assert health.level is Level.WARN
    assert "2 messages were lost" in health.message
    assert "2 messages were lost" in desk.stop_capture()


def test_health_tells_commands_that_take_longer_than_their_period() -> None:
    desk, period_ns = CalibrationSession(Settings("srbd")), 20_000_000
    for k, took_s in enumerate((0.5, 0.015, 0.019, 0.015)):  # the first one has no period yet
        desk.watch.took(took_s, k * period_ns, 1.0)
    assert desk.health(1.0, TIMEOUT_S).level is Level.OK
    desk.watch.took(0.034, 4 * period_ns, 1.0)
    health = desk.health(1.0, TIMEOUT_S)
    assert health.level is Level.WARN
    assert "took 34 ms, commands come every 20 ms" in health.message
    assert health.values["command took longer than its period"] == 1
    for stamp_ns in (3 * period_ns, 10**12):  # time going back, a pause: no period either
        desk.watch.took(0.034, stamp_ns, 1.0)
    assert desk.watch.late == 1


def test_background_work_gives_its_result_or_raises_its_error_where_it_is_fetched() -> None:
    gate = threading.Event()
    job = Background(lambda: gate.wait(10.0))
    assert not job.done
    gate.set()
    assert job.result() is True
    assert job.done
    failing: Background[float] = Background(lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        failing.result()


def test_a_fit_is_added_to_the_history_of_its_machine(session: Session, tmp_path: Path) -> None:
    pytest.importorskip("sqlalchemy")
    from delta_calibration.history.store import BY_NODE, open_store

    store, bags = str(tmp_path / "h.sqlite"), tmp_path / "bags"
    asked = Settings("srbd", model=FAST, history=store, machine="m", bags=str(bags))
    desk = CalibrationSession(asked)
    feed(desk, session)
    assert "added to the history of m as 2023" in desk.take(*desk.prepare_fit()())
    with open_store(store) as opened:
        (entry,) = opened.sessions("m")
    assert (entry.added_by, entry.verdict) == (BY_NODE, None)
    entry.require_unchanged()
    assert Path(entry.path).parent == bags / "m"
    said = desk.take(*desk.prepare_fit()())  # a fit that is not added is still a fit
    assert "not added to the history of m: " in said
    assert "already" in said
    assert desk.calibration is not None


@pytest.fixture(scope="module")
def kept_in(session: Session, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Settings of a history that contains the session of a first day."""
    pytest.importorskip("sqlalchemy")
    folder = tmp_path_factory.mktemp("history")
    asked = {"history": str(folder / "h.sqlite"), "machine": "m", "bags": str(folder / "bags")}
    desk = CalibrationSession(Settings("srbd", model=FAST, **asked))
    feed(desk, session)
    desk.take(*desk.prepare_fit()())
    return asked


def next_day(count: int, day: int) -> Session:
    """The machine of the first session, with tracker and reflector set up again."""
    robot = load_robot("srbd")
    plan = make_plan("identify", robot, count=count, dwell=0.4)
    machine = visited(draw_machine(robot, 3), robot, 3, day)
    return days_later(simulate_session(machine, plan, 3 + day), day)


def test_few_places_are_fitted_with_what_the_history_says(kept_in: dict[str, str]) -> None:
    few = next_day(6, 1)
    alone = CalibrationSession(Settings("srbd", model=FAST))
    feed(alone, few)
    with pytest.raises(DataError, match="6"):
        alone.prepare_fit()()
    desk = CalibrationSession(Settings("srbd", model=FAST, **kept_in))
    feed(desk, few)
    said = desk.take(*desk.prepare_fit()())
    assert "carried over from 1 session (20231114_221320" in said
    assert "shows no change since then" in said
    assert "added to the history of m as 20231115" in said
    fresh = CalibrationSession(Settings("srbd", model=FAST, **{**kept_in, "machine": "other"}))
    feed(fresh, few)
    with pytest.raises(InputError, match="no machine 'other'"):
        fresh.prepare_fit()()


def test_a_whole_session_is_fitted_with_the_history_where_told_to(
    kept_in: dict[str, str], tmp_path: Path
) -> None:
    whole = next_day(20, 2)
    for update in (False, True):
        desk = CalibrationSession(Settings("srbd", model=FAST, update=update, **kept_in))
        feed(desk, whole)
        said = desk.take(*desk.prepare_fit()())
        assert ("carried over from" in said) is update
    first = {**kept_in, "history": str(tmp_path / "none.sqlite")}
    desk = CalibrationSession(Settings("srbd", model=FAST, update=True, **first))
    feed(desk, whole)
    said = desk.take(*desk.prepare_fit()())
    assert "fitted without the history of m: " in said
    assert "added to the history of m as 20231116" in said
    with pytest.raises(InputError, match="parameter history_update: needs the parameter history"):
        CalibrationSession(Settings("srbd", update=True))


def test_a_session_that_contradicts_its_history_is_doubted(
    kept_in: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = archive.prospect
    monkeypatch.setattr(archive, "prospect", lambda *given: replace(expected(*given), odd=7.0))
    desk = CalibrationSession(Settings("srbd", model=FAST, update=True, **kept_in))
    feed(desk, next_day(20, 3))
    assert "warning: the session contradicts its history (7.0 times" in desk.take(
        *desk.prepare_fit()()
    )
    assert "contradicts its history" in desk.health(0.0, TIMEOUT_S).message


def test_a_history_that_cannot_be_kept_is_refused_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = str(tmp_path / "h.sqlite")
    with pytest.raises(InputError, match="parameter machine: is empty"):
        CalibrationSession(Settings("srbd", history=store, bags="bags"))
    with pytest.raises(InputError, match="parameter history_bags: is empty"):
        CalibrationSession(Settings("srbd", history=store, machine="m"))
    monkeypatch.setitem(sys.modules, "sqlalchemy", None)
    monkeypatch.delitem(sys.modules, "delta_calibration.history.store", raising=False)
    with pytest.raises(InputError, match="parameter history: a history needs SQLAlchemy: pip"):
        CalibrationSession(Settings("srbd", history=store, machine="m", bags="bags"))
