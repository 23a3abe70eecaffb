"""Base class of effects: errors of the measuring chain that a geometric model leaves out.

An effect adds to the output of one stage: to the joint angles behind the encoders (DRIVE), to the
mechanism's geometry (STRUCTURE), to the pose of the base (BASE), to the reflector's place on the
platform (REFLECTOR) or to the tracker's reading (MEASUREMENT). Its `law` gives the amount. The law
is written once, in symbols, for one term (a joint, a dimension, the reading): a function of
signals of the sample (angle, rate, torque, temperature, ...), of the effect's parameters v and of
constants. Simulator, fit, verdict and compensator evaluate code generated from it, with its
derivatives by v. A quantity that is no parameter (a frequency, a time constant, the moment of a
step) is a field of the effect; these fields are its shape, and `shapes` yields those worth trying.

Each effect has its own file; a line in `catalogue.py` makes it known everywhere.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from functools import cache
from itertools import accumulate, chain, pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.effects.demo import Demo
from delta_calibration.effects.regressor import ANGLE, Groups, Regressor, all_together
from delta_calibration.effects.remedy import AS_FOUND, Remedy
from delta_calibration.effects.signals import (
    LOAD,
    OF_PULLING,
    Places,
    Signals,
    asked_of,
    nominal,
    recorded,
    standing_asked,
)
from delta_calibration.mechanisms import Mechanism
from delta_calibration.model import chain_constants, terms
from delta_calibration.model.law import Law
from delta_calibration.model.terms import Table, Term, table_of
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.robot import Robot

Array = NDArray[np.float64]
Setting = float | str | tuple[float, ...]
Limits = Mapping[str, tuple[float, float]]
Interval = tuple[str, float, float]

# unit for joints that turn: unit for joints that slide, and power of the joint size to convert by
_SLIDING = {"rad/(N m)": ("m/N", 2), "N m": ("N", -1)}
SENSOR = "sensor"  # the setting that names the part whose thermometer an effect uses
SPREAD = 5.0  # an effect may well be this many times its typical size; twenty is not expected


class Stage(Enum):
    """Stage of the chain at which an effect adds, and the shape of its columns for n samples."""

    DRIVE = "joint angle"  # (n, m, k)
    STRUCTURE = "geometry"  # (n, p, k)
    BASE = "place of the base"  # (n, 6, k) shift [m] and turn [rad], in the base
    REFLECTOR = "place of the reflector"  # (n, 3, k) shift [m], in the platform
    MEASUREMENT = "reading"  # (n, 3, k)


@dataclass(frozen=True)
class Effect(ABC):
    """Base of all effects; its fields after `mechanism` are its shape."""

    cause: ClassVar[str]  # one of the fixed names
    remedy: ClassVar[Remedy] = AS_FOUND  # what to do about it
    kind: ClassVar[str]  # drive, structure or measurement, as reported; unknown, of a map
    stage: ClassVar[Stage]
    # whether it can be any smooth function of its variable, so that it may imitate other causes
    free_form: ClassVar[bool] = False
    # whether each of its `functions` moves all rows of its stage
    by_functions: ClassVar[bool] = False
    asks_pose: ClassVar[bool] = False  # whether the answer of `missing` depends on the pose too
    # whether a tool motion changes it by hundredths of that motion only: no steps, no steep slopes
    gentle: ClassVar[bool] = False
    valley: ClassVar[bool] = False  # whether data fix only a combination of the searched fields
    limits: ClassVar[Limits] = {}  # smallest and largest value of each numeric setting
    # settings in the joints' unit: their limits are a Delta's, and widen with the joint size
    of_joints: ClassVar[tuple[str, ...]] = ()
    # measurement that separates it from its rivals if no motion of this cell alone can do so
    outside: ClassVar[str] = ""
    # quantity and function of the law (`found_law.py`) that describes the same error, if one does
    simplest: ClassVar[tuple[str, str] | None] = None
    yields: ClassVar[bool] = False  # whether it is the give of drives under their loads
    called: ClassVar[str] = ""  # its name in sentences; by default its cause, as words
    part: ClassVar[str] = ""  # part of the machine whose temperature drives it
    repeats: ClassVar[bool] = False  # whether a machine may have it more than once (`apart`)
    again_at_one_place: ClassVar[bool] = False  # whether all but the first are of single joints

    # For the simulator: settings of which only one can be given, and whether a value may be
    # negative where its bounds allow it. For the demonstrations: how they show the effect.
    one_of: ClassVar[tuple[str, ...]] = ()
    either_sign: ClassVar[bool] = True
    demo: ClassVar[Demo | None] = None
    live_strength: ClassVar[float] = 0.0  # in the Delta's live demonstration; 0: not shown

    robot: Robot
    mechanism: Mechanism

    @property
    @abstractmethod
    def parameters(self) -> ParameterSet:
        """Parameters: unit, expected size (prior about zero) and physical bounds of each."""

    @property
    def takes(self) -> tuple[str, ...]:
        """Names of the signals that one term of the law takes, see signals.py."""
        return ()

    @property
    def needs(self) -> tuple[str, ...]:
        """Conditions without which the effect cannot be evaluated."""
        return ()

    @property
    def alone(self) -> tuple[tuple[str, ...], ...]:
        """Groups of parameters that often act alone: each is tried as its own explanation."""
        return ()

    @staticmethod
    def law(s: Any, v: Any, c: Any) -> Any:
        """Amount that one term adds to its stage, in symbols (model/symbols.py).

        Args:
            s: signals of the term, as named by `takes`.
            v: parameters of the term.
            c: constants of the term.
        """
        raise NotImplementedError(s, v, c)

    def constants(self, joint: int) -> tuple[float, ...]:
        """Constants of a joint's term, derived from the shape."""
        del joint
        return ()

    @property
    def variant(self) -> str:
        """Suffix of the law's name, if the inputs of a term differ between mechanisms."""
        return ""

    def terms(self, places: Places) -> Iterator[Term]:
        """Evaluations of the law: one per joint, or one for the reading or the base's pose.

        A joint's term takes the joint's own number of each signal that joints have, all numbers
        of any other signal, its own parameters and the shared ones, and moves that joint.
        """
        every = {n: range(places.begin(n), places.begin(n) + places.count(n)) for n in self.takes}
        if self.on_readings:
            values = tuple(range(len(self.parameters)))
            signals = tuple(chain.from_iterable(every.values()))
            yield Term(signals, values, tuple(range(self.stage_size)), self.constants(0))
            return
        where = [p.location for p in self.parameters]
        for j in range(self.mechanism.joints):
            own = (None, f"{self.mechanism.limb}_{j + 1}")
            parts = (r[j : j + 1] if n in places.of_joints else r for n, r in every.items())
            values = tuple(i for i, place in enumerate(where) if place in own)
            yield Term(tuple(chain.from_iterable(parts)), values, (j,), self.constants(j))

    @property
    def on_readings(self) -> bool:
        """Whether it acts between the platform's pose in the base and the reading."""
        return self.stage in (Stage.BASE, Stage.REFLECTOR, Stage.MEASUREMENT)

    @property
    def about(self) -> Array:
        """Parameter values about which the effect is linearized, (k,)."""
        return np.zeros(len(self.parameters))

    @property
    def stage_size(self) -> int:
        """Number of quantities of its stage."""
        sizes = {
            Stage.DRIVE: self.mechanism.joints,
            Stage.STRUCTURE: len(self.mechanism.parameters),
            Stage.BASE: 6,
            Stage.REFLECTOR: 3,
            Stage.MEASUREMENT: 3,
        }
        return sizes[self.stage]

    def columns_of(
        self, signals: Signals, values: Array | None = None, by_stage: Array | None = None
    ) -> Array:
        """Derivatives by the parameters at each sample, (n, d, k).

        Args:
            signals: signals of the samples.
            values: parameters at which to differentiate, (k,); by default `about`.
            by_stage: derivative of the wanted quantity by the stage, (n, d, size of the stage); by
                default the stage itself is differentiated.
        """
        at = self.about if values is None else np.ascontiguousarray(values)
        return terms_of((self,), signals.places).columns(signals, at, by_stage)

    def functions(self, signals: Signals) -> Array:
        """Functions of the sample, (n, F), each of which moves all rows of the stage.

        For effects that are `by_functions`. The parameters are the weights of the rows, ordered
        function by function.
        """
        raise NotImplementedError(f"{self.cause} is not made of functions")

    @property
    def order(self) -> float | None:
        """Order of the effect if it is one wave of each joint's own angle; else None.

        The first half of the values are amplitudes of sines, one per joint, the others of cosines:
        see `waves`.
        """
        return None

    @property
    def stands(self) -> bool:
        """Whether it takes signals that require the machine's pose: pose, geometry, loads."""
        return standing_asked(self.takes)

    def nominal(self, at: Conditions) -> Signals:
        """Signals of the nominal machine under these conditions."""
        asked = _asked(self.mechanism, self.takes)
        if self.stage is Stage.MEASUREMENT or (not asked and not standing_asked(self.takes)):
            return recorded(self.mechanism, at)
        return nominal(self.robot, self.mechanism, at, asked)

    def columns(self, at: Conditions) -> Array:
        """Derivatives by the parameters for the nominal machine, see `columns_of`."""
        return self.columns_of(self.nominal(at))

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Yield the effect in each shape that such data could identify; by default itself."""
        del at
        yield self

    def forms(self) -> Iterator[Effect]:
        """Yield the effect in each form that has a law of its own; by default itself."""
        yield self

    @property
    def rarity(self) -> float:
        """How many times rarer than the usual shapes of its cause this one is, 1 or more."""
        return 1.0

    @property
    def at_one_place(self) -> bool:
        """Whether the effect in this shape acts at one joint: no search tries two together."""
        return False

    @property
    def question(self) -> Hashable:
        """Key of the shapes that are compared by what they explain, and pay for their number.

        Shapes with more values explain more in any case: if both kinds can be true, they have two
        keys, and are compared by their evidence.
        """
        return None

    def apart(self, other: Effect) -> bool:
        """Whether a machine can have the effect in this shape and in another one at once.

        A stand can be bumped twice, at two moments. Never true of effects that do not `repeats`.
        """
        del other
        return False

    def refinements(self, at: Conditions) -> Iterator[Effect]:
        """Yield the shapes tried once the cause was found; by default those of the search."""
        yield from self.shapes(at)

    def regressor(self, at: Conditions) -> Regressor:
        """Quantity that the effect depends on: horizontal axis of its picture in the report."""
        del at
        return ANGLE

    def groups(self, at: Conditions, joint: int) -> Groups:
        """Groups of samples with a colour each in its picture, for a joint's panel (index)."""
        del joint
        return all_together(at)

    def usual(self, thermometers: Collection[str]) -> dict[str, Setting]:
        """Default settings of the effect in a simulated machine.

        Args:
            thermometers: parts of the machine whose temperature is measured.
        """
        del thermometers
        return {}

    @property
    def moves_with(self) -> str | None:
        """Quantity that a smooth map without a cause depends on; None for a cause."""
        return None

    def intervals(self) -> tuple[Interval, ...]:
        """Searched fields, with bounds around this shape that contain the best shape."""
        return ()

    def jumps(self, name: str, at: Conditions) -> Array:
        """Values of a searched field at which the effect changes by leaps, (k,); none by default.

        Only those near its own value: moments within the motion in which a step was found.
        """
        del name, at
        return np.zeros(0)

    def bounded_intervals(self) -> tuple[Interval, ...]:
        """`intervals` cut to the limits of the settings, because a file can hold no more."""
        within = ((name, *self._within(name, low, high)) for name, low, high in self.intervals())
        return tuple((name, low, high) for name, low, high in within if low < high)

    def _within(self, name: str, low: float, high: float) -> tuple[float, float]:
        if name not in self.limits:
            return low, high
        least, most = self._limits(name)
        return max(low, least), min(high, most)

    # name and unit of the searched fields in a verdict; "rad" stands for the joints' unit
    told: ClassVar[Mapping[str, tuple[str, str]]] = {}

    @property
    def chosen(self) -> dict[str, str]:
        """Properties of the shape that a verdict states in words, by name; none by default."""
        return {}

    def as_told(self, name: str) -> tuple[str, str, float]:
        """Name and unit of a searched field in a verdict, and the factor that converts to it."""
        label, unit = self.told[name]
        return label, self.unit_of(unit), 1.0

    @property
    def follows(self) -> str:
        """Course that its values belong to, in words; empty if all shapes have the same one.

        Values of one cause that follow different courses, such as a ramp and a settling, have
        different meanings and cannot be compared.
        """
        return ""

    @property
    def per_hour(self) -> bool:
        """Whether its values are those of an hour, as of a ramp over time."""
        return False

    def told_unit(self, parameter: Parameter) -> str:
        """Unit of a parameter as it is told: of a ramp per hour.

        Calibration files hold the parameter's own unit, which is the same in every shape.
        """
        return f"{parameter.unit}/h" if self.per_hour else parameter.unit

    def refined(self, values: Array) -> Effect:
        """The effect in the shape that follows from these values of its parameters (k,)."""
        del values
        return self

    @property
    def undone(self) -> Effect:
        """The effect as a compensator takes it, evaluated at the wanted motion; usually itself.

        A corrected command moves at other speeds than the wanted motion. Only where an effect
        delays is the difference as large as its own second term.
        """
        return self

    def doubt(self) -> Effect | None:
        """Effect of one standard deviation of an input that is not known, or of a term left out.

        It has the same parameters as this effect and widens stated intervals (GUM, type B). None
        if there is nothing of the kind.
        """
        return None

    @property
    def suits(self) -> bool:
        """Whether the mechanism has the part that the effect acts on."""
        return True

    @property
    def unsuited(self) -> str:
        """Reason why the effect does not suit the mechanism."""
        return f"robot {self.robot.name} has no such part"

    def disguised(self, at: Conditions) -> tuple[str, str, str, str] | None:
        """A form of the cause that such data cannot show, or not apart from another cause.

        Returns:
            Its name, the cause that it is taken for or "none", the reason, and the measurement
            that would show it; None if there is no such form.
        """
        del at
        return None

    def same_signal_beside(
        self, most: Array, other: Effect, least: Array, at: Conditions
    ) -> tuple[str, str] | None:
        """Cause that has the same signal as this one in a machine that has the other one as well.

        Args:
            most: upper bound of each of this effect's values, 0 where it may not act, (k,).
            other: the other effect.
            least: lower bound of each of its values, 0 where it may not act.
            at: conditions of the poses at rest.

        Returns:
            Its name, and in words what separates both; None if there is no such cause.
        """
        del most, other, least, at
        return None

    def begins_with_payload(self, at: Conditions) -> bool:
        """Whether the effect sets in at the only change of payload, which may be its cause."""
        del at
        return False

    @classmethod
    def shaped(cls, robot: Robot, mechanism: Mechanism, settings: Mapping[str, Setting]) -> Effect:
        """Create the effect in the shape given by a file's settings."""
        shape: dict[str, Any] = dict(settings)
        return cls(robot, mechanism, **shape)

    @property
    def settings(self) -> dict[str, Setting]:
        """Fields that make up the shape, as stored in a file."""
        own = [f.name for f in fields(self) if f.name not in ("robot", "mechanism")]
        return {name: getattr(self, name) for name in own}

    def wrong(self) -> str:
        """Reason why the shape is invalid: setting, value, what is allowed; empty if valid."""
        for name in self.limits:
            low, high = self._limits(name)
            value = self.settings[name]
            if not (isinstance(value, float) and low <= value <= high):
                return f"{name}: {value} is not allowed; {low:g} to {high:g}"
        return ""

    def _limits(self, name: str) -> tuple[float, float]:
        """Smallest and largest value of a setting on this mechanism."""
        low, high = self.limits[name]
        if name not in self.of_joints:
            return low, high
        size = self.mechanism.joint_size
        return low * min(1.0, size), high * max(1.0, size)

    @property
    def lacking(self) -> str:
        """What the robot file does not state but the effect needs; empty if it states all."""
        return ""

    def missing(self, at: Conditions) -> str:
        """Reason why the effect cannot be evaluated under these conditions; empty if it can."""
        if "payload" in self.needs and not payload_known(at):
            return NO_PAYLOAD
        if "direction" in self.needs and not (at.direction != 0).any():
            return "the direction of the last motion is not known"
        for part in self.sensors:
            if part not in at.temperature_parts or not np.isfinite(at.of_part(part)).all():
                return f"the temperature of part {part!r} is not known"
        return ""

    @property
    def sensors(self) -> tuple[str, ...]:
        """Parts whose thermometers the effect uses."""
        own = self.settings.get(SENSOR)
        return (str(own),) if own else ()

    def remedied(self, lacking: str) -> str:
        """What to do about the condition that is `missing`."""
        if "known" in lacking:
            return f"record it: {' and '.join(self.needs)}"
        return "measure under conditions in which they differ"

    @property
    def bound_to_session(self) -> bool:
        """Whether it goes by the clock of its session, which means nothing in another."""
        return False

    @property
    def lasting(self) -> bool:
        """Whether the machine stays as this effect had changed it by the end of its session."""
        return True

    def outlasts(self, ended: float | None) -> bool:
        """Whether commands after its session are corrected for it.

        Args:
            ended: end of the session on its own clock [s]; None if not known.
        """
        return not self.bound_to_session or (self.lasting and ended is not None)

    def each_joint(
        self, name: str, unit: str, prior: float, lower: float = -np.inf, upper: float = np.inf
    ) -> ParameterSet:
        """One parameter per joint, `name` with the joint's number.

        Sizes are those of a Delta's joint, which turns; they are converted by the joint size.
        """
        unit, size = self._of_joints(unit)
        sizes = (size * prior, size * lower, size * upper)
        return _one_a_joint(
            self.cause, (name,), unit, sizes, self.mechanism.limb, self.mechanism.joints
        )

    def waves(self, prior: float, bound: float, count: int = 1) -> ParameterSet:
        """Amplitudes of one or two waves of each joint: the sines of all, then the cosines.

        Sizes are in radians of a Delta's joint; others have them times their joint size.
        """
        unit, size = self._of_joints("rad")
        sizes = (size * prior, -size * bound, size * bound)
        names, own = ("sine", "cosine", "second_sine", "second_cosine"), self.mechanism
        return _one_a_joint(self.cause, names[: 2 * count], unit, sizes, own.limb, own.joints)

    def unit_of(self, unit: str) -> str:
        """A unit of joints that turn, as it is for these joints."""
        return self._of_joints(unit)[0]

    def _of_joints(self, unit: str) -> tuple[str, float]:
        """Unit for these joints, and the number of it equivalent to one of a Delta's joint."""
        own = self.mechanism
        if own.joint_unit == "m" and unit in _SLIDING:
            sliding, power = _SLIDING[unit]
            return sliding, own.joint_size**power
        if not unit.startswith("rad"):
            return unit, 1.0
        return unit.replace("rad", own.joint_unit, 1), own.joint_size

    def shared(
        self, name: str, unit: str, prior: float, lower: float = -np.inf, upper: float = np.inf
    ) -> ParameterSet:
        """One parameter for the whole machine."""
        return ParameterSet((Parameter(name, unit, 0.0, prior, self.cause, None, lower, upper),))


