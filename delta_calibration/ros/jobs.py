"""Services whose work runs on another thread than the commands; the answer follows at its end."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from std_srvs.srv import Trigger

from delta_calibration.cell.background import Background
from delta_calibration.errors import CalibrationError, DataError, RefusedFileError
from delta_calibration.ros.deferred import Deferred, allow_deferred

POLL_S = 0.05  # [s] until the end of a job is noticed

Finish = Callable[[], str]
Work = Callable[[], Finish]


@dataclass(frozen=True)
class _Job:
    background: Background[Finish]
    waiting: Deferred


class Jobs:
    """Runs the jobs of a node's Trigger services, at most one of a kind at a time.

    The work is prepared on the node's thread and done on another one. It returns a function, which
    is called on the node's thread again: it applies the result and returns the answer's sentence.

    Args:
        node: node that offers the services.
        tell: callback that gets the kind of a failed job and the reason.
        changed: callback at the start and at the end of each job.
    """

    def __init__(
        self, node: Node, tell: Callable[[str, str], None], changed: Callable[[], None]
    ) -> None:
        self._node, self._tell, self._changed = node, tell, changed
        self._running: dict[str, _Job] = {}
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._poll = node.create_timer(POLL_S, self._finish, clock=steady)
        self._poll.cancel()

    def serve(self, name: str, kind: str, prepare: Callable[[], Work]) -> None:
        """Offer a service; `prepare` and the work may raise a CalibrationError to refuse."""

        def receive(_request: Any, response: Any) -> Any:
            try:
                if kind in self._running:
                    raise DataError(f"a {kind} is running already")
                job = _Job(Background(prepare()), Deferred())
            except CalibrationError as error:
                response.message, response.success = str(error), False
                return self._logged(response)
            self._running[kind] = job
            self._poll.reset()
            self._changed()
            return job.waiting

        allow_deferred(self._node.create_service(Trigger, f"~/{name}", receive))

    @property
    def running(self) -> tuple[str, ...]:
        """Kinds of the running jobs."""
        return tuple(self._running)

    def drop(self, why: str) -> None:
        """Abandon all jobs, and answer their callers with the reason."""
        self._poll.cancel()
        while self._running:
            kind, job = self._running.popitem()
            job.waiting.answer(Trigger.Response(success=False, message=f"{why} during the {kind}"))

    def _finish(self) -> None:
        for kind, job in list(self._running.items()):
            if job.background.done:
                del self._running[kind]
                job.waiting.answer(self._logged(self._answer(kind, job)))
                self._changed()
        if not self._running:
            self._poll.cancel()

    def _answer(self, kind: str, job: _Job) -> Any:
        try:
            return Trigger.Response(success=True, message=job.background.result()())
        except RefusedFileError as error:
            self._node.get_logger().error(error.why)
            why = str(error)
        except CalibrationError as error:
            why = str(error)
        except Exception as error:
            self._node.get_logger().error(traceback.format_exc())
            why = f"the {kind} failed: {error!r}"
        self._tell(kind, why)
        return Trigger.Response(success=False, message=why)

    def _logged(self, response: Any) -> Any:
        log = self._node.get_logger()
        if response.success:
            log.info(response.message)
        else:
            log.warn(response.message)
        return response
