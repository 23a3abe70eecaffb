"""Sessions with a mistake made on purpose: 37 kinds, each at two sizes, for every robot.

This module shares no code with the doctor: a mistake is made in the recorded numbers, as a logger,
an exporter or a user would make it.
"""

from __future__ import annotations

import copy
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from delta_calibration.data import JointStream, Session, TrackerStream
from delta_calibration.doctor import Checked, Mistake, check, examine
from delta_calibration.documents import write_document
from delta_calibration.geometry import rotations
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot, load_robot, robot_document
from delta_calibration.simulation import TrueMachine, draw_machine, simulate_session, standing

ROBOTS = ("srbd", "linear_delta", "five_axis", "cdpr8", "scara", "ur10")
BOTH = ("joint_command", "joint_states")
_TURN = 20e-6  # [rad] noise of a probe's rotation


@dataclass(frozen=True)
class Case:
    """A clean session, its robot, and the robot's file as data."""

    session: Session
    robot: Robot
    document: dict
    machine: TrueMachine

    @property
    def slides(self) -> bool:
        return self.robot.joints.unit == "m"

    @property
    def joints(self) -> int:
        return len(self.robot.joints.names)


@dataclass(frozen=True)
class Made:
    """A session with a mistake, and what has to be found in it."""

    session: Session
    mistake: str
    streams: tuple[str, ...]
    part: str | None = None
    value: float | None = None
    within: float = 0.02  # of the value
    document: dict | None = None  # of a robot file with the mistake
    clean: Session | None = None  # without the mistake, if different from the case's session


Kind = Callable[[Case, int], Made | None]
KINDS: dict[str, Kind] = {}


def kind(make: Kind) -> Kind:
    """Register a kind of mistake; it returns None if a robot cannot show it."""
    KINDS[make.__name__] = make
    return make


def clean_case(name: str, seed: int, turns: bool = False, effects=(), plan="identify") -> Case:
    """A session of a machine with manufacturing errors, and hidden effects if requested."""
    robot = load_robot(name)
    document = robot_document(name)[1]
    if turns:
        document["tracker"] = {**document["tracker"], "measures": "pose", "turn_urad": 20.0}
        robot = replace(robot, tracker=replace(robot.tracker, measures="pose", turn=_TURN))
    machine = draw_machine(robot, seed, hidden=effects)
    session = simulate_session(machine, make_plan(plan, robot, seed=seed), seed)
    return Case(session, robot, document, machine)


def has_turns(name: str) -> bool:
    """Whether a kind of mistake needs measured rotations."""
    return name.startswith("turns_")


# Tools for making mistakes.


def joints(session: Session, streams, change) -> Session:
    def changed(stream: JointStream | None, name: str) -> JointStream | None:
        if stream is None or name not in streams:
            return stream
        return replace(stream, position=change(stream.position))

    return replace(
        session,
        command=changed(session.command, BOTH[0]),
        states=changed(session.states, BOTH[1]),
    )


def points(session: Session, change) -> Session:
    tracker = session.tracker
    return replace(session, tracker=replace(tracker, position=change(tracker.position)))


def turned(session: Session, change) -> Session:
    tracker = session.tracker
    return replace(session, tracker=replace(tracker, quaternion=change(tracker.quaternion)))


def stamped(session: Session, stream: str, change) -> Session:
    field = {"tracker": "tracker", BOTH[0]: "command", BOTH[1]: "states"}[stream]
    old = getattr(session, field)
    zero = old.stamp_ns[0]
    time = change((old.stamp_ns - zero) * 1e-9)
    stamps = zero + np.round(time * 1e9).astype(np.int64)
    return replace(session, **{field: replace(old, stamp_ns=stamps)})


def behind(session: Session, share: float) -> tuple[np.ndarray, float]:
    """Which readings lie after a share of the session, (n, 1), and the time of that [s]."""
    time = (session.tracker.stamp_ns - session.tracker.stamp_ns[0]) * 1e-9
    when = share * time[-1]
    return (time > when)[:, None], when


# Units.


def _unit(case: Case, size: int, streams) -> Made:
    if not case.slides:
        made = joints(case.session, streams, np.degrees)
        return Made(made, "unit_degrees", streams)
    factor, name = ((1e3, "unit_mm"), (1 / 0.0254, "unit_inch"))[size]
    return Made(joints(case.session, streams, lambda q: q * factor), name, streams)


@kind
def command_unit(case, size):
    return _unit(case, size, BOTH[:1])


@kind
def states_unit(case, size):
    return _unit(case, size, BOTH[1:])


@kind
def joints_unit(case, size):
    return _unit(case, size, BOTH)


