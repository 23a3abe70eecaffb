"""The demonstration for machines other than the paper's Delta: in one process, against the truth.

The machine is measured, fitted, compensated and measured again; then once more with a hidden cause
that is typical of this kind of machine, which is found, named and compensated as well.
"""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from delta_calibration import __version__
from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import (
    from_identification,
    load_calibration,
    save_calibration,
)
from delta_calibration.cli.camera_demo import positioned_by_camera
from delta_calibration.cli.diagnose import describe as describe_verdict
from delta_calibration.cli.diagnose import diagnosed
from delta_calibration.cli.fit import describe
from delta_calibration.cli.hidden import hidden_and_found
from delta_calibration.cli.live_cell import Say
from delta_calibration.cli.options import progress, table, write_json
from delta_calibration.compensation import JointCompensator
from delta_calibration.data import Conditions, collect, motion_of, survey
from delta_calibration.effects import catalogue
from delta_calibration.effects.demo import Demo
from delta_calibration.errors import DataError
from delta_calibration.estimation import identify
from delta_calibration.plans import Plan, legs, make_plan
from delta_calibration.plans.named import motion_paths
from delta_calibration.recording import read_session, write_session
from delta_calibration.robot import Robot
from delta_calibration.simulation import (
    TrueMachine,
    draw_machine,
    effect_options,
    simulate_session,
    standing,
)
from delta_calibration.trial import Errors, true_misses

Array = NDArray[np.float64]
Rows = list[tuple[str, ...]]

_STOPS = 40  # of the first measurement
_TRIED = 40  # places of the trial
_CIRCLE = "circle_2.5_s"
_RATE = 50.0  # [1/s]
_EACH = 5  # every fifth sample of the circle is used
_FEWEST = 8
_HEAD = ("error against the truth", "max [mm]", "mean [mm]", "3 std [mm]")
_TURN = "turn, mean [mrad]"


def machine_demo(
    robot: Robot, called: str, out: Path, seed: int, method: str, say: Say
) -> dict[str, object]:
    """Run both acts; prints, writes into `out`, and returns the figures.

    `called` is the robot's name or file, as it was given.
    """
    trial = _moments(robot, seed + 1)
    summary: dict[str, object] = {"first_act": _first_act(robot, out, seed, method, trial, say)}
    if robot.camera is not None:
        say("positioning by a camera, without a model")
        summary["camera"] = positioned_by_camera(draw_machine(robot, seed), robot.camera, seed)
    summary["second_act"] = _second_act(robot, out, seed, method, trial, say)
    again = f"--robot {shlex.quote(called)} --seed {seed} --method {method}"
    click.echo(f"to repeat this run: delta-cal demo {again}\n")
    summary["provenance"] = {
        "package_version": __version__,
        "robot": robot.name,
        "robot_sha256": robot.hash,
        "seed": seed,
        "method": method,
    }
    return summary


def _first_act(
    robot: Robot, out: Path, seed: int, method: str, trial: Conditions, say: Say
) -> dict[str, object]:
    """First act: measure, fit and compensate the geometry."""
    machine = draw_machine(robot, seed)
    _measure(machine, make_plan("identify", robot, count=_STOPS, seed=seed), seed, out, "session")
    say("fitting")
    recorded = read_session(out / "session")
    poses = collect(recorded, robot.joints.names, robot.commanded.joint_size)
    found = identify(poses, robot)
    save_calibration(out / "calibration.yaml", found, robot, poses)
    calibration = load_calibration(out / "calibration.yaml", robot)
    click.echo("\n" + describe(found, verbose=False) + "\n")
    say(f"compensating by {method}")
    inside = _inside(calibration, method, trial)
    calibrated = _Trial.of("geometry compensated", calibration, machine, method, trial, inside)
    click.echo("\n" + _told(robot, [calibrated.before(), calibrated.after()]) + "\n")
    return calibrated.figures()


def _second_act(
    robot: Robot, out: Path, seed: int, method: str, trial: Conditions, say: Say
) -> dict[str, object]:
    """Second act: hide an effect of this kind of machine, then find and compensate it."""
    cause, shown = _shown(robot)
    say(f"second act: {cause} hidden in the machine")
    options = effect_options(f"{cause}:strength={shown.strength:g}")
    machine = draw_machine(robot, seed, 1.0, [options])
    plan = make_plan(shown.plan, robot, count=shown.count, seed=seed)
    _measure(machine, plan, seed, out, "session_2")
    say("diagnosing")
    recorded = read_session(out / "session_2")
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    found = diagnosed(seen, robot, None, 0, None)
    click.echo("\n" + robot.named(describe_verdict(found.verdict)) + "\n")
    save_calibration(out / "extended.yaml", found.identification, robot, seen.poses)
    write_json(out / "verdict.json", found.verdict.as_dict())
    extended = load_calibration(out / "extended.yaml", robot)
    plain = from_identification(identify(seen.poses, robot), robot, seen.poses)
    kept = {"geometry compensated": plain, "extended model": extended}
    inside = np.logical_and.reduce([_inside(c, method, trial) for c in kept.values()])
    by_geometry, by_all = (
        _Trial.of(name, c, machine, method, trial, inside) for name, c in kept.items()
    )
    rows = [by_geometry.before(), by_geometry.after(), by_all.after()]
    click.echo(_told(robot, rows) + "\n")
    named = [effect.cause for effect in extended.chain.effects]
    click.echo(f"hidden: {cause}; found: {', '.join(named) or 'nothing'}\n")
    click.echo(hidden_and_found(machine, out / "extended.yaml") + "\n")
    return {
        "hidden": cause,
        "found": named,
        "right": named == [cause],
        "calibrated": by_geometry.figures(),
        "extended": by_all.figures(),
    }


