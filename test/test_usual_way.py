"""The fast path of usual commands gives exactly the results of the full path."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from delta_calibration.calibration_file import save_calibration
from delta_calibration.cell.calibration_session import CalibrationSession, Settings
from delta_calibration.cell.command_path import (
    ALREADY,
    BACKWARD,
    BEYOND,
    BLENDED,
    CLAMP,
    ECHO,
    HOLD,
    LIMITED,
    PASS_THROUGH,
    REFUSE,
    STALE,
)
from delta_calibration.cell.joint_bytes import Layout, stamp_of
from delta_calibration.cell.usual import MARK, UsualWay
from delta_calibration.compensation import CommandStatus
from delta_calibration.data import Poses, collect
from delta_calibration.estimation import Identification, identify
from delta_calibration.plans import make_plan, nominal_joints
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from extended_bench import Effects, with_effects

ROBOT = load_robot("srbd")
NAMES = ROBOT.joints.names
MIDDLE = ROBOT.model().home
T0_NS = 1_700_000_000_000_000_000
EFFECTS: dict[str, Effects] = {
    "geometry": {},
    "play": {"backlash": ({}, 4e-4)},
    "three": {
        "backlash": ({}, 4e-4),
        "joint_compliance": ({}, 4e-5),
        "thermal_growth_arm": ({"sensor": "arm"}, 23e-6),
    },
    "speed": {"joint_lag": ({}, 5e-3), "dynamic_deflection": ({}, 1e-6)},
}


@pytest.fixture(scope="module", name="files")
def files_fixture(tmp_path_factory: Any) -> dict[str, Path]:
    plan = make_plan("identify", ROBOT, count=15, dwell=0.4, both_sides=False)
    session = simulate_session(draw_machine(ROBOT, 5), plan, 5)
    poses: Poses = collect(session, NAMES)
    found: Identification = identify(poses, ROBOT, "rotary_delta")
    folder, made = tmp_path_factory.mktemp("usual"), {}
    for name, effects in EFFECTS.items():
        made[name] = folder / f"{name}.yaml"
        save_calibration(made[name], with_effects(found, ROBOT, effects), ROBOT, poses)
    return made


@dataclass(frozen=True)
class Given:
    """A command of a stream, and events before it."""

    q: np.ndarray
    stamp_ns: int
    now_s: float
    frame: str = ""
    age_s: float = 0.0
    enable: bool | None = None
    again: int = 0  # repeat an earlier output, counted from the last, as the command
    order: tuple[int, ...] = (0, 1, 2)  # of the names
    big: bool = False  # whether numbers are big-endian
    gripper: bool = False  # whether another joint is in the message
    speeds: int = 0  # number of velocities
    burst: bool = False  # whether time was lost before
    restart: bool = False  # whether the node is deactivated and activated
    stands: bool = False  # whether joint_states confirm the last output
    reload: bool = False  # whether the calibration is loaded again


def message(given: Given) -> bytes:
    end = ">" if given.big else "<"
    names = [NAMES[k] for k in given.order] + ["gripper"] * given.gripper
    positions = [*given.q[list(given.order)], *[0.5] * given.gripper]
    made = bytearray(b"\0" + bytes([not given.big]) + b"\0\0")

    def put(kind: str, *values: Any) -> None:
        size = 8 if kind == "d" else 4
        made.extend(bytes((4 - len(made)) % size if values else 0))
        made.extend(struct.pack(f"{end}{len(values)}{kind}", *values))

    def words(text: str) -> None:
        put("I", len(text) + 1)
        made.extend(text.encode() + b"\0")

    sec, nanosec = divmod(given.stamp_ns, 1_000_000_000)
    put("i", sec)
    put("I", nanosec)
    words(given.frame)
    put("I", len(names))
    for name in names:
        words(name)
    for values in (positions, [0.25] * given.speeds, []):
        put("I", len(values))
        put("d", *values)
    return bytes(made)


class Follower:
    """A desk that uses the fast path where possible, or always the full path."""

    def __init__(self, short: bool, calibration: Path, **settings: Any) -> None:
        self.desk = CalibrationSession(Settings("srbd", calibration=str(calibration), **settings))
        self.short, self.went = short, 0
        self.layouts: dict[int, bytes] = {}  # by the size of a message
        self.calibration = str(calibration)
        self.out: list[np.ndarray] = []
        self.desk.start_capture(0.0)

    def give(self, given: Given) -> tuple[object, ...]:
        """All visible results of a command."""
        if given.again and self.out:
            given = replace(given, q=self.out[-given.again])
        if given.stands and self.out:
            self.desk.path.stand(self.out[-1], given.now_s)
        if given.restart:
            self.desk.reset()
            self.desk.enable(True)
        if given.reload:
            self.desk.reload(self.calibration, "")
        if given.burst:
            self.desk.path.interrupt()
        if given.enable is not None:
            self.desk.enable(given.enable)
        return (*self._followed(given), *self._told())

    def _followed(self, given: Given) -> tuple[object, ...]:
        data, desk = message(given), self.desk
        out = desk.follow(data, given.now_s, given.age_s) if self.short else None
        if out is not None:
            self.went += 1
            q, stamp_ns, sent = desk.usual.went()
            desk.keep(q, stamp_ns, False)
            layout = Layout.of(out)
            assert layout is not None
            np.testing.assert_array_equal(layout.read(out), sent.joint)
            assert (layout.frame_id, layout.names) == (MARK, NAMES)
            assert stamp_of(out) == divmod(given.stamp_ns, 1_000_000_000)
        else:
            layout = Layout.of(data)
            fixed = layout.fixed(data)[1].tobytes()
            if self.short and self.layouts.get(len(data)) != fixed:  # as `JointIntake` does
                desk.usual.learn(layout, data)
                self.layouts[len(data)] = fixed
            already, seen = given.frame == MARK, self.short and desk.usual.seen
            sent = desk.send(given.q, given.stamp_ns, given.now_s, already, given.age_s, seen)
            desk.keep(given.q, given.stamp_ns, already)
        if sent is None:
            return None, None
        self.out.append(sent.joint)
        return sent.joint.tobytes(), sent.compensated

    def _told(self) -> tuple[object, ...]:
        desk, path = self.desk, self.desk.path
        measured = desk.nominal(np.zeros(3), 0.0).tobytes()
        values = tuple(desk.health(0.0, 1.0).values.items())
        stage = path.ramp.stage
        ramp = np.asarray(stage.applied).tobytes(), stage.source is path.compensator, stage.left_s
        return dict(path.counts), path.trouble, path.applied, ramp, measured, values


def motion(t: float) -> np.ndarray:
    return MIDDLE + 0.1 * np.sin(7.0 * t + np.array([0.0, 2.1, 4.2]))


def stream(seed: int = 0) -> Iterator[Given]:
    """A second and a half of commands at 1 kHz, with all faults that can occur."""
    draws = np.random.default_rng(seed)
    outside = nominal_joints(ROBOT, np.array([[0.0, 0.0, -0.62]]))[0]
    odd = {
        100: {"enable": True},
        500: {"frame": MARK},
        520: {"frame": "tool"},
        540: {"age_s": 0.9},
        560: {"age_s": -0.9},
        580: {"q": np.array([0.1, np.nan, 0.2])},
        600: {"q": np.full(3, 50.0)},
        620: {"again": 5},
        640: {"again": 1, "frame": MARK},
        700: {"q": outside},
        760: {"stamp_ns": T0_NS},
        1000: {"enable": False},
        1150: {"enable": True},
    }
    for k in range(1500):
        t = 1e-3 * k + 2e-4 * draws.uniform()
        given = Given(motion(t), T0_NS + int(t * 1e9), 10.0 + 1e-3 * k)
        if 800 <= k < 850:
            given = replace(given, order=(2, 0, 1))
        if 900 <= k < 930:  # no motion
            given = replace(given, q=motion(0.9))
        yield replace(given, **odd.get(k, {}))


@pytest.mark.parametrize("on_failure", [PASS_THROUGH, HOLD])
@pytest.mark.parametrize("name", EFFECTS)
def test_both_ways_come_to_the_same(files: dict[str, Path], name: str, on_failure: str) -> None:
    short, long = (
        Follower(
            short, files[name], on_failure=on_failure, ramp_s=0.1, rate=0.2, command_timeout_s=0.5
        )
        for short in (True, False)
    )
    for k, given in enumerate(stream()):
        for follower in (short, long):
            if k == 300:
                follower.desk.carries(0, 1.5, np.array([0.0, 0.0, -0.05]), given.now_s)
            if k in (310, 1200):
                follower.desk.is_warm("arm", 0, 24.0 + k / 100, given.now_s)
        assert short.give(given) == long.give(given), k
    sessions = [follower.desk.capture.session("") for follower in (short, long)]
    for stream_of in ("stamp_ns", "position"):
        first, second = (getattr(session.command, stream_of) for session in sessions)
        np.testing.assert_array_equal(first, second)
    counts = short.desk.path.counts
    for told in (ALREADY, BACKWARD, BEYOND, ECHO, STALE, CommandStatus.NOT_FINITE.value):
        assert counts[told], told
    if "backlash" in EFFECTS[name]:
        assert counts[LIMITED]
    assert short.went > 300
    assert long.went == 0


OUTSIDE = nominal_joints(ROBOT, np.array([[0.0, 0.0, -0.62]]))[0]
FAULTS: tuple[dict[str, Any], ...] = (
    {"q": np.array([0.1, np.nan, 0.2])},
    {"q": np.array([np.inf, 0.1, 0.2])},
    {"q": np.full(3, 50.0)},
    {"q": OUTSIDE},
    {"frame": MARK},
    {"frame": "tool"},
    {"again": 1},
    {"again": 7},
    {"again": 1, "frame": MARK},
    {"stamp_ns": T0_NS},
    {"stamp_ns": 0},
    {"age_s": 0.9},
    {"age_s": np.nan},
    {"order": (1, 2, 0)},
    {"order": (1, 2, 0), "big": True},
    {"big": True},
    {"speeds": 3},
    {"gripper": True},
    {"gripper": True, "speeds": 4, "big": True},
    {"burst": True},
    {"burst": True, "stands": True},
    {"restart": True},
    {"restart": True, "stands": True},
    {"reload": True},
    {"enable": True},
    {"enable": False},
)


def random_stream(seed: int) -> Iterator[Given]:
    """Commands with random faults, pauses and senders."""
    draws = np.random.default_rng(seed)
    kind: dict[str, Any] = {}
    t = now_s = 0.0
    for k in range(700):
        pause = draws.uniform() < 0.004
        t += 0.7 if pause else draws.uniform(0.0, 2e-3)
        now_s += 0.7 if pause else draws.uniform(0.0, 2e-3)
        if draws.uniform() < 0.01:  # another sender for some time
            kind = {"big": bool(draws.integers(2)), "speeds": 3 * int(draws.integers(2))}
            kind["order"] = tuple(draws.permutation(3).tolist())
        given = Given(motion(t), T0_NS + int(t * 1e9), 10.0 + now_s, **kind)
        if k == 0:
            given = replace(given, enable=True)
        elif draws.uniform() < 0.05:
            fault = FAULTS[int(draws.integers(len(FAULTS)))]
            given = replace(given, **fault)
        elif draws.uniform() < 0.05:  # switched on again after a fault
            given = replace(given, enable=True)
        yield given


@pytest.mark.parametrize("seed", range(6))
def test_both_ways_come_to_the_same_whatever_comes(files: dict[str, Path], seed: int) -> None:
    name = list(EFFECTS)[seed % 4]
    settings: dict[str, Any] = {
        "on_failure": (PASS_THROUGH, HOLD)[seed % 2],
        "ramp_s": 0.03,
        "rate": (0.2, 5.0)[seed // 3],
        "command_timeout_s": 0.5,
        "beyond_limits": (REFUSE, CLAMP)[seed // 3],
    }
    short, long = (Follower(way, files[name], **settings) for way in (True, False))
    for follower in (short, long):
        follower.desk.carries(0, 1.5, np.array([0.0, 0.0, -0.05]), 10.0)
        follower.desk.is_warm("arm", 0, 24.0, 10.0)
    for k, given in enumerate(random_stream(seed)):
        assert short.give(given) == long.give(given), (k, given)
    assert short.went > 50
    assert long.went == 0


def test_a_blended_correction_goes_the_short_way(files: dict[str, Path]) -> None:
    planes = CalibrationSession(
        Settings("srbd", calibration=str(files["geometry"]))
    ).calibration.region.planes
    assert len(planes)
    short, long = (Follower(short, files["geometry"], ramp_s=0.0) for short in (True, False))
    for follower in (short, long):
        follower.desk.enable(True)
    heights = np.linspace(-0.70, -0.60, 1000)  # leaving through the top of the region
    places = np.column_stack([np.zeros(1000), np.zeros(1000), heights])
    for k, q in enumerate(nominal_joints(ROBOT, places)):
        given = Given(q, T0_NS + k * 1_000_000, 1e-3 * k)
        before = short.went, short.desk.path.counts[BLENDED]
        assert short.give(given) == long.give(given), k
        if short.desk.path.counts[BLENDED] > max(before[1], 1):
            assert short.went == before[0] + 1
    assert short.desk.path.counts[BLENDED] > 5


def test_what_is_known_runs_out(files: dict[str, Path]) -> None:
    """Without the arm's temperature the full path says so; with it the fast path is used."""
    follower = Follower(True, files["three"], ramp_s=0.0, temperature_timeout_s=5.0)
    desk = follower.desk
    desk.enable(True)
    desk.carries(0, 1.0, np.zeros(3), 0.0)
    desk.is_warm("arm", 0, 25.0, 0.0)
    went = []
    for k in range(20):
        if k == 15:
            desk.is_warm("arm", 0, 25.0, 9.0)
        before = follower.went
        follower.give(Given(motion(1e-3 * k), T0_NS + k * 1_000_000, 0.6 * k))
        went.append(follower.went > before)
    assert went[3:8] == [True] * 5
    assert not any(went[9:15])
    assert desk.path.counts[CommandStatus.MISSING_CONDITION.value] == 6
    assert all(went[17:])


@pytest.mark.parametrize("name", EFFECTS)
def test_a_node_has_gone_the_short_way_before_its_first_command(
    files: dict[str, Path], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No command waits until compiled code is loaded, whichever effects the model has."""
    taken, take = [], UsualWay.take
    monkeypatch.setattr(
        UsualWay, "take", lambda *given: taken.append(take(*given) is not None) or taken[-1]
    )
    CalibrationSession(Settings("srbd", calibration=str(files[name])))
    assert taken == [True]


def test_the_short_way_waits_for_a_trajectory_under_way(files: dict[str, Path]) -> None:
    follower = Follower(True, files["geometry"], ramp_s=0.0)
    follower.desk.enable(True)
    for k in range(5):
        follower.give(Given(motion(1e-3 * k), T0_NS + k * 1_000_000, 1e-3 * k))
    assert follower.went
    follower.desk.trajectories._plan = np.array([0.0, 1.0]), np.zeros((2, 3))
    went = follower.went
    follower.give(Given(motion(0.006), T0_NS + 6_000_000, 0.006))
    assert follower.went == went
