"""Limit for the rate of repeated log messages."""

from __future__ import annotations

import math
import time


class Throttle:
    """Allows a message at most once in a given time of the steady clock.

    rclpy's own `throttle_duration_sec` walks the stack at every call, which takes at least 0.24 ms
    and would delay the commands if called at their rate.

    Args:
        seconds: shortest time between two messages [s].
    """

    def __init__(self, seconds: float) -> None:
        self._seconds, self._last_s = seconds, -math.inf

    def lets(self, now_s: float | None = None) -> bool:
        """Whether a message is allowed now (steady time [s]); if so, the interval restarts."""
        now_s = time.monotonic() if now_s is None else now_s
        if now_s - self._last_s < self._seconds:
            return False
        self._last_s = now_s
        return True