def _shown(robot: Robot) -> tuple[str, Demo]:
    """Cause to hide in this robot, and the settings of its demonstration.

    Raises:
        DataError: no effect that the robot can have has a demonstration.
    """
    effects = [e for e in catalogue(robot, robot.detailed) if not e.lacking]
    shown = [(effect.cause, effect.demo) for effect in effects if effect.demo is not None]
    if not shown:
        raise DataError(f"robot {robot.name}: no effect that it can have has a demonstration")
    return min(shown, key=lambda each: each[1].general)


class _Trial:
    """Errors of a machine at the moments of the trial, by nominal and by corrected commands."""

    def __init__(self, name: str, before: tuple[Array, Array], after: tuple[Array, Array]) -> None:
        self._name, self._before, self._after = name, before, after

    @classmethod
    def of(
        cls,
        name: str,
        calibration: Calibration,
        machine: TrueMachine,
        method: str,
        at: Conditions,
        inside: NDArray[np.bool_],
    ) -> _Trial:
        """Evaluate a calibration at the moments of the trial that the mask `inside` (n,) selects.

        Raises:
            DataError: too few moments lie within the calibrated region.
        """
        done = JointCompensator(calibration, method).compensate(at.joint, at)
        if inside.sum() < _FEWEST:
            raise DataError(
                f"{int(inside.sum())} of {len(at)} moments of the test are in the measured "
                f"region; {_FEWEST} are needed"
            )
        at, joint = at.take(inside), done.joint[inside]
        nominal = machine.robot.commanded
        meant = nominal.forward(at.joint, nominal.parameters.nominal)
        return cls(
            name,
            true_misses(calibration, machine, at, meant, True),
            true_misses(calibration, machine, replace(at, joint=joint), meant, False),
        )

    def before(self) -> tuple[str, ...]:
        """Row of the table without compensation."""
        return _row("not compensated, best-fit frame", *self._before)

    def after(self) -> tuple[str, ...]:
        """Row of the table with compensation."""
        return _row(self._name, *self._after)

    def figures(self) -> dict[str, object]:
        """Errors before and after, as data for files."""
        parts = {"before": self._before, "after": self._after}
        return {
            when: {**Errors.of(far).in_mm(), "mean_turn_mrad": float(turn.mean() * 1e3)}
            for when, (far, turn) in parts.items()
        }


def _inside(calibration: Calibration, method: str, at: Conditions) -> NDArray[np.bool_]:
    """Mask (n,) of the moments at which a calibration corrects in full."""
    done = JointCompensator(calibration, method).compensate(at.joint, at)
    inside = np.isfinite(done.model_error)
    return inside if done.share is None else inside & (done.share == 1.0)


def _told(robot: Robot, rows: Rows) -> str:
    """Rows as a table, with the rotation error if the joints command a rotation."""
    if max(robot.commanded.freedoms) >= 3:
        return table((*_HEAD, _TURN), rows) + (
            "\nthe positions of one reflector do not show the rotation of a tool on its flange "
            "or of a platform against its joints: it remains in the rotation error"
        )
    return table(_HEAD, [row[: len(_HEAD)] for row in rows])


def _row(name: str, far: Array, turn: Array) -> tuple[str, ...]:
    e = Errors.of(far)
    values = (e.maximum, e.mean, e.three_std, float(turn.mean()))
    return f"{name} ({e.points} moments)", *(f"{v * 1e3:.4f}" for v in values)


def _measure(machine: TrueMachine, plan: Plan, seed: int, out: Path, name: str) -> None:
    """Run a plan on the machine and record the session."""
    total = len(plan) + 2 * len(plan.paths)
    session = simulate_session(
        machine, plan, seed, source=name, follow=lambda way: progress(way, total, "stop")
    )
    robot = machine.robot
    made = {"made_by": f"delta-cal demo {__version__}", "seed": str(seed), "plan": plan.name}
    write_session(out / name, session, {**made, "robot": robot.name, "robot_sha256": robot.hash})


def _moments(robot: Robot, seed: int) -> Conditions:
    """Commanded conditions of the trial: stops at new places, and moments of a fast circle."""
    circle = tuple(path for path in motion_paths(robot) if path.name == _CIRCLE)
    plan = make_plan("identify", robot, count=_TRIED, both_sides=False, dwell=0.2, seed=seed)
    ways = list(legs(replace(plan, paths=circle), robot, _RATE))
    lengths = [len(way.time) for way in ways]
    begin = np.repeat(np.cumsum([0, *lengths[:-1]]) / _RATE, lengths)
    joint = np.concatenate([way.joint for way in ways])
    time = begin + np.concatenate([way.time for way in ways])
    motion = motion_of(time, joint, robot.commanded.joint_size)
    moving = np.concatenate([way.moving for way in ways])
    first = sum(lengths[:-1])
    stops = np.cumsum(lengths)[: len(plan)] - 1
    rows = np.concatenate([stops, first + np.flatnonzero(moving[first:])[::_EACH]])
    return replace(
        standing(joint[rows]),
        velocity=motion.velocity[rows] * moving[rows, None],
        acceleration=motion.acceleration[rows] * moving[rows, None],
        direction=motion.direction[rows],
        travel=motion.travel[rows],
    )
