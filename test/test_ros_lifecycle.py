"""A lifecycle node survives requests that its state does not allow, and failing transitions."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("rclpy")
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_msgs.msg import Float64

from delta_calibration.errors import InputError
from delta_calibration.ros.lifecycle import SafeLifecycleNode
from ros_helpers import Bench, bench_fixture  # noqa: F401

pytestmark = pytest.mark.ros


class Cell(SafeLifecycleNode):
    """Records the hooks that were called, and fails where this is requested."""

    def __init__(self, bench: Bench, **kwargs: object) -> None:
        super().__init__("cell", context=bench.context, **kwargs)
        self.called: list[str] = []
        self.failing: dict[str, Exception] = {}
        self.out = self.create_lifecycle_publisher(Float64, "out", 10)

    def _hook(self, name: str) -> None:
        self.called.append(name)
        if name in self.failing:
            raise self.failing[name]

    def configure(self) -> None:
        self._hook("configure")

    def activate(self) -> None:
        self._hook("activate")

    def deactivate(self) -> None:
        self._hook("deactivate")

    def cleanup(self) -> None:
        self._hook("cleanup")


Ask = Callable[[int], bool]


@pytest.fixture
def cell(bench: Bench) -> Cell:
    return bench.add(Cell(bench))


@pytest.fixture
def ask(bench: Bench, cell: Cell) -> Ask:
    """Request a transition by the service, as a lifecycle manager does; return the answer."""
    client = bench.node("manager").create_client(ChangeState, "/cell/change_state")
    assert bench.until(client.service_is_ready)

    def send(transition: int, label: str = "") -> bool:
        request = ChangeState.Request(transition=Transition(id=transition, label=label))
        answer = client.call_async(request)
        assert bench.until(answer.done)
        return bool(answer.result().success)

    return send


def test_the_usual_way_round(cell: Cell, ask: Ask) -> None:
    for transition, state in (
        (Transition.TRANSITION_CONFIGURE, "inactive"),
        (Transition.TRANSITION_ACTIVATE, "active"),
        (Transition.TRANSITION_DEACTIVATE, "inactive"),
        (Transition.TRANSITION_CLEANUP, "unconfigured"),
    ):
        assert ask(transition)
        assert cell.state == state
    assert cell.called == ["configure", "activate", "deactivate", "cleanup"]


def test_requests_out_of_state_are_answered_false_and_the_node_lives(
    bench: Bench, cell: Cell, ask: Ask
) -> None:
    for transition in (
        Transition.TRANSITION_ACTIVATE,
        Transition.TRANSITION_DEACTIVATE,
        Transition.TRANSITION_CLEANUP,
        Transition.TRANSITION_ACTIVE_SHUTDOWN,
        Transition.TRANSITION_ON_CONFIGURE_SUCCESS,
        99,
        255,
    ):
        assert not ask(transition)
        assert cell.state == "unconfigured"
    assert not ask(0, "no_such_label")
    assert ask(Transition.TRANSITION_CONFIGURE)
    assert not ask(Transition.TRANSITION_CONFIGURE)
    client = bench.node("watcher").create_client(GetState, "/cell/get_state")
    assert bench.until(client.service_is_ready)
    answer = client.call_async(GetState.Request())
    assert bench.until(answer.done)
    assert answer.result().current_state.id == State.PRIMARY_STATE_INACTIVE


def test_a_refusal_keeps_the_state_and_is_one_line(
    cell: Cell, ask: Ask, capfd: pytest.CaptureFixture[str]
) -> None:
    cell.failing["configure"] = InputError("calibration.yaml: robot hash differs")
    assert not ask(Transition.TRANSITION_CONFIGURE)
    assert cell.state == "unconfigured"
    said = capfd.readouterr().err
    assert "configure: calibration.yaml: robot hash differs" in said
    assert "Traceback" not in said
    cell.failing.clear()
    assert ask(Transition.TRANSITION_CONFIGURE)
    cell.failing["activate"] = InputError("no tracker")
    assert not ask(Transition.TRANSITION_ACTIVATE)
    assert cell.state == "inactive"
    assert not cell.out.is_activated


def test_a_bug_in_a_hook_is_logged_and_everything_released(
    cell: Cell, ask: Ask, capfd: pytest.CaptureFixture[str]
) -> None:
    assert ask(Transition.TRANSITION_CONFIGURE)
    assert ask(Transition.TRANSITION_ACTIVATE)
    cell.failing["deactivate"] = ZeroDivisionError("a bug")
    assert not ask(Transition.TRANSITION_DEACTIVATE)
    assert cell.state == "unconfigured"
    assert not cell.out.is_activated
    assert cell.called[-1] == "cleanup"
    said = capfd.readouterr().err
    assert "Traceback" in said
    assert "ZeroDivisionError: a bug" in said
    assert ask(Transition.TRANSITION_CONFIGURE)


def test_a_bug_in_the_release_too_leaves_a_finalized_node_that_still_answers(
    cell: Cell, ask: Ask
) -> None:
    cell.failing = {"configure": ValueError("a bug"), "cleanup": ValueError("another")}
    assert not ask(Transition.TRANSITION_CONFIGURE)
    assert cell.state == "finalized"
    assert not ask(Transition.TRANSITION_CONFIGURE)


def test_shutdown_deactivates_and_releases_from_every_state(cell: Cell, ask: Ask) -> None:
    assert ask(Transition.TRANSITION_CONFIGURE)
    assert ask(Transition.TRANSITION_ACTIVATE)
    cell.failing["deactivate"] = InputError("does not want to")
    assert ask(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert cell.state == "finalized"
    assert cell.called[-2:] == ["deactivate", "cleanup"]
    cell.close()  # again, as at the end of the process
    assert cell.called[-2:] == ["deactivate", "cleanup"]


@pytest.mark.parametrize(("autostart", "state"), [(True, "active"), (False, "unconfigured")])
def test_autostart(
    bench: Bench, autostart: bool, state: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """A node that waits for a manager says so, in case the parameter was forgotten."""
    given = [Parameter("autostart", value=autostart)]
    cell = bench.add(Cell(bench, parameter_overrides=given))
    cell.start()
    assert ("waiting for a lifecycle manager" in capfd.readouterr().err) is not autostart
    assert cell.state == state
    cell.close()
    assert cell.state == "finalized"


def test_autostart_that_is_refused_leaves_the_node_up(bench: Bench) -> None:
    given = [Parameter("autostart", value=True)]
    cell = bench.add(Cell(bench, parameter_overrides=given))
    cell.failing["configure"] = InputError("no file yet")
    cell.start()
    assert cell.state == "unconfigured"
    cell.failing.clear()
    assert cell.trigger_configure() == TransitionCallbackReturn.SUCCESS