@kind
def tracker_unit(case, size):
    factor, name = ((1e3, "unit_mm"), (1 / 0.0254, "unit_inch"))[size]
    return Made(points(case.session, lambda p: p * factor), name, ("tracker",))


@kind
def coordinate_unit(case, size):
    """Heights in mm instead of metres; y in inches."""
    axis, factor, name = ((2, 1e3, "unit_mm"), (1, 1 / 0.0254, "unit_inch"))[size]
    by = np.ones(3)
    by[axis] = factor
    return Made(points(case.session, lambda p: p * by), name, ("tracker",), "xyz"[axis])


# Wiring.


def _swapped(case: Case, size: int, streams) -> Made:
    a, b = ((0, 1), (0, case.joints - 1))[size]
    order = list(range(case.joints))
    order[a], order[b] = b, a
    names = case.robot.joints.names
    made = joints(case.session, streams, lambda q: q[:, order])
    part = f"{names[a]}, {names[b]}" if len(streams) == 1 else None
    return Made(made, "joints_swapped", streams, part)


@kind
def command_swapped(case, size):
    return _swapped(case, size, BOTH[:1])


@kind
def states_swapped(case, size):
    return _swapped(case, size, BOTH[1:])


@kind
def joints_swapped(case, size):
    return _swapped(case, size, BOTH)


def _reversed(case: Case, size: int, streams) -> Made:
    joint = (1, 0)[size]
    sign = np.ones(case.joints)
    sign[joint] = -1.0
    made = joints(case.session, streams, lambda q: q * sign)
    return Made(made, "joint_reversed", streams, case.robot.joints.names[joint])


@kind
def command_reversed(case, size):
    return _reversed(case, size, BOTH[:1])


@kind
def states_reversed(case, size):
    return _reversed(case, size, BOTH[1:])


@kind
def joint_reversed(case, size):
    return _reversed(case, size, BOTH)


def _offset(case: Case, value: float, joint: int, streams) -> Made:
    shift = np.zeros(case.joints)
    shift[joint] = value
    made = joints(case.session, streams, lambda q: q + shift)
    name = case.robot.joints.names[joint]
    return Made(made, "joint_offset", streams, name, value, within=0.1)


def _turns(case: Case, size: int) -> float:
    """One or two turns of a joint; 20 or 100 mm of a sliding one."""
    return (0.02, 0.1)[size] if case.slides else 2 * np.pi * (1, 2)[size]


@kind
def command_offset(case, size):
    return _offset(case, _turns(case, size), 1, BOTH[:1])


@kind
def states_offset(case, size):
    if case.robot.name == "ur10":
        return None  # limits of +-360 degrees leave open which of two streams is a turn off
    return _offset(case, _turns(case, size), 1, BOTH[1:])


@kind
def joint_offset(case, size):
    """5 and 30 degrees; 10 and 60 mm; 5 and 20 turns of a motor with a drum."""
    value = np.radians((5.0, 30.0)[size])
    if case.slides:
        value = (0.01, 0.06)[size]
    if case.robot.name == "cdpr8":
        value = 2 * np.pi * (5, 20)[size]
    made = _offset(case, value, 1, BOTH)
    # The offset includes the machine's own zeros, 1 mm off, or its anchors, 10 mm off.
    own = {"linear_delta": 0.3, "cdpr8": 0.2}
    return replace(made, within=own.get(case.robot.name, made.within))


@kind
def joint_turns(case, size):
    if case.slides or case.robot.name in ("ur10", "cdpr8"):
        return None  # no rotations, or rotations within its limits
    return _offset(case, 2 * np.pi * (1, -2)[size], 1, BOTH)


@kind
def exchanged(case, size):
    session = case.session
    if size:  # only one of them at that rate
        states = session.states
        keep = slice(None, None, 2)
        session = replace(
            session,
            states=JointStream(states.stamp_ns[keep], states.names, states.position[keep]),
        )
    made = replace(session, command=session.states, states=session.command)
    return Made(made, "streams_exchanged", BOTH)


# Frames.


@kind
def mirrored(case, size):
    if case.robot.name == "scara":
        return None  # a plane seen from behind: the frame absorbs it
    sign = np.array([(1.0, -1.0, 1.0), (1.0, 1.0, -1.0)][size])
    part = (None, "z")[size]
    return Made(points(case.session, lambda p: p * sign), "frame_mirrored", ("tracker",), part)


@kind
def axes(case, size):
    if case.robot.name == "scara":
        return None
    order = ([1, 0, 2], [0, 2, 1])[size]
    part = ("x, y", "y, z")[size]
    return Made(points(case.session, lambda p: p[:, order]), "axes_swapped", ("tracker",), part)