NO_PAYLOAD = "the payload is not known"


def payload_known(at: Conditions) -> bool:
    """Whether mass and centre of the payload are known at all samples."""
    return bool(np.isfinite(at.payload).all() and np.isfinite(at.payload_centre).all())


@dataclass(frozen=True)
class StageTerms:
    """Compiled terms of some effects of one stage."""

    table: Table
    size: int  # of the stage
    asked: int  # loads that they need, see signals.py
    stands: bool  # whether they need the machine's pose
    laws: tuple[Law, ...]  # that were compiled for them

    def shifts(self, signals: Signals, values: Array) -> Array:
        """Sum of the effects with these values (k,) at every sample, (n, size)."""
        return np.asarray(terms.shifts(self.table, signals.rows, values, self.size))

    def firsts(self, signals: Signals, values: Array) -> Array:
        """Amount that each term adds to the first of the rows that it moves, (n, terms)."""
        return np.asarray(terms.firsts(self.table, signals.rows, values))

    def columns(self, signals: Signals, values: Array, by_stage: Array | None = None) -> Array:
        """Derivatives by the values (k,), (n, d, k), see `Effect.columns_of`."""
        through = np.eye(self.size)[None] if by_stage is None else np.ascontiguousarray(by_stage)
        return np.asarray(terms.columns(self.table, signals.rows, values, through))


