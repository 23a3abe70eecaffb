"""Independent work is divided among threads; linear algebra uses one thread during a fit."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from threading import Barrier, get_ident

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from delta_calibration import threads as divided
from delta_calibration.data import survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.estimation import PointMeasured, chain_of
from delta_calibration.estimation.fit import prepare
from delta_calibration.estimation.solver import solve
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from delta_calibration.threads import mapped, one_thread
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


@pytest.fixture
def _two_threads(monkeypatch):
    monkeypatch.setattr(divided, "_THREADS", 2)


@pytest.mark.usefixtures("_two_threads")
def test_two_items_run_at_the_same_time_and_come_back_in_order():
    both = Barrier(2, timeout=20)  # broken unless both are inside at once
    assert mapped(lambda i: (both.wait(), i * i)[1], range(2)) == [0, 1]


@pytest.mark.usefixtures("_two_threads")
def test_what_such_a_thread_divides_again_stays_on_it():
    every = mapped(lambda _: {get_ident(), *mapped(lambda _: get_ident(), range(8))}, range(4))
    assert [len(own) for own in every] == [1] * 4
    assert get_ident() not in set.union(*every)


@pytest.mark.usefixtures("_two_threads")
def test_an_error_in_a_thread_is_raised_where_the_work_was_divided():
    with pytest.raises(ZeroDivisionError):
        mapped(lambda i: 1 // i, range(3))


def test_a_verdict_does_not_depend_on_the_number_of_threads(monkeypatch):
    robot = load_robot("linear_delta")
    machine = draw_machine(robot, 5, hidden={"backlash": {"strength": "1.0"}})
    session = simulate_session(machine, make_plan("identify", robot, seed=5), 5)
    seen = survey(session, robot.joints.names, robot.commanded.joint_size)
    verdicts = []
    for count in (1, 2, 5):
        monkeypatch.setattr(divided, "_THREADS", count)
        verdicts.append(diagnose(seen, robot, seed=5).verdict.as_dict())
    assert verdicts[0]["findings"]
    assert verdicts[1] == verdicts[2] == verdicts[0]
