"""The command that calls services, as a process, with a node that has services."""

from __future__ import annotations

import signal
import subprocess
import sys
from typing import Any

import pytest

pytest.importorskip("rclpy")
from std_srvs.srv import SetBool, Trigger

from delta_calibration.errors import InputError
from delta_calibration.ros.trigger import Call, parse
from ros_helpers import ROOT, Bench, bench_fixture, environment  # noqa: F401

pytestmark = pytest.mark.ros


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "delta_calibration.ros.trigger", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
        cwd=ROOT,
    )


@pytest.fixture
def asked(bench: Bench) -> list[Any]:
    """Requests that a node with three services has received."""
    requests: list[Any] = []
    node = bench.node("cell")

    def fit(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        requests.append("fit")
        response.success, response.message = True, "held out 9.0 um"
        return response

    def refuse(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        requests.append("refuse")
        response.message = "nothing was captured"
        return response

    def enable(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        requests.append(request.data)
        response.success, response.message = True, f"enabled: {request.data}"
        return response

    node.create_service(Trigger, "~/fit", fit)
    node.create_service(Trigger, "~/refuse", refuse)
    node.create_service(SetBool, "~/enable", enable)
    return requests


@pytest.mark.parametrize(
    ("arguments", "code", "said", "request_seen"),
    [
        (["/cell/fit"], 0, "held out 9.0 um\n", "fit"),
        (["/cell/refuse", "20"], 1, "nothing was captured\n", "refuse"),
        (["/cell/enable", "true", "20.0"], 0, "enabled: True\n", True),
        (["/cell/enable", "false"], 0, "enabled: False\n", False),
        (["fit", "20", "--ros-args", "-r", "fit:=/cell/fit"], 0, "held out 9.0 um\n", "fit"),
    ],
)
def test_the_answer_is_written_and_its_success_is_the_exit_code(
    bench: Bench,
    asked: list[Any],
    arguments: list[str],
    code: int,
    said: str,
    request_seen: object,
) -> None:
    caller = start(*arguments)
    assert bench.until(lambda: caller.poll() is not None)
    output, trouble = caller.communicate()
    assert (output, trouble, caller.returncode) == (said, "", code)
    assert asked == [request_seen]


def test_a_service_that_is_not_there_is_1() -> None:
    caller = start("/cell/nothing", "0.5")
    output, trouble = caller.communicate(timeout=60)
    assert (output, caller.returncode) == ("", 1)
    assert "/cell/nothing: no such service within 0.5 s" in trouble


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["/cell/enable"], 2, "/cell/enable: takes true or false; usage: "),
        (["/cell/fit", "true"], 2, "/cell/fit: does not take true or false; usage: "),
        (["/cell/fti", "8"], 1, "(there are /cell/enable, /cell/fit, /cell/refuse) within 8 s"),
    ],
)
def test_a_slip_in_the_call_is_answered_with_what_there_is(
    bench: Bench, asked: list[Any], arguments: list[str], code: int, said: str
) -> None:
    caller = start(*arguments)
    assert bench.until(lambda: caller.poll() is not None)
    output, trouble = caller.communicate()
    assert (output, caller.returncode, asked) == ("", code, [])
    assert said in trouble


def test_waiting_is_said(bench: Bench) -> None:
    caller = start("/cell/nothing", "4")
    assert bench.until(lambda: caller.poll() is not None)
    assert "waiting for /cell/nothing" in caller.communicate()[1]


def test_a_call_that_is_broken_off_has_failed(bench: Bench) -> None:
    caller = start("/cell/nothing", "30")
    names = bench.node("watcher").get_node_names
    assert bench.until(lambda: "trigger" in names())
    bench.spin_for(0.3)
    caller.send_signal(signal.SIGINT)
    output, trouble = caller.communicate(timeout=60)
    assert (output, trouble, caller.returncode) == ("", "", 1)


def test_help_says_how_it_is_called() -> None:
    said, error = start("--help").communicate(timeout=60)
    assert "python -m delta_calibration.ros.trigger SERVICE [true|false] [SECONDS]" in said
    assert error == ""


def test_wrong_use_is_one_line_and_2() -> None:
    caller = start("/cell/enable", "maybe")
    output, trouble = caller.communicate(timeout=60)
    assert (output, caller.returncode) == ("", 2)
    assert len(trouble.strip().splitlines()) == 1
    assert "'maybe' is neither true, false nor a time" in trouble


@pytest.mark.parametrize(
    ("arguments", "call"),
    [
        (["/a/fit"], Call("/a/fit", None, 60.0)),
        (["/a/fit", "2.5"], Call("/a/fit", None, 2.5)),
        (["/a/enable", "true"], Call("/a/enable", True, 60.0)),
        (["/a/enable", "false", "3"], Call("/a/enable", False, 3.0)),
    ],
)
def test_arguments_are_read_by_their_place(arguments: list[str], call: Call) -> None:
    assert parse(arguments) == call


@pytest.mark.parametrize(
    "arguments", [[], ["/a", "true", "x"], ["/a", "3", "4"], ["/a", "nan"], ["/a", "-1"]]
)
def test_other_arguments_are_refused(arguments: list[str]) -> None:
    with pytest.raises(InputError, match="usage: python -m delta_calibration"):
        parse(arguments)
