"""What the closures of a real cable robot show to be missing in a model of its geometry.

The general diagnosis of 44 poses of motor angles, 9 of them with a position. The model contains
anchors and gains only, and all effects of the catalogue that apply to a cable robot are tried.
Four line lengths measured by hand at the origin are used in no fit and serve to check the result.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.cli.diagnose import describe
from delta_calibration.data import Conditions, at_rest
from delta_calibration.diagnosis import Judgement, Measured, Observed, diagnose_observations
from delta_calibration.diagnosis.candidates import columns_of
from delta_calibration.diagnosis.rivals import reached
from delta_calibration.effects.drum_build_up import DrumBuildUp
from delta_calibration.estimation.closures import ClosureAtPose, ClosureWithoutPose
from delta_calibration.mechanisms import CableRobot
from delta_calibration.report.candidates import evidence_figure
from delta_calibration.report.drawing import (
    BEFORE,
    CALIBRATED,
    EXTENDED,
    Axis,
    Figure,
    Panel,
    Points,
    Rule,
)
from delta_calibration.robot import Robot, load_robot
from hangprinter import BUILD_UP, BY_HAND, LINES, load

Array = NDArray[np.float64]

ROBOT = Path(__file__).with_name("hangprinter.yaml")
MM = 1e3
SIZE = 1e-3  # [m] noise of a closure relative to the others; its factor is estimated
APART = 60.0  # [s] between poses: their order is known, their time is not
PAYLOAD = 1.0  # [kg] of a second payload that could be attached


@dataclass(frozen=True)
class Machine:
    """The nominal machine, and what was measured."""

    robot: Robot
    mechanism: CableRobot
    joint: Array  # (n, 4) [rad]
    position: Array  # (n, 3) [m], NaN where not measured

    @classmethod
    def of(cls, folder: Path) -> Machine:
        """Load the machine as published in a folder."""
        robot = load_robot(ROBOT)
        mechanism = robot.commanded
        assert isinstance(mechanism, CableRobot)
        return cls(robot, mechanism, *load(folder))

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Whether each pose has a measured position, (n,)."""
        return np.isfinite(self.position).all(axis=1)

    @cached_property
    def measured(self) -> tuple[Measured, Measured]:
        """Closures at the poses with a position, and at the others."""
        return self._at(self.joint, self.position, self.seen)

    def without(self, build_up: float) -> tuple[Measured, Measured]:
        """The same with motor angles from which a build-up [m^2/m] is subtracted."""
        spiral = DrumBuildUp(self.robot, self.mechanism).columns(self.conditions(self.joint))
        return self._at(self.joint + build_up * spiral[..., 0], self.position, self.seen)

    def further(self) -> list[tuple[str, list[Measured]]]:
        """Further measurements that could be made, the cheapest first."""
        every, drawn = self.joint, self.mechanism.parameters.nominal
        place = self.mechanism.forward(every, drawn)
        all_seen = np.ones(len(every), dtype=bool)
        ten = np.arange(len(every)) < 10
        loaded = [self._with(m, PAYLOAD) for m in self._at(every[ten], place[ten], all_seen[ten])]
        return [
            ("measure the position of all 44 poses", [*self._at(every, place, all_seen)]),
            (f"measure ten positions with {PAYLOAD:g} kg hung on", loaded),
        ]

    def conditions(self, joint: Array) -> Conditions:
        """Conditions at rest, one pose after the other, without payload."""
        n = len(joint)
        return replace(
            at_rest(joint),
            time=APART * np.arange(n),
            payload=np.zeros(n),
            payload_centre=np.zeros((n, 3)),
        )

    def _at(self, joint: Array, place: Array, seen: NDArray[np.bool_]) -> tuple[Measured, ...]:
        at = self.conditions(joint)
        known = ClosureAtPose(joint[seen], place[seen], self.mechanism.joints, SIZE)
        redundant = self.mechanism.joints - self.mechanism.pose_size
        parts = [Measured(known, at.take(seen), timed=False)]
        if not seen.all():
            alone = ClosureWithoutPose(joint[~seen], redundant, SIZE)
            parts.append(Measured(alone, at.take(~seen), timed=False))
        return tuple(parts)

    def _with(self, measured: Measured, payload: float) -> Measured:
        at = measured.at
        return replace(measured, at=replace(at, payload=np.full(len(at), payload)))


def verdict(machine: Machine) -> Judgement:
    """The general diagnosis, without any prior information on the cause."""
    return diagnose_observations(
        machine.measured,
        machine.mechanism,
        machine.robot,
        stated=False,
        further=machine.further(),
    )


def fits(machine: Machine, found: Judgement) -> dict[str, Observed]:
    """Geometry alone; with the build-up of the machine's file; with the diagnosed effects."""
    model = found.model
    assert isinstance(model, Observed)
    mechanism = machine.mechanism
    return {
        "geometry": Observed.of(mechanism, machine.measured, stated=False),
        "stated": Observed.of(mechanism, machine.without(BUILD_UP), stated=False),
        "verdict": model,
    }