@kind
def turns_mirrored(case, size):
    """Mirror positions only: the rotations show which axis is mirrored."""
    sign = np.array([(-1.0, 1.0, 1.0), (1.0, 1.0, -1.0)][size])
    if case.robot.name == "scara":
        return None
    return Made(points(case.session, lambda p: p * sign), "frame_mirrored", ("tracker",))


@kind
def turns_axes(case, size):
    """Permute the axes, which points alone do not show."""
    order = ([1, 2, 0], [2, 0, 1])[size]
    return Made(points(case.session, lambda p: p[:, order]), "axes_swapped", ("tracker",))


@kind
def turns_quaternion(case, size):
    order = ([3, 0, 1, 2], [1, 2, 3, 0])[size]
    made = turned(case.session, lambda q: q[:, order])
    return Made(made, "rotation_order", ("tracker",))


@kind
def turns_angles(case, size):
    """Read angles of one order in another, with a tracker tilted by 0.8 rad."""
    lean = Rotation.from_rotvec([0.6, 0.5, 0.3])
    session = points(case.session, lambda p: lean.apply(p))
    session = turned(session, lambda q: (lean * Rotation.from_quat(q)).as_quat())
    true, read = (("xyz", "zyx"), ("zyx", "xzy"))[size]

    def wrong(q):
        angles = Rotation.from_quat(q).as_euler(true)
        by_axis = dict(zip(true, angles.T, strict=True))
        return Rotation.from_euler(read, np.column_stack([by_axis[a] for a in read])).as_quat()

    return Made(turned(session, wrong), "rotation_order", ("tracker",), f"{true} as {read}")


# Clocks.


def _late(case: Case, size: int, stream: str) -> Made:
    late = (0.5, 10.0)[size]
    made = stamped(case.session, stream, lambda t: t + late)
    return Made(made, "clock_offset", (stream,), None, late, within=0.06)


@kind
def tracker_late(case, size):
    return _late(case, size, "tracker")


@kind
def states_late(case, size):
    return _late(case, size, "joint_states")


@kind
def command_late(case, size):
    return _late(case, size, "joint_command")


@kind
def tracker_drifts(case, size):
    rate = (3e-3, -2e-2)[size]
    made = stamped(case.session, "tracker", lambda t: t * (1 + rate))
    return Made(made, "clock_drift", ("tracker",), None, rate, within=0.1)


@kind
def states_drift(case, size):
    rate = (3e-3, -2e-2)[size]
    made = stamped(case.session, "joint_states", lambda t: t * (1 + rate))
    return Made(made, "clock_drift", ("joint_states",), None, rate, within=0.1)


def stops_table(session: Session) -> Session:
    """One row per stop, ten seconds apart, like an imported table."""
    moved = np.abs(np.diff(session.command.position, axis=0)).max(axis=1) > 0
    ends = np.flatnonzero(moved[1:] & ~moved[:-1])
    stamps = session.tracker.stamp_ns[0] + 10_000_000_000 * np.arange(len(ends))
    at = session.command.stamp_ns[ends]
    rows = np.searchsorted(session.tracker.stamp_ns, at).clip(0, len(session.tracker.stamp_ns) - 1)
    joint = JointStream(stamps, session.command.names, session.command.position[ends])
    return replace(
        session,
        command=joint,
        states=None,
        tracker=TrackerStream(stamps, session.tracker.position[rows]),
        temperature=(),
        payload=None,
    )


@kind
def rows_late(case, size):
    """A table whose readings are shifted by one or three rows against their joints."""
    late, clean = (10.0, 30.0)[size], stops_table(case.session)
    made = stamped(clean, "tracker", lambda t: t + late)
    return Made(made, "clock_offset", ("tracker",), None, late, clean=clean)


# Changes during a session.


@kind
def tracker_shifted(case, size):
    late, when = behind(case.session, (0.4, 0.7)[size])
    move = np.array([(0.006, 0.008, 0.0), (0.2, -0.1, 0.05)][size])
    made = points(case.session, lambda p: p + late * move)
    return Made(made, "tracker_moved", ("tracker",), None, when, within=0.03)


@kind
def tracker_turned(case, size):
    late, when = behind(case.session, (0.6, 0.3)[size])
    turn = rotations.exp(np.array([(0.0, 0.0, 2e-3), (0.01, 0.02, 0.5)][size]))
    made = points(case.session, lambda p: np.where(late, p @ turn.T, p))
    return Made(made, "tracker_moved", ("tracker",), None, when, within=0.03)


