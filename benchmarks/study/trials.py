"""The trials: which causes, how strong, in which plan, from which seed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

GEOMETRY = (
    "joint_zero_offset",
    "arm_length",
    "forearm_length",
    "base_joint_position",
    "base_joint_tilt",
    "parallelogram_mismatch",
)
MEASUREMENT = ("tracker_drift", "timestamp_latency")
DRIVES = (
    "backlash",
    "stick_slip",
    "joint_lag",
    "encoder_eccentricity",
    "transmission_error",
    "joint_scale",
    "joint_zero_drift",
    "joint_compliance",
    "dynamic_deflection",
)
STRUCTURE = (
    "thermal_growth_arm",
    "thermal_growth_base",
    "thermal_growth_forearm",
    "forearm_compliance",
    "ball_joint_clearance",
)
_GEARED = (
    *MEASUREMENT,
    "backlash",
    "stick_slip",
    "joint_lag",
    "joint_zero_drift",
)
_ARM = (
    *_GEARED,
    "encoder_eccentricity",
    "transmission_error",
    "joint_scale",
    "thermal_growth_link",
)
BEYOND_GEOMETRY = MEASUREMENT + DRIVES + STRUCTURE
KINDS = ("bump", "ripple", "drag", "cross_talk", "grip", "rub", "rocking")
POOR = ("poor", "one_sided", "one_payload", "no_sweeps", "still", "no_temperatures")
# Hidden in other machines: causes, then dimensions.
OF_ROBOT: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    # its first zero belongs to the frame, its second one to the tool
    "scara": ((*_ARM, "reducer_compliance"), ("link_length",)),
    "linear_delta": (
        (
            *_GEARED,
            "transmission_error",
            "slider_pitch",
            "thermal_growth_arm",
            "thermal_growth_screw",
        ),
        ("joint_zero_offset", "arm_length"),
    ),
    "ur10": ((*_ARM, "gravity_sag"), ("joint_zero_offset", "link_length")),
    "five_axis": (
        (
            *_GEARED,
            "transmission_error",
            "slider_pitch",
            "thermal_growth_arm",
            "thermal_growth_screw",
        ),
        ("joint_zero_offset", "base_joint_position", "platform_joint_position"),
    ),
    "cdpr8": (
        (
            *_GEARED,
            "encoder_eccentricity",
            "cable_elasticity",
            "cable_sag",
            "pulley_radius",
            "drum_build_up",
            "drum_eccentricity",
            "counter_zero_offset",
        ),
        ("base_joint_position", "platform_joint_position", "drum_scale"),
    ),
}
OTHER_KINDS = ("bump", "grip", "ripple", "cross_talk")
ROBOTS = ("srbd", *OF_ROBOT)
PRECISE = 0.1  # of the tolerances: scatter of machines with one wrong dimension
_WEAK, _STRONG, _TELLING = 20.0, 5000.0, 160.0  # lambda


@dataclass(frozen=True)
class Task:
    """One machine with its session and hidden causes."""

    group: str
    seed: int
    causes: tuple[tuple[str, float], ...] = ()  # with the wanted lambda
    plan: str = "rich"
    scatter: float = 1.0
    without: str = ""  # cause removed from the catalogue
    robot: str = "srbd"

    @property
    def key(self) -> str:
        """Unique text from which the task can be restored."""
        said = asdict(self)
        if self.robot == "srbd":  # as keys were before there were other robots
            del said["robot"]
        return json.dumps(said, sort_keys=True)

    @classmethod
    def of_key(cls, key: str) -> Task:
        """The task of a key."""
        fields = json.loads(key)
        causes = tuple((name, strength) for name, strength in fields.pop("causes"))
        return cls(causes=causes, **fields)


def tasks(seed: int, share: float, robots: Sequence[str] = ("srbd",)) -> list[Task]:
    """The whole study, or a share of it, in an order of which any initial part is representative.

    Args:
        seed: of the study; the seeds of the trials are derived from it.
        share: of the number of trials; more than 1 where there is a cluster.
        robots: of `ROBOTS`; the trials of a robot do not depend on the others.
    """
    return [task for robot in robots for task in _of_robot(robot, seed, share)]


def _of_robot(robot: str, seed: int, share: float) -> list[Task]:
    if robot != "srbd":
        return _of_other(robot, np.random.default_rng([seed, ROBOTS.index(robot)]), share)
    rng = np.random.default_rng(seed)
    groups = (_none, _single, _one_dimension, _pair, _unknown, _taken_out, _poor)
    every = [task for group in groups for task in group(rng, share)]
    numbered = [
        Task(t.group, int(number), t.causes, t.plan, t.scatter, t.without)
        for number, t in zip(rng.permutation(10**6)[: len(every)], every, strict=True)
    ]
    return [numbered[k] for k in rng.permutation(len(numbered))]


def _of_other(robot: str, rng: np.random.Generator, share: float) -> list[Task]:
    """A quarter of the Delta's trials of each kind, with causes that such a machine can have."""
    causes, dimensions = OF_ROBOT[robot]
    every: list[Task] = []
    for _ in _many(60, share):
        every.append(Task("none", 0, robot=robot))
    for _ in _many(3, share):
        for cause in causes:
            every.append(Task("single", 0, ((cause, _strength(rng)),), robot=robot))
        for cause in dimensions:
            hidden = ((cause, _strength(rng)),)
            every.append(Task("dimension", 0, hidden, scatter=PRECISE, robot=robot))
        for kind in OTHER_KINDS:
            hidden = ((f"unknown:{kind}", _strength(rng)),)
            every.append(Task("unknown", 0, hidden, robot=robot))
    for _ in _many(12, share):
        two = rng.choice(causes, 2, replace=False).tolist()
        hidden = tuple((cause, _strength(rng, _TELLING)) for cause in two)
        every.append(Task("pair", 0, hidden, robot=robot))
    seeds = rng.permutation(10**6)[: len(every)]
    numbered = [replace(t, seed=int(k)) for k, t in zip(seeds, every, strict=True)]
    return [numbered[k] for k in rng.permutation(len(numbered))]