def stages_of(effects: Sequence[Effect], each: Sequence[slice], places: Places) -> Any:
    """Compiled effects of all stages before the reading, whose values are parts of theta."""
    stages = (Stage.DRIVE, Stage.STRUCTURE, Stage.BASE, Stage.REFLECTOR)
    tables = [table_of_stage(stage, effects, each, places) for stage in stages]
    at = np.array([places.begin(name) for name in chain_constants.NAMES])
    asked, stands = asked_of_stages(effects), standing_asked(_taken(effects))
    gentle = all(e.gentle for e in effects if standing_asked(e.takes))
    loaded = _loaded(effects[0].mechanism, tables, places) if effects else []
    return _stand().Stages(*tables, asked, np.array(loaded, dtype=np.int64), stands, gentle, at)


def asked_of_stages(effects: Sequence[Effect]) -> int:
    """Loads that the effects of all stages before the reading need."""
    return _asked(effects[0].mechanism, _taken(effects)) if effects else 0


def _loaded(mechanism: Mechanism, tables: Sequence[Any], places: Places) -> list[int]:
    """Indices, in a limb's law, of the dimensions whose load any term takes."""
    begin = places.begin(LOAD)
    taken = {int(signal) - begin for table in tables for signal in table.signal}
    of_limbs = (enumerate(limb.dimensions) for limb in mechanism.limbs)
    return sorted({i for limb in of_limbs for i, row in limb if row in taken})


