"""Values that are computed once for each object: threads with an object each do not wait."""

from __future__ import annotations

from threading import Barrier
from time import sleep

from delta_calibration import threads
from delta_calibration.lazy import cached_property
from delta_calibration.threads import mapped


class Meeting:
    """An object whose value is known once another thread computes its own."""

    barrier = Barrier(2)
    made = 0

    @cached_property
    def met(self) -> int:
        """How often it was computed."""
        self.made += 1
        self.barrier.wait(10)
        return self.made


class Slow:
    """An object whose value takes a while."""

    @cached_property
    def value(self) -> list[int]:
        """A new list each time."""
        sleep(0.05)
        return []


def test_two_threads_compute_values_of_two_objects_at_the_same_time(monkeypatch):
    monkeypatch.setattr(threads, "_THREADS", 2)
    both = Meeting(), Meeting()
    assert mapped(lambda each: each.met, both) == [1, 1]
    assert [each.met for each in both] == [1, 1]


def test_threads_that_ask_for_one_value_get_the_same(monkeypatch):
    monkeypatch.setattr(threads, "_THREADS", 2)
    one = Slow()
    first, second = mapped(lambda each: each.value, (one, one))
    assert first is second is one.value
    assert isinstance(Slow.value, cached_property)
