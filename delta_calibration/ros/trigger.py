"""Call a node's service once, a Trigger, or a SetBool where a value is given.

    python -m delta_calibration.ros.trigger SERVICE [true|false] [SECONDS]

Writes the message of the answer; 0 if the node says that it succeeded, 1 if not or if no answer
came, 2 for wrong use.
"""

from __future__ import annotations

import inspect
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from delta_calibration.errors import DataError, InputError
from delta_calibration.ros.runtime import FAILED, BaseNode, run
from delta_calibration.ros.watchdog import leave

NAME = "trigger"
USAGE = "usage: python -m delta_calibration.ros.trigger SERVICE [true|false] [SECONDS]"
SETTLE_S = 0.3  # [s]
PERIOD_S = 0.02  # [s]
PATIENCE_S = 60.0  # [s] for the service to appear and to answer
REMINDER_S = 20.0  # [s] of waiting after which it is said, or half the time that there is;
# nodes on a busy machine take several to start
# The type that a service must not have, by whether a Trigger is called.
OTHER = {True: "std_srvs/srv/SetBool", False: "std_srvs/srv/Trigger"}
FLAGS = {"true": True, "false": False}


@dataclass(frozen=True)
class Call:
    """Service call: a Trigger, or a SetBool if there is a flag."""

    service: str
    flag: bool | None
    seconds: float


class Caller(BaseNode):
    """Node that waits for a service, calls it once, and ends with the answer."""

    def __init__(self, call: Call, **kwargs: Any) -> None:
        super().__init__(NAME, **kwargs)
        self._call = call
        self._deadline = time.monotonic() + call.seconds
        self._answer: Future | None = None
        self._reminder = time.monotonic() + min(REMINDER_S, call.seconds / 2.0)
        self._seen: float | None = None  # when the service was first seen, by the steady clock
        kind = Trigger if call.flag is None else SetBool
        self._asked = self.create_client(kind, call.service)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(PERIOD_S, self._look, clock=steady)
        self.succeeded = False

    def _look(self) -> None:
        if self.finished.done():
            return
        if self._seen is None:
            self._look_for_it()
            if self.finished.done():
                return
        # The server may not know at once where to send its answer, which would be lost.
        settled = self._seen is not None and time.monotonic() - self._seen >= SETTLE_S
        if settled and self._answer is None:
            self._answer = self._asked.call_async(self._request())
        if self._answer is not None and self._answer.done():
            answer = self._answer.result()
            sys.stdout.write(f"{answer.message}\n")
            self.succeeded = bool(answer.success)
            self.finish()
        elif time.monotonic() > self._deadline:
            missing = "no answer" if self._answer else f"no such service{self._others()}"
            self.fail(
                DataError(f"{self._call.service}: {missing} within {self._call.seconds:g} s")
            )

    def _look_for_it(self) -> None:
        """Check whether the service is available; fail if it has the other type."""
        now = time.monotonic()
        if self._asked.service_is_ready():
            self._seen = now
            return
        name = self._asked.service_name
        if OTHER[self._call.flag is None] in self._served().get(name, ()):
            way = (
                "takes true or false" if self._call.flag is None else "does not take true or false"
            )
            self.fail(InputError(f"{name}: {way}; {USAGE}"))
        elif now >= self._reminder:
            self._reminder = math.inf
            self.get_logger().info(f"waiting for {name}")

    def _others(self) -> str:
        """List the services of the same node, to help to find a wrong name."""
        node = self._asked.service_name.rpartition("/")[0] + "/"
        there = sorted(
            name
            for name, types in self._served().items()
            if name.startswith(node) and not set(types).isdisjoint(OTHER.values())
        )
        return f" (there are {', '.join(there)})" if there else ""

    def _served(self) -> dict[str, list[str]]:
        """Types by service; without services that have only clients, which ROS lists as well."""
        listed = self.get_service_names_and_types()
        return {name: types for name, types in listed if self.count_services(name)}

    def _request(self) -> Any:
        flag = self._call.flag
        return Trigger.Request() if flag is None else SetBool.Request(data=flag)


def parse(arguments: Sequence[str]) -> Call:
    """Parse a command line, without the program's name, to a call.

    Raises:
        InputError: no service, or an argument that is neither a flag nor a time.
    """
    rest = list(arguments)
    if not rest:
        raise InputError(f"no service named; {USAGE}")
    service = rest.pop(0)
    flag = FLAGS[rest.pop(0)] if rest and rest[0] in FLAGS else None
    seconds = _seconds(rest.pop(0)) if rest else PATIENCE_S
    if rest:
        raise InputError(f"argument {rest[0]!r} is one too many; {USAGE}")
    return Call(service, flag, seconds)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise InputError(f"argument {text!r} is neither true, false nor a time; {USAGE}")
    return value


def main(arguments: Sequence[str] | None = None) -> int:
    """Call, and return the exit code; a call that was broken off has failed."""
    program, *others = sys.argv if arguments is None else arguments
    if others[:1] in (["--help"], ["-h"]):
        sys.stdout.write(f"{inspect.cleandoc(__doc__ or '')}\n")
        return 0
    own = others.index("--ros-args") if "--ros-args" in others else len(others)
    callers: list[Caller] = []

    def build() -> Caller:
        callers.append(Caller(parse(others[:own])))
        return callers[0]

    code = run(build, NAME, [program, *others[own:]])
    return code if code or (callers and callers[0].succeeded) else FAILED


if __name__ == "__main__":
    leave(main())