def _taken(effects: Sequence[Effect]) -> list[str]:
    """Signals that the effects of all stages before the reading take."""
    return [n for e in effects if e.stage is not Stage.MEASUREMENT for n in e.takes]


def table_of_stage(
    stage: Stage, effects: Sequence[Effect], each: Sequence[slice], places: Places
) -> Table:
    """Terms of the effects of one stage, whose values are parts of theta (model/terms.py)."""
    here = [(e, part) for e, part in zip(effects, each, strict=True) if e.stage is stage]
    return table_of(_parts(here, places))


def _asked(mechanism: Mechanism, names: Iterable[str]) -> int:
    """Loads that these signals need; pulls exist only for limbs that can only pull."""
    of_pulls = () if mechanism.pulls else OF_PULLING
    return asked_of(name for name in names if name not in of_pulls)


def _parts(
    effects: Sequence[tuple[Effect, slice]], places: Places
) -> list[tuple[Law, tuple[Term, ...], int]]:
    """Law, terms and first index of the values of each effect."""
    parts = []
    for effect, part in effects:
        terms = tuple(effect.terms(places))
        if terms:
            parts.append((law_for(effect, terms[0]), terms, int(part.start)))
    return parts


def law_for(effect: Effect, term: Term) -> Law:
    """The law of an effect's terms; `term` is any of them, as all have the same sizes."""
    sizes = len(term.signals), len(term.values), len(term.constants), len(term.outputs)
    return law_of(effect.law, f"effect_{effect.cause}{effect.variant}", sizes)