def likeness(found: Judgement) -> dict[str, float]:
    """Cosine of the first finding's signal with its best imitation by other causes, nearest first.

    From 0.95 on the verdict puts both into one class.
    """
    model = found.model
    evidence, (term, *_) = model.evidence, model.terms
    signal = columns_of(term, evidence) @ model.scaled(term)
    weighed = evidence.weigh(signal[:, None])[:, 0]
    near: dict[str, float] = {}
    for score in found.found.first.scores:
        candidate = score.candidate
        if candidate.unexplained or candidate.same_name(term):
            continue
        columns = columns_of(candidate, evidence)
        share = reached(evidence.information(columns), columns.T @ weighed) / (signal @ weighed)
        near[candidate.cause] = max(near.get(candidate.cause, 0.0), float(np.sqrt(share)))
    return dict(sorted(near.items(), key=lambda item: -item[1]))


def missed(fit: Observed) -> Array:
    """Residual length of each number, (N,) [m]; combined over the lines of a free pose."""
    return fit.beside.missed(fit.beside.best())[:, 0]


def line_rms(fit: Observed) -> float:
    """Root mean square over all lines of all poses [m]; a free pose absorbs three of four."""
    lines = sum(m.at.joint.size for m in fit.problem.measured)
    return float(np.sqrt(np.nansum(missed(fit) ** 2) / lines))


def by_hand(fit: Observed) -> Array:
    """Identified minus hand-measured line lengths at the origin, (4,) [m]."""
    anchors = fit.theta[:16].reshape(4, 4)[:, :3]
    return np.linalg.norm(anchors, axis=1) - BY_HAND


def by_hand_std(fit: Observed) -> Array:
    """Standard errors of the identified lengths, (4,) [m]."""
    anchors = fit.theta[:16].reshape(4, 4)[:, :3]
    away = anchors / np.linalg.norm(anchors, axis=1)[:, None]
    prior = fit.bare.parameters.prior[:16]
    covariance = prior[:, None] * fit.beside.covariance()[:16, :16] * prior
    blocks = covariance.reshape(4, 4, 4, 4)[np.arange(4), :3, np.arange(4), :3]
    return np.sqrt(np.einsum("ij,ijk,ik->i", away, blocks, away))


_STYLES = {
    "geometry": ("geometry alone", BEFORE, "diamond"),
    "stated": ("build-up as stated", CALIBRATED, "circle"),
    "verdict": ("build-up as found", EXTENDED, "square"),
}


def figures(machine: Machine, found: Judgement) -> list[Figure]:
    """Figures: evidence, residuals along line D, and the lengths measured by hand."""
    each = fits(machine, found)
    return [
        replace(evidence_figure(found), name="hangprinter_evidence"),
        _left_figure(each),
        _hand_figure(each),
    ]


def _left_figure(each: dict[str, Observed]) -> Figure:
    panels = []
    for key in ("geometry", "verdict"):
        fit, (name, colour, symbol) = each[key], _STYLES[key]
        turns = fit.evidence.at.joint[:, 3] / (2 * np.pi)
        points = Points("", turns, MM * missed(fit), colour, symbol, 6.0)
        panels.append(
            Panel(
                f"{name}: {MM * line_rms(fit):.2f} mm RMS a line",
                Axis("motor turns of line D [1]"),
                Axis("closure missed by [mm]", low=-6.0, high=6.0),
                (points, Rule("", 0.0)),
            )
        )
    return Figure(
        "hangprinter_left",
        "What the lines miss of each other",
        "Left of the closures, one number for a pose that nobody measured, four for one measured.",
        tuple(panels),
    )


def _hand_figure(each: dict[str, Observed]) -> Figure:
    marks = []
    for i, (key, fit) in enumerate(each.items()):
        name, colour, symbol = _STYLES[key]
        place = np.arange(4.0) + 0.15 * (i - 1)
        value, error = MM * by_hand(fit), 1.96 * MM * by_hand_std(fit)
        marks.append(Points(name, value, place, colour, symbol, 8.0, error))
    return Figure(
        "hangprinter_by_hand",
        "Line lengths at the origin against those measured by hand",
        "Taken part in no fit; with the fits' own 95 % intervals.",
        (
            Panel(
                "",
                Axis("identified less measured by hand [mm]"),
                Axis("line", names=tuple(LINES)),
                (*marks, Rule("", 0.0, upright=True)),
            ),
        ),
        columns=1,
    )


def report(root: Path, out: Path | None) -> list[Figure]:
    """Print all results; write the verdict as JSON into a folder."""
    machine = Machine.of(root)
    found = verdict(machine)
    print("Hangprinter, closures of 44 poses, 9 of them measured")
    print(describe(found.verdict, "one closure", "closure"))
    print("how much like the first finding another cause could be, cosine beside geometry:")
    print(f"  {', '.join(f'{cause} {cosine:.2f}' for cause, cosine in likeness(found).items())}")
    for key, fit in fits(machine, found).items():
        print(f"{_STYLES[key][0]}: {MM * line_rms(fit):.3f} mm RMS a line", end="; by hand")
        told = zip(LINES, MM * by_hand(fit), 1.96 * MM * by_hand_std(fit), strict=True)
        print(f" [mm] {', '.join(f'{n} {v:+.1f} +- {s:.1f}' for n, v, s in told)}")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        text = json.dumps(found.verdict.as_dict(), indent=2)
        (out / "hangprinter_verdict.json").write_text(f"{text}\n", encoding="utf-8")
    return figures(machine, found)
