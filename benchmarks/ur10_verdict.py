"""What a UR10's readings say is missing in a model of its geometry: the general diagnosis.

Tried is the catalogue, an error curve of each joint over its own angle, and joints that give way
to gravity. One harmonic for all joints (`transmission_error`) lies in the curves and is left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.cli.diagnose import describe
from delta_calibration.diagnosis import Judgement, Measured, diagnose_observations
from delta_calibration.effects import Effect, Stage, catalogue
from delta_calibration.effects.joint_curve import JointCurve
from delta_calibration.effects.signals import JOINT, Places
from delta_calibration.geometry import Frame
from delta_calibration.identification.observations import PointMeasured
from delta_calibration.mechanisms.serial_arm import SerialArm
from delta_calibration.model.symbols import Symbol, cos, dot, sin, where
from delta_calibration.model.terms import Term
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.report.drawing import (
    BEFORE,
    CALIBRATED,
    Axis,
    Figure,
    Line,
    Panel,
    Points,
    Rule,
)
from delta_calibration.robot import load_robot
from delta_calibration.samples import Conditions, at_rest
from real_ur10 import (
    KNOT,
    TOLERANCES,
    Gained,
    Left,
    Series,
    curve_of,
    levers,
    mounted,
    without_course,
)

Array = NDArray[np.float64]

ROBOT = load_robot("ur10")
POSES = 800  # of a series: all of them would say the same, in hours
NOISE = 0.1e-3 / np.sqrt(3)  # [m] each coordinate: the maker's repeatability of 0.1 mm
MOUNT = 10e-3  # [m, rad] about the mount that the poses themselves give
_LONG = 60  # characters of a line of the verdict beyond which weights are not printed
_CAUSES = ("curve_", "sag_")


@dataclass(frozen=True)
class GravitySag(Effect):
    """Joints 2, 3 and 4 turn by what hangs on them; masses and stiffness are not told apart."""

    cause: ClassVar[str] = "joint_compliance"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE

    @property
    def parameters(self) -> ParameterSet:
        """Turn [rad] by each lever."""
        zero = levers(np.zeros((1, self.mechanism.joints)))
        return ParameterSet(
            tuple(
                Parameter(f"sag_{j + 1}_{k}", "rad", 0.0, 0.1e-3, self.cause, f"joint_{j + 1}")
                for j, some in zero.items()
                for k in range(1, len(some) + 1)
            )
        )

    takes: ClassVar[tuple[str, ...]] = (JOINT,)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """v times a lever: the cosine of a sum of angles, some times the sine of the fifth."""
        turned = where(c[7] > 0, sin(s[4]), 1.0)
        return v[0] * cos(dot(c[0:6], s[0:6]) + c[6]) * turned

    def terms(self, places: Places) -> Iterator[Term]:
        """One for each lever of each joint, see `levers` of real_ur10.py."""
        first = places.begin(JOINT)
        signals = tuple(range(first, first + self.mechanism.joints))
        upper, fore, wrist = ((0.0, *(float(i < n) for i in range(5))) for n in (1, 2, 3))
        hand = [(*wrist, -np.pi / 2, 0.0), (*wrist, 0.0, 0.0), (*wrist, 0.0, 1.0)]
        arm = [(*upper, 0.0, 0.0), (*fore, 0.0, 0.0)]
        every = [(1, each) for each in (*arm, *hand)]
        every += [(2, each) for each in (arm[1], *hand)] + [(3, each) for each in hand]
        for row, (joint, constants) in enumerate(every):
            yield Term(signals, (row,), (joint,), constants)


def arm_before(series: Series) -> tuple[SerialArm, Frame]:
    """The drawing with the probe mounted as the poses have it, and where the base stands."""
    arm, frame = mounted(series)
    return SerialArm(arm.dimensions, replace(TOLERANCES, tool=MOUNT, mount=MOUNT)), frame


def conditions(series: Series) -> Conditions:
    """Still, nothing carried but the probe, the room's temperature."""
    n = len(series.joint)
    return replace(
        at_rest(series.joint),
        time=series.time - series.time[0],
        payload=np.zeros(n),
        payload_centre=np.zeros((n, 3)),
        temperature_parts=("room",),
        temperature=series.temperature[:, None],
    )