def terms_of(effects: Sequence[Effect], places: Places) -> StageTerms:
    """Compile the terms of effects of one stage; their values are concatenated."""
    ends = accumulate((len(effect.parameters) for effect in effects), initial=0)
    spans = [slice(*span) for span in pairwise(ends)]
    parts = _parts(list(zip(effects, spans, strict=True)), places)
    names = [name for effect in effects for name in effect.takes]
    return StageTerms(
        table_of(parts),
        effects[0].stage_size if effects else 0,
        _asked(effects[0].mechanism, names) if effects else 0,
        standing_asked(names),
        tuple(law for law, _, _ in parts),
    )


@cache  # a search asks for the parameters of each effect thousands of times
def _one_a_joint(
    cause: str,
    names: tuple[str, ...],
    unit: str,
    sizes: tuple[float, float, float],
    limb: str,
    joints: int,
) -> ParameterSet:
    """Parameters of each name for each joint; `sizes`: prior, lower and upper bound."""
    prior, *bounds = sizes
    return ParameterSet(
        tuple(
            Parameter(f"{name}_{j}", unit, 0.0, prior, cause, f"{limb}_{j}", *bounds)
            for name in names
            for j in range(1, joints + 1)
        )
    )


@cache
def law_of(express: Callable[..., Any], name: str, sizes: tuple[int, int, int, int]) -> Law:
    """An effect's law; `sizes`: number of signals, parameters, constants and outputs."""
    groups = tuple(zip("svc", sizes[:3], strict=True))
    return Law(name, groups, sizes[3], express, full=("v",))


def _stand() -> Any:
    """Module of the compiled chain; imported late."""
    from delta_calibration.model import stand

    return stand