@kind
def reflector(case, size):
    """Another reflector on the platform, 12.7 or 49 mm from the first."""
    late, when = behind(case.session, (0.5, 0.35)[size])
    shift = np.array([(0.0127, 0.0, 0.0), (-0.02, 0.04, 0.02)][size])
    session, machine = case.session, case.machine
    time, own = session.tracker.stamp_ns * 1e-9, session.states.stamp_ns * 1e-9
    q = np.column_stack([np.interp(time, own, c) for c in session.states.position.T])
    turned = machine.chain.mechanism.rotation(machine.chain.pose(standing(q), machine.theta))
    rigid = machine.chain.split(machine.theta)[2].rotation
    moved = (rigid @ turned) @ shift
    made = points(session, lambda p: p + late * moved)
    return Made(made, "reflector_changed", ("tracker",), None, when, within=0.03)


# Loggers.


def _every(session: Session, stream: str, size: int, between: bool) -> Session:
    field = {"tracker": "tracker", BOTH[1]: "states"}[stream]
    old = getattr(session, field)
    n, step = len(old.stamp_ns), (2, 5)[size]
    kept = np.arange(0, n, step)
    if between:
        time = (old.stamp_ns - old.stamp_ns[0]) * 1e-9
        position = np.column_stack(
            [np.interp(time, time[kept], column[kept]) for column in old.position.T]
        )
        n = kept[-1] + 1
    else:
        position = old.position[(np.arange(n) // step) * step]
    cut = {k: v[:n] for k, v in vars(old).items() if isinstance(v, np.ndarray)}
    return replace(session, **{field: replace(old, **{**cut, "position": position[:n]})})


def _logged(case: Case, size: int, stream: str, between: bool) -> Made:
    """Without the made-up values the remaining ones are the cleanest possible session."""
    made = _every(case.session, stream, size, between)
    field = {"tracker": "tracker", BOTH[1]: "states"}[stream]
    old = getattr(case.session, field)
    real = {k: v[:: (2, 5)[size]] for k, v in vars(old).items() if isinstance(v, np.ndarray)}
    clean = replace(case.session, **{field: replace(old, **real)})
    return Made(made, "held_values", (stream,), clean=clean)


@kind
def tracker_held(case, size):
    return _logged(case, size, "tracker", False)


@kind
def tracker_between(case, size):
    return _logged(case, size, "tracker", True)


@kind
def states_held(case, size):
    return _logged(case, size, BOTH[1], False)


@kind
def states_between(case, size):
    return _logged(case, size, BOTH[1], True)


# Robot files.

_LENGTHS = {
    "srbd": ("arm_mm", "rod_mm"),
    "linear_delta": ("arm_mm", "radius_mm"),
    "five_axis": ("turning.strut_mm", "hinged.column_y_mm"),
    "cdpr8": ("joints_mm", "anchors_mm"),
    "scara": ("tool_mm", "links.1.length_mm"),
    "ur10": ("links.2.length_mm", "links.3.length_mm"),
}


def _edited(document: dict, path: str, change) -> dict:
    edited = copy.deepcopy(document)
    inside = edited["geometry"]
    *way, last = [int(k) if k.isdigit() else k for k in path.split(".")]
    for key in way:
        inside = inside[key]
    inside[last] = change(np.asarray(inside[last], dtype=float)).tolist()
    return edited


@kind
def file_unit(case, size):
    """One length of the file in metres, or in inches."""
    path = _LENGTHS[case.robot.name][size]
    edited = _edited(case.document, path, lambda v: v / (1e3, 25.4)[size])
    return Made(case.session, "robot_file_unit", ("robot_file",), document=edited)


@kind
def wrong_robot(case, size):
    """The file of a machine of another size: one dimension is 15 or 40 % larger."""
    path = _LENGTHS[case.robot.name][0]
    edited = _edited(case.document, path, lambda v: v * (1.15, 1.4)[size])
    edited["name"] = "another"
    return Made(case.session, "wrong_robot", ("robot_file",), document=edited)


# Evaluation.


def examined(case: Case, made: Made) -> Checked:
    """Result of the doctor; a robot file is given by its path."""
    if made.document is None:
        return check(made.session, case.robot)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.yaml"
        write_document(path, made.document)
        return examine(made.session, path)


def is_it(found: Mistake, made: Made) -> bool:
    """Whether a reported mistake is the one that was made."""
    if found.mistake != made.mistake or found.stream not in made.streams:
        return False
    if made.part not in (None, found.part) and not found.is_alternative:
        return False
    if made.value is None:
        return True
    return found.value is not None and abs(found.value - made.value) <= made.within * abs(
        made.value
    )


def judged(found: tuple[Mistake, ...], made: Made) -> tuple[bool, bool]:
    """Whether the mistake is named, and whether it is named first."""
    right = {m.stream for m in found if is_it(m, made)} == set(made.streams)
    same = {m.mistake for m in found if not m.is_alternative}
    named = right and (
        same == {made.mistake} or any(is_it(m, made) and m.is_alternative for m in found)
    )
    return named and len(same) == 1, named and bool(found) and found[0].mistake == made.mistake
