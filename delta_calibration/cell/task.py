"""Progress of a task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence


class Task:
    """Progress of a task in steps of unknown duration.

    `begin` may be called from another thread than the other methods.

    Args:
        name: name of the task, one word.
        steps: names of the steps, in their order.
        now_s: steady time at the start [s].
    """

    def __init__(self, name: str, steps: Sequence[str], now_s: float) -> None:
        self.name, self._steps, self._since_s = name, tuple(steps), now_s
        self._step = self._steps[0]

    def begin(self, step: str) -> None:
        """Report that a step begins; the steps before it are done."""
        self._step = step

    def sentence(self) -> str:
        """Progress as a text such as `geometry, step 2 of 3`."""
        return f"{self._step}, step {self._number} of {len(self._steps)}"

    def values(self, now_s: float) -> Mapping[str, object]:
        """Progress in numbers, for diagnostics."""
        return {
            "step": self._step,
            "steps done": self._number - 1,
            "steps": len(self._steps),
            "done [%]": f"{100 * (self._number - 1) / len(self._steps):.0f}",
            "elapsed [s]": f"{now_s - self._since_s:.1f}",
        }

    @property
    def _number(self) -> int:
        return self._steps.index(self._step) + 1
