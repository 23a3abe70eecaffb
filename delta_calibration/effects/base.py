"""What an effect is: one stage of the chain of measurement that a geometric model leaves out.

An effect adds to what a stage hands on: to the joint angles behind the encoders (DRIVE), to the
mechanism's geometry (STRUCTURE), to the place of the base (BASE) or to the tracker's reading
(MEASUREMENT). How much is its `law`,
written once, in symbols, for one term (a joint, a dimension, the reading): a function of signals
of the sample (angle, rate, torque, temperature, ...), of its parameters v and of constants.
Simulator, fit, verdict and compensator evaluate what is generated from it, derivatives by v among
it. What is no parameter (a frequency, a time constant, the moment of a step) is a field of the
effect: `shapes` gives the ones worth trying.

One file each; a line in `catalogue.py` makes an effect known everywhere.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
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

SENSOR = "sensor"  # the setting that names the part whose thermometer an effect goes by
SPREAD = 5.0  # an effect may well be so many times its typical size, twenty are not to be expected


class Stage(Enum):
    """Where in the chain an effect adds, and the shape of its columns for n samples."""

    DRIVE = "joint angle"  # (n, m, k)
    STRUCTURE = "geometry"  # (n, p, k)
    BASE = "place of the base"  # (n, 6, k) shift [m] and turn [rad], in the base
    MEASUREMENT = "reading"  # (n, 3, k)


@dataclass(frozen=True)
class Effect(ABC):
    """Base of all effects; its fields after `mechanism` are its shape."""

    cause: ClassVar[str]  # by the fixed names
    remedy: ClassVar[Remedy] = AS_FOUND  # what to do about it
    kind: ClassVar[str]  # drive, structure or measurement, as reported
    stage: ClassVar[Stage]
    # whether it is any function of what it moves with: what it could draw as well is a part of it
    free_form: ClassVar[bool] = False
    # whether it moves all rows of its stage by each of some `functions`
    by_functions: ClassVar[bool] = False
    asks_pose: ClassVar[bool] = False  # whether what is `missing` depends on the pose as well
    # whether it changes by hundredths of what it moves the tool by: no steps, no steep slopes
    gentle: ClassVar[bool] = False
    valley: ClassVar[bool] = False  # whether searched fields are set by one combination of them
    limits: ClassVar[Limits] = {}  # of settings that are numbers
    # those of them in the joints' unit: limits are a Delta's, and wider where its joints need it
    of_joints: ClassVar[tuple[str, ...]] = ()
    # what no more of the same cell's own motion can part it from, and what would
    outside: ClassVar[str] = ""
    called: ClassVar[str] = ""  # in sentences; by default its cause, as words
    part: ClassVar[str] = ""  # of the machine, whose temperature it goes with

    # What the simulator makes of it: settings of which only one can be given, whether a value may
    # as well be negative where its bounds allow that; and how the demonstrations show it.
    one_of: ClassVar[tuple[str, ...]] = ()
    either_sign: ClassVar[bool] = True
    demo: ClassVar[Demo | None] = None
    live_strength: ClassVar[float] = 0.0  # in the Delta's live demonstration; 0: not shown there

    robot: Robot
    mechanism: Mechanism

    @property
    @abstractmethod
    def parameters(self) -> ParameterSet:
        """What it is measured by: unit, expected size as prior about zero, physical bounds."""

    @property
    def takes(self) -> tuple[str, ...]:
        """Signals of a sample that one term of the law takes, see signals.py."""
        return ()

    @property
    def needs(self) -> tuple[str, ...]:
        """Conditions without which it cannot be evaluated."""
        return ()

    @property
    def alone(self) -> tuple[tuple[str, ...], ...]:
        """Names of parameters that often act without the others: explanations of their own."""
        return ()

    @staticmethod
    def law(s: Any, v: Any, c: Any) -> Any:
        """What one term adds to its stage, in symbols (model/symbols.py).

        Args:
            s: its signals, as `takes` names them.
            v: its parameters.
            c: its constants.
        """
        raise NotImplementedError(s, v, c)

    def constants(self, joint: int) -> tuple[float, ...]:
        """Constants of a joint's term: numbers of the shape."""
        del joint
        return ()

    @property
    def variant(self) -> str:
        """Of the law, where mechanisms differ in what a term takes."""
        return ""

    def terms(self, places: Places) -> Iterator[Term]:
        """What the law is evaluated on: once for each joint, or once for the reading.

        That of the base's place is one as well. A joint's term takes the joint's own of each
        signal that joints have and the whole of any other, its own parameters and those that all
        share, and moves that joint.
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
        """Whether it lies between the platform's pose in the base and the reading."""
        return self.stage in (Stage.BASE, Stage.MEASUREMENT)

    @property
    def about(self) -> Array:
        """Values about which the effect is linear, (k,): only of matter where it is not."""
        return np.zeros(len(self.parameters))

    @property
    def stage_size(self) -> int:
        """Numbers of its stage."""
        sizes = {
            Stage.DRIVE: self.mechanism.joints,
            Stage.STRUCTURE: len(self.mechanism.parameters),
            Stage.BASE: 6,
            Stage.MEASUREMENT: 3,
        }
        return sizes[self.stage]

    def columns_of(
        self, signals: Signals, values: Array | None = None, by_stage: Array | None = None
    ) -> Array:
        """Derivatives by the parameters at each sample, (n, d, k).

        Args:
            signals: of the samples.
            values: at which parameters, (k,); `about` where not given.
            by_stage: how what is derived goes with the stage, (n, d, size of the stage); the stage
                itself is derived where not given.
        """
        at = self.about if values is None else np.ascontiguousarray(values)
        return terms_of((self,), signals.places).columns(signals, at, by_stage)

    def functions(self, signals: Signals) -> Array:
        """Functions of the sample, (n, F), by each of which it moves all rows of its stage.

        Of an effect that is `by_functions`: its parameters are the weights of the rows, those of
        one function after those of another.
        """
        raise NotImplementedError(f"{self.cause} is not made of functions")

    @property
    def order(self) -> float | None:
        """Of the wave of each joint's own angle that it is, values as `waves` has them, or None.

        The first half of the values are of sines, each of a joint, the others of cosines.
        """
        return None

    @property
    def stands(self) -> bool:
        """Whether it takes anything of a machine that stands somewhere: pose, loads."""
        return standing_asked(self.takes)

    def nominal(self, at: Conditions) -> Signals:
        """The signals of the drawing's machine under these conditions."""
        asked = _asked(self.mechanism, self.takes)
        if self.stage is Stage.MEASUREMENT or (not asked and not standing_asked(self.takes)):
            return recorded(self.mechanism, at)
        return nominal(self.robot, self.mechanism, at, asked)

    def columns(self, at: Conditions) -> Array:
        """The same of the drawing's machine under these conditions."""
        return self.columns_of(self.nominal(at))

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """The same effect with each shape that such data could tell; itself alone by default."""
        del at
        yield self

    def forms(self) -> Iterator[Effect]:
        """The same effect in each form that has a law of its own; itself alone by default."""
        yield self

    def refinements(self, at: Conditions) -> Iterator[Effect]:
        """Shapes that are tried once the cause was found; those of the search by default."""
        yield from self.shapes(at)

    def regressor(self, at: Conditions) -> Regressor:
        """Quantity that gives it away: the horizontal axis of its picture in the report."""
        del at
        return ANGLE

    def groups(self, at: Conditions, joint: int) -> Groups:
        """Samples that its picture tells apart by colour, for the panel of a joint (index)."""
        del joint
        return all_together(at)

    def usual(self, thermometers: Collection[str]) -> dict[str, Setting]:
        """Settings that it has in a simulated machine where none are given.

        Args:
            thermometers: parts of the machine whose temperature is measured.
        """
        del thermometers
        return {}

    @property
    def moves_with(self) -> str | None:
        """What a map that claims no cause moves with; None for an effect that is a cause."""
        return None

    def intervals(self) -> tuple[Interval, ...]:
        """Searched fields, and the bounds within which the best shape lies about this one."""
        return ()

    def bounded_intervals(self) -> tuple[Interval, ...]:
        """The same as far as the limits of its settings reach: a file can hold no more."""
        within = ((name, *self._within(name, low, high)) for name, low, high in self.intervals())
        return tuple((name, low, high) for name, low, high in within if low < high)

    def _within(self, name: str, low: float, high: float) -> tuple[float, float]:
        if name not in self.limits:
            return low, high
        least, most = self._limits(name)
        return max(low, least), min(high, most)

    # what searched fields are called in a verdict, and their unit; the joints' for "rad"
    told: ClassVar[Mapping[str, tuple[str, str]]] = {}

    @property
    def chosen(self) -> dict[str, str]:
        """What a verdict says of the shape in words, by name; nothing by default."""
        return {}

    def refined(self, values: Array) -> Effect:
        """The same effect with the shape that these values of its parameters (k,) go with."""
        del values
        return self

    def doubt(self) -> Effect | None:
        """What a standard deviation of what its conditions leave open moves, a value a parameter.

        None where they are known well enough. It widens stated intervals (GUM, type B).
        """
        return None

    @property
    def suits(self) -> bool:
        """Whether the mechanism has what it acts on."""
        return True

    @property
    def unsuited(self) -> str:
        """Why it does not suit, where it does not."""
        return f"a {self.mechanism.name} has no such part"

    def disguised(self, at: Conditions) -> tuple[str, str, str, str] | None:
        """A form of the cause that such data show as something else, however well they were taken.

        Returns:
            What it is called, the cause that it is taken for, why, and what would tell; None where
            there is no such form.
        """
        del at
        return None

    @classmethod
    def shaped(cls, robot: Robot, mechanism: Mechanism, settings: Mapping[str, Setting]) -> Effect:
        """The effect in the shape of a file's settings."""
        shape: dict[str, Any] = dict(settings)
        return cls(robot, mechanism, **shape)

    @property
    def settings(self) -> dict[str, Setting]:
        """The fields that are its shape, as a file holds them."""
        own = [f.name for f in fields(self) if f.name not in ("robot", "mechanism")]
        return {name: getattr(self, name) for name in own}

    def wrong(self) -> str:
        """What its shape cannot be: setting, value, what is allowed; empty where it can be."""
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

    def missing(self, at: Conditions) -> str:
        """Why these conditions do not do to evaluate it; empty where they do."""
        known = np.isfinite(at.payload).all() and np.isfinite(at.payload_centre).all()
        if "payload" in self.needs and not known:
            return "the payload is not known"
        if "direction" in self.needs and not (at.direction != 0).any():
            return "the direction of the last motion is not known"
        return ""

    def remedied(self, lacking: str) -> str:
        """What to do about what is `missing`, so that it can be evaluated."""
        if "known" in lacking:
            return f"record it: {' and '.join(self.needs)}"
        return "measure under conditions in which they differ"

    @property
    def bound_to_session(self) -> bool:
        """Whether it goes by the clock of the session it was found in, and ends with it."""
        return False

    def each_joint(
        self, name: str, unit: str, prior: float, lower: float = -np.inf, upper: float = np.inf
    ) -> ParameterSet:
        """One parameter a joint, `name` with the joint's number.

        What is given in radians is of a joint that turns; of another as much as does the same.
        """
        unit, size = self._of_joints(unit)
        sizes = (size * prior, size * lower, size * upper)
        return _one_a_joint(
            self.cause, (name,), unit, sizes, self.mechanism.limb, self.mechanism.joints
        )

    def waves(self, prior: float, bound: float, count: int = 1) -> ParameterSet:
        """Amplitudes of one or two waves of each joint: the sines of all, then the cosines.

        In radians of a joint that turns; of another as much as does the same.
        """
        unit, size = self._of_joints("rad")
        sizes = (size * prior, -size * bound, size * bound)
        names, own = ("sine", "cosine", "second_sine", "second_cosine"), self.mechanism
        return _one_a_joint(self.cause, names[: 2 * count], unit, sizes, own.limb, own.joints)

    def unit_of(self, unit: str) -> str:
        """A unit with the joints' own in the place of the radian."""
        return self._of_joints(unit)[0]

    def _of_joints(self, unit: str) -> tuple[str, float]:
        """The unit for these joints, and how many of it do what one radian does."""
        if not unit.startswith("rad"):
            return unit, 1.0
        return unit.replace("rad", self.mechanism.joint_unit, 1), self.mechanism.joint_size

    def shared(
        self, name: str, unit: str, prior: float, lower: float = -np.inf, upper: float = np.inf
    ) -> ParameterSet:
        """One parameter for the whole machine."""
        return ParameterSet((Parameter(name, unit, 0.0, prior, self.cause, None, lower, upper),))