def candidates(arm: SerialArm, series: Series) -> list[Effect]:
    """What is tried."""
    known = [e for e in catalogue(ROBOT, arm) if e.cause != "transmission_error"]
    return [*known, JointCurve.over(ROBOT, arm, series.joint, KNOT), GravitySag(ROBOT, arm)]


def verdict(series: Series, poses: int = POSES) -> Judgement:
    """The diagnosis on some of a series' poses, drawn by chance and in their order."""
    n = min(poses, len(series.joint))
    rows = np.sort(np.random.default_rng(1).choice(len(series.joint), n, replace=False))
    some = series.take(rows)
    arm, frame = arm_before(series)
    point = PointMeasured(some.joint, some.point, np.zeros(3), NOISE)
    return diagnose_observations(
        [Measured(point, conditions(some))], arm, ROBOT, frame, effects=candidates(arm, some)
    )


def report(series: dict[str, Series], out: Path | None) -> dict[str, Judgement]:
    """Verdicts of all series, printed and, as JSON, into a folder."""
    found = {}
    for name, each in series.items():
        found[name] = verdict(each)
        print(f"UR10, series {name}: the general diagnosis on {POSES} of its poses")
        for line in describe(found[name].verdict).splitlines():
            print(f"  {line}" if not any(c in line for c in _CAUSES) else f"  {line[:_LONG]} ...")
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
            text = json.dumps(found[name].verdict.as_dict(), indent=2)
            path = out / f"ur10_{name.lower()}_verdict.json"
            path.write_text(f"{text}\n", encoding="utf-8")
    return found


def figures(lefts: dict[str, Left], gains: dict[str, list[Gained]]) -> list[Figure]:
    """Curves of joints by both series; what each extension gains on held-out blocks."""
    return [_curves(lefts), _gains(gains)]


_STYLES = {"A": (CALIBRATED, "solid", "circle"), "C": (BEFORE, "dash", "diamond")}


def _curves(lefts: dict[str, Left]) -> Figure:
    panels = []
    for joint in (0, 1, 2, 4):
        marks = []
        for name, left in lefts.items():
            low, high = np.quantile(left.series.joint[:, joint], [0.02, 0.98])
            at = np.linspace(low, high, 400)
            curve = without_course(curve_of(left, joint, at))
            colour, dash, _ = _STYLES[name]
            marks.append(Line(f"series {name}", np.degrees(at), 1e3 * curve, colour, dash))
        panels.append(
            Panel(
                f"joint {joint + 1}",
                Axis("commanded angle [deg]"),
                Axis("error [mrad]", low=-1.2, high=1.2),
                (*marks, Rule("", 0.0)),
            )
        )
    return Figure(
        "ur10_curves",
        "Error of each joint over its own angle, found in two series apart",
        "Less a fourth-order course, which other parameters share.",
        tuple(panels),
    )


def _gains(gains: dict[str, list[Gained]]) -> Figure:
    names = tuple(gained.name for gained in next(iter(gains.values())))
    marks = []
    for i, (series, each) in enumerate(gains.items()):
        colour, _, symbol = _STYLES[series]
        place = np.arange(float(len(names))) + 0.3 * (i - 0.5)
        value, half = (1e3 * np.array([getattr(g, of) for g in each]) for of in ("gain", "half"))
        marks.append(Points(f"series {series}", value, place, colour, symbol, 8.0, half))
    return Figure(
        "ur10_gains",
        "Gain of each extension on blocks of time held out",
        "Mean over ten blocks with its 95 % interval.",
        (
            Panel(
                "",
                Axis("RMS gained over geometry alone [mm]"),
                Axis("", names=names),
                (*marks, Rule("", 0.0, upright=True)),
                tall=1.3,
            ),
        ),
        columns=1,
    )
