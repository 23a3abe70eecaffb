"""Common part of every node's `main()`: start, spin, stop, exit code.

Signals only set a flag, which is checked between the slices of the spin: no callback is
interrupted, and a node closes its files and deactivates while the context is still valid. A signal
before the spin ends the start at once. A process that then hangs, or gets another signal, is ended
by a watchdog (`watchdog.py`).
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any

import rclpy
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import ok, remove_ros_args, try_shutdown

from delta_calibration.errors import CalibrationError, InputError
from delta_calibration.ros.parameters import ParameterTable
from delta_calibration.ros.peers import SERVICES, ShutToPeers
from delta_calibration.ros.watchdog import LIMIT_S, STOP_SIGNALS, Watchdog

SLICE_S = 0.1  # [s] without a timeout the events executor neither rests nor sees signals
FAILED = 1


class Finishing:
    """Mixin for a node that may end by itself, with its own exit code.

    `stop_limit_s` [s] is the time in which it has to end after a signal.
    """

    stop_limit_s = LIMIT_S

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.finished = Future()

    def finish(self, exit_code: int = 0) -> None:
        """End the process within one slice of the spin; the first call sets the exit code."""
        if not self.finished.done():
            self.finished.set_result(exit_code)

    def fail(self, error: CalibrationError) -> None:
        """Log the error in one line, and end with its exit code."""
        self.get_logger().fatal(str(error))  # type: ignore[attr-defined]
        self.finish(error.exit_code)

    def start(self) -> None:
        """Hook that is called once, after the node is built and before it spins."""

    def close(self) -> None:
        """Hook called once, before the node is destroyed and while it can still publish."""


class BaseNode(Finishing, ShutToPeers, Node):
    """Plain node that `run` knows how to start and end."""

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.serves = ParameterTable(self, (SERVICES,)).flag(SERVICES.name)


class Interrupted(BaseException):
    """Exception raised by a signal before the spin.

    Not KeyboardInterrupt: once that has passed through an `eval`, Python ends by the signal even
    though it was caught.
    """


class StopSignals:
    """Handler of SIGINT and SIGTERM: raises `Interrupted` before the spin, sets a flag during it.

    Args:
        name: name of the node, for messages of the watchdog.
        to_the_end: whether the process ends after this; its end is then watched as well.
    """

    def __init__(self, name: str, to_the_end: bool) -> None:
        self.spinning = False
        self.requested = False
        self._name, self._to_the_end = name, to_the_end
        self._watchdog: Watchdog | None = None
        self._previous: dict[signal.Signals, Any] = {}

    def __enter__(self) -> StopSignals:
        if threading.current_thread() is threading.main_thread():  # handlers can only be set there
            self._watchdog = Watchdog(self._name, self._to_the_end)
            for number in STOP_SIGNALS:
                self._previous[number] = signal.signal(number, self._receive)
        return self

    def __exit__(self, *_: object) -> None:
        if self._watchdog is None or not self._watchdog.close():
            return  # the handlers stay with the watchdog: without one, no signal would reach it
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def allow(self, limit_s: float) -> None:
        """Set the time [s] in which the process has to end after a future signal."""
        if self._watchdog is not None:
            self._watchdog.limit_s = limit_s

    def _receive(self, _number: int, _frame: FrameType | None) -> None:
        first, self.requested = not self.requested, True
        if first and not self.spinning:
            raise Interrupted


def make_executor() -> Executor:
    """Events executor, the fastest at 1 kHz; the single-threaded one if rclpy has none."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def spin(executor: Executor, finished: Future, stop: StopSignals | None = None) -> int:
    """Spin in slices until the future is done, a signal asks to stop, or the context ends.

    Returns:
        The future's result if it is done, else 0.
    """
    while ok() and not finished.done() and not (stop is not None and stop.requested):
        # A new future for each slice: the executor adds a callback to it and never removes it.
        executor.spin_until_future_complete(Future(), SLICE_S)
    return int(finished.result()) if finished.done() else 0


def run(build: Callable[[], Any], name: str, arguments: Sequence[str] | None = None) -> int:
    """Build a node, spin it until it ends or is asked to stop, and clean up.

    Args:
        build: function that makes the node (a `Finishing`), called after rclpy is initialised.
        name: name of the node for messages before it exists.
        arguments: command line with the program's name first; `sys.argv` by default.

    Returns:
        0 done or stopped by a signal; `exit_code` of a CalibrationError; 1 for any other failure.
        Does not return if the process does not end in time or gets a second signal.
    """
    argv = list(sys.argv if arguments is None else arguments)
    with StopSignals(name, to_the_end=arguments is None) as stop:
        try:
            return _run(build, argv, stop)
        except (Interrupted, KeyboardInterrupt, ExternalShutdownException):
            return 0
        except CalibrationError as error:
            get_logger(name).fatal(_one_line(error))
            return error.exit_code
        except OSError as error:  # a full disk, a folder without permission
            get_logger(name).fatal(_one_line(error))
            return FAILED
        finally:
            try_shutdown()


def _run(build: Callable[[], Any], argv: list[str], stop: StopSignals) -> int:
    _initialise(argv)
    executor = make_executor()
    node = build()
    try:
        stop.allow(node.stop_limit_s)
        node.shut_to_peers()
        executor.add_node(node)
        node.start()
        stop.spinning = True
        if stop.requested:
            return 0
        return spin(executor, node.finished, stop)
    finally:
        _take_down(executor, node)


def _take_down(executor: Executor, node: Any) -> None:
    """Close the node while its context is valid; everything is released even if that fails."""
    try:
        node.close()
    finally:
        executor.remove_node(node)
        node.destroy_node()
        executor.shutdown()


def _initialise(argv: list[str]) -> None:
    """Initialise rclpy after a check of all arguments.

    Raises:
        InputError: an unknown argument, or an invalid ROS argument.
    """
    wrong = (
        rclpy_implementation.RCLInvalidROSArgsError,
        rclpy_implementation.UnknownROSArgsError,
    )
    try:
        others = remove_ros_args(argv)[1:]
        if others:
            raise InputError(
                f"unknown argument {others[0]!r}: parameters follow --ros-args, "
                "as -p name:=value; see --help"
            )
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
    except wrong as error:
        raise InputError(f"ROS arguments: {_one_line(error)}") from error


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())