@dataclass(frozen=True)
class StageTerms:
    """What some effects of one stage do together, compiled."""

    table: Table
    size: int  # of the stage
    asked: int  # loads that they need, see signals.py
    stands: bool  # whether they need a machine that stands somewhere
    laws: tuple[Law, ...]  # that were compiled for them

    def shifts(self, signals: Signals, values: Array) -> Array:
        """What they add with these values (k,) at every sample, (n, size)."""
        return np.asarray(terms.shifts(self.table, signals.rows, values, self.size))

    def firsts(self, signals: Signals, values: Array) -> Array:
        """What each term adds to the first of the rows that it moves, (n, terms)."""
        return np.asarray(terms.firsts(self.table, signals.rows, values))

    def columns(self, signals: Signals, values: Array, by_stage: Array | None = None) -> Array:
        """Derivatives by their values (k,), (n, d, k), see `Effect.columns_of`."""
        through = np.eye(self.size)[None] if by_stage is None else np.ascontiguousarray(by_stage)
        return np.asarray(terms.columns(self.table, signals.rows, values, through))


def stages_of(effects: Sequence[Effect], each: Sequence[slice], places: Places) -> Any:
    """Effects of drives, structure and base, whose values stand in theta, as compiled."""
    stages = (Stage.DRIVE, Stage.STRUCTURE, Stage.BASE)
    tables = [table_of_stage(stage, effects, each, places) for stage in stages]
    at = np.array([places.begin(name) for name in chain_constants.NAMES])
    asked, stands = asked_of_stages(effects), standing_asked(_taken(effects))
    gentle = all(e.gentle for e in effects if standing_asked(e.takes))
    loaded = _loaded(effects[0].mechanism, tables, places) if effects else []
    return _stand().Stages(*tables, asked, np.array(loaded, dtype=np.int64), stands, gentle, at)