def _many(count: int, share: float) -> range:
    return range(max(1, round(count * share)))


def _strength(rng: np.random.Generator, low: float = _WEAK) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(_STRONG))))


def _none(rng: np.random.Generator, share: float) -> Iterator[Task]:
    for _ in _many(500, share):
        yield Task("none", 0)


def _single(rng: np.random.Generator, share: float) -> Iterator[Task]:
    for cause in BEYOND_GEOMETRY:
        for _ in _many(12, share):
            yield Task("single", 0, ((cause, _strength(rng)),))


def _one_dimension(rng: np.random.Generator, share: float) -> Iterator[Task]:
    for cause in GEOMETRY:
        for _ in _many(10, share):
            yield Task("dimension", 0, ((cause, _strength(rng)),), scatter=PRECISE)


def _pair(rng: np.random.Generator, share: float) -> Iterator[Task]:
    for _ in _many(80, share):
        two = rng.choice(BEYOND_GEOMETRY, 2, replace=False).tolist()
        yield Task("pair", 0, tuple((cause, _strength(rng, _TELLING)) for cause in two))


def _unknown(rng: np.random.Generator, share: float) -> Iterator[Task]:
    for kind in KINDS:
        for _ in _many(12, share):
            yield Task("unknown", 0, ((f"unknown:{kind}", _strength(rng)),))


def _taken_out(rng: np.random.Generator, share: float) -> Iterator[Task]:
    for cause in BEYOND_GEOMETRY:
        for _ in _many(3, share):
            yield Task("taken out", 0, ((cause, _strength(rng)),), without=cause)


def _poor(rng: np.random.Generator, share: float) -> Iterator[Task]:
    for plan in POOR:
        for _ in _many(15, share):
            cause = str(rng.choice(BEYOND_GEOMETRY))
            yield Task("poor", 0, ((cause, _strength(rng)),), plan=plan)
