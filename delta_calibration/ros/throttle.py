"""How often a node may say something again."""

from __future__ import annotations

import math
import time


class Throttle:
    """Lets something be said at most once in so many seconds of the steady clock.

    rclpy's own `throttle_duration_sec` walks the stack at every call, 0.24 ms at the least:
    what is said at the rate of the commands would hold them up.

    Args:
        seconds: between two times.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds, self._last_s = seconds, -math.inf

    def lets(self, now_s: float | None = None) -> bool:
        """Whether to say it now (steady time [s]); if so, the next time is `seconds` later."""
        now_s = time.monotonic() if now_s is None else now_s
        if now_s - self._last_s < self._seconds:
            return False
        self._last_s = now_s
        return True