def asked_of_stages(effects: Sequence[Effect]) -> int:
    """Loads that the effects of drives, structure and base need."""
    return _asked(effects[0].mechanism, _taken(effects)) if effects else 0


def _loaded(mechanism: Mechanism, tables: Sequence[Any], places: Places) -> list[int]:
    """Parameters of a limb, by their places in its law, that any term takes the load of."""
    begin = places.begin(LOAD)
    taken = {int(signal) - begin for table in tables for signal in table.signal}
    of_limbs = (enumerate(limb.dimensions) for limb in mechanism.limbs)
    return sorted({i for limb in of_limbs for i, row in limb if row in taken})


def _taken(effects: Sequence[Effect]) -> list[str]:
    """Signals that the effects of drives, structure and base take."""
    return [n for e in effects if e.stage is not Stage.MEASUREMENT for n in e.takes]


def table_of_stage(
    stage: Stage, effects: Sequence[Effect], each: Sequence[slice], places: Places
) -> Table:
    """Terms of the effects of one stage, whose values stand in theta (model/terms.py)."""
    here = [(e, part) for e, part in zip(effects, each, strict=True) if e.stage is stage]
    return table_of(_parts(here, places))


def _asked(mechanism: Mechanism, names: Iterable[str]) -> int:
    """Loads that these signals need; pulls are of limbs that can do nothing else."""
    of_pulls = () if mechanism.pulls else OF_PULLING
    return asked_of(name for name in names if name not in of_pulls)


