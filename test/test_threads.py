"""Linear algebra uses one thread during a fit, and as many as before afterwards."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from delta_calibration.estimation import PointMeasured, chain_of
from delta_calibration.estimation.fit import prepare
from delta_calibration.estimation.problem import solve
from delta_calibration.threads import one_thread
from identification_bench import ROBOT, found


def threads() -> set[int]:
    return {lib["num_threads"] for lib in threadpool_info() if lib["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def _two():
    with threadpool_limits(limits=2, user_api="blas"):
        if threads() != {2}:
            pytest.skip("this machine's linear algebra has one thread")
        yield


class Watched(PointMeasured):
    """Records the number of threads at each prediction of a fit."""

    def linearized(self, *arguments):
        SEEN.append(threads())
        return super().linearized(*arguments)


SEEN: list[set[int]] = []


def test_a_fit_has_one_thread_and_gives_the_others_back():
    problem = prepare(found(0)[1], ROBOT, chain_of(ROBOT, "rotary_delta"))[2]
    (part,) = problem.measured
    own = {name: getattr(part.observation, name) for name in part.observation.__match_args__}
    SEEN.clear()
    solve(replace(problem, measured=(replace(part, observation=Watched(**own)),)))
    assert len(SEEN) > 3
    assert set.union(*SEEN) == {1}
    assert threads() == {2}


def test_an_error_gives_the_threads_back():
    with pytest.raises(ValueError, match="bad"), one_thread():
        raise ValueError("bad")
    assert threads() == {2}


def test_who_is_done_first_does_not_take_it_from_the_other():
    """Two overlapping fits: the second starts during the first and ends later."""
    first, second = ExitStack(), ExitStack()
    first.enter_context(one_thread())
    second.enter_context(one_thread())
    first.close()
    assert threads() == {1}
    second.close()
    assert threads() == {2}