def _parts(
    effects: Sequence[tuple[Effect, slice]], places: Places
) -> list[tuple[Law, tuple[Term, ...], int]]:
    """Law, terms and begin of the values of each effect."""
    parts = []
    for effect, part in effects:
        terms = tuple(effect.terms(places))
        if terms:
            parts.append((law_for(effect, terms[0]), terms, int(part.start)))
    return parts


def law_for(effect: Effect, term: Term) -> Law:
    """The law of an effect's terms; `term` is any of them, their sizes are alike."""
    sizes = len(term.signals), len(term.values), len(term.constants), len(term.outputs)
    return law_of(effect.law, f"effect_{effect.cause}{effect.variant}", sizes)


def terms_of(effects: Sequence[Effect], places: Places) -> StageTerms:
    """The terms of effects of one stage; their values follow each other."""
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


@cache  # a search asks for those of each effect thousands of times
def _one_a_joint(
    cause: str,
    names: tuple[str, ...],
    unit: str,
    sizes: tuple[float, float, float],
    limb: str,
    joints: int,
) -> ParameterSet:
    """Each name with the number of each joint; prior, lower and upper bound of each."""
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
    """An effect's law; sizes of its signals, parameters, constants and outputs."""
    groups = tuple(zip("svc", sizes[:3], strict=True))
    return Law(name, groups, sizes[3], express, full=("v",))


def _stand() -> Any:
    """The compiled chain."""
    from delta_calibration.model import stand

    return stand
