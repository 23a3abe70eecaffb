"""`delta-cal fit`: identify the real geometry of the machine."""

from __future__ import annotations

import math
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from delta_calibration.calibration_file import save_calibration
from delta_calibration.cli.check import warn_of_mistakes
from delta_calibration.cli.kept import (
    known_machine_option,
    robot_given,
    sessions_of,
    store_option,
)
from delta_calibration.cli.options import (
    SESSION,
    counter,
    duration,
    force_option,
    model_option,
    require_folder,
    robot_or_machine_option,
    seed_option,
    table,
    topics_option,
    verbose_option,
)
from delta_calibration.cli.priors import population_in, priors_option
from delta_calibration.cli.verb import OUTPUT, verb
from delta_calibration.data import Poses, collect, survey
from delta_calibration.errors import InputError
from delta_calibration.estimation import Identification, doubts, identify, most_evaluations
from delta_calibration.papers import METHODS, ORDERS, method_named
from delta_calibration.recording import Topics, read_session
from delta_calibration.wording import mm, plain, set_aside

if TYPE_CHECKING:  # a fit alone need not load the libraries of a history
    from delta_calibration.history import Prospect

_FOR_PEOPLE = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "m/rad": (1e3, "mm/rad")}
_SHOWN = 5  # items of a long list that are shown without -v
_CLEAR = 3.0  # standard errors by which a parameter must differ from the drawing to be listed


@verb("fit")
@SESSION
@robot_or_machine_option
@known_machine_option("the results of its earlier sessions are used.")
@store_option
@click.option("--out", type=OUTPUT, default=None, help="Calibration file to write.")
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default=METHODS[0],
    show_default=True,
    help="Solver of the fit; docs/methods.md compares them. All minimise the same sum: whitened "
    "residuals with robust weights, and deviations of the parts weighted by their "
    "tolerances.",
)
@click.option(
    "--particles",
    type=click.IntRange(min=2),
    default=None,
    help="Number of particles of a swarm.  [default: 80, as in the five-axis paper]",
)
@click.option(
    "--iterations",
    type=click.IntRange(min=1),
    default=None,
    help="Iterations of each swarm search.  [default: 300, as in the five-axis paper; 120 along "
    "a single direction]",
)
@click.option(
    "--order",
    type=click.Choice(ORDERS),
    default=None,
    help="Order of the search of stepwise_qpso: one singular direction after the other "
    "(singular), or each parameter as soon as it has settled (settled, as in the five-axis "
    "paper).  [default: singular]",
)
@priors_option
@model_option
@seed_option
@topics_option
@force_option
@verbose_option("Also list all unidentified combinations and all strong correlations.")
def command(
    session: Path,
    robot_file: str | None,
    machine: str | None,
    url: str,
    out: Path | None,
    method: str,
    particles: int | None,
    iterations: int | None,
    order: str | None,
    priors_file: Path | None,
    model: str | None,
    seed: int,
    topics: tuple[str, ...],
    force: bool,
    verbose: bool,
) -> None:
    """Identify geometry, reflector offset and tracker frame from the still moments of SESSION.

    With --machine, the earlier sessions in the history of the machine say what to expect of its
    dimensions and of the effects found in it, so that few poses are enough
    (`delta-cal plan --update`). If something changed, what was known of it is dropped.
    """
    if out is not None:
        require_folder(out)
    chosen = method_named(method, particles, iterations, order)
    robot = robot_given(robot_file, machine, url)
    if priors_file is not None and machine is not None:
        raise InputError("give one of --priors and --machine")
    population = population_in(priors_file, robot, model)
    recorded = read_session(session, Topics.from_options(topics))
    warn_of_mistakes(recorded, robot, robot_file or str(robot.source), force, out is not None)
    poses = collect(recorded, robot.joints.names, robot.commanded.joint_size)
    expected, carried = None, None
    if machine is not None:
        from delta_calibration.history import Dated, prospect

        seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
        began = datetime.fromtimestamp(poses.start_ns * 1e-9, timezone.utc)
        new = Dated(session.resolve().name, began, seen)
        expected = prospect(sessions_of(machine, robot, url), robot, new, model)
        carried = expected.carried
    with counter(most_evaluations(chosen, robot, model), "machine") as count:
        found = identify(poses, robot, model, seed, chosen, count, carried, population)
    click.echo(describe_poses(poses, int(np.sum(found.weight == 0))))
    if expected is not None:
        click.echo(describe_carried(expected, session.resolve().name))
    click.echo(describe(found, verbose))
    if out is not None:
        save_calibration(out, found, robot, poses)
        click.echo(f"written: {out}")


def describe_poses(poses: Poses, weightless: int = 0) -> str:
    """Text on the readings of a session: poses at rest, places, readings set aside, notes.

    Args:
        poses: the poses.
        weightless: how many of them a robust fit gave no weight.
    """
    places = len(np.unique(poses.place))
    without = f"; without weight in the robust fit: {_poses(weightless)}" if weightless else ""
    aside = set_aside(poses.rejected.counts()) or "none"
    lines = [
        f"{Path(poses.source).name}: {poses.readings} readings in {duration(poses.duration)}, "
        f"{len(poses)} poses at rest in {places} places; set aside: {aside}{without}",
        *(f"note: {note}" for note in poses.notes),
    ]
    return "\n".join(lines)


def _poses(count: int) -> str:
    return "1 pose" if count == 1 else f"{count} poses"


def describe_carried(expected: Prospect, session: str) -> str:
    """Text on the prior knowledge that the fit takes from the history."""
    warning = [f"warning: {expected.doubt}"] if expected.doubt else []
    return plain("\n".join([*expected.sentences(session), *warning]))


def describe(found: Identification, verbose: bool) -> str:
    """Text of the fit's result for the user."""
    noise, seen = found.noise, found.observability
    origin = (
        f"from repeats, {noise.degrees} degrees of freedom"
        if noise.measured
        else "from the robot file"
    )
    lines = [
        f"noise of a pose: {mm(1e3 * noise.floor)} mm RMS in 3-D ({origin}); repeatability of "
        f"the joints {noise.repeatability * 1e6:.1f} u{found.chain.mechanism.joint_unit}; "
        f"tracker {noise.radial_scale:.2f} times its stated noise along the beam, "
        f"{noise.transverse_scale:.2f} times across",
        *_turned(found),
        f"model {found.chain.mechanism.name}: rank {seen.rank} of {seen.columns} parameters "
        "(including tracker frame and reflector offset)",
        f"method {found.effort.method}: {found.effort.evaluations} evaluations",
        "",
        _residuals(found),
        "",
        f"error left: {found.full.held_out / noise.floor:.2f} times the noise of a pose; "
        f"chi square per degree of freedom {found.chi_square:.2f}" + _weights(found),
        *(f"warning: {text}" for text in doubts(found)),
        *_deviations(found),
        *_unset(found, verbose),
        *_correlated(found, verbose),
    ]
    return "\n".join(lines)


def _weights(found: Identification) -> str:
    """How many poses the robust fit gave less weight, and no weight; empty if none."""
    down, gone = int(np.sum(found.weight < 1)), int(np.sum(found.weight == 0))
    if not down:
        return ""
    none = f", {gone} of them none" if gone else ""
    return f"; {_poses(down)} given less weight by the robust fit{none}"


def _turned(found: Identification) -> list[str]:
    """Line on the residual of measured orientations, if they were used."""
    if found.turn_missed is None:
        return []
    left = found.turn_missed * 1e6
    return [f"rotations of the probe were used; their residual is {left:.1f} urad RMS"]


def _residuals(found: Identification) -> str:
    rows = [
        (name, *(mm(1e3 * v) for v in (r.in_sample, r.held_out, r.held_out_max)))
        for name, r in (
            ("before: nominal + frame", found.frame_only),
            (f"calibrated: {_model(found)}", found.full),
        )
    ]
    return table(("3-D distance, RMS [mm]", "in sample", "error left", "largest left"), rows)


def _model(found: Identification) -> str:
    """Contents of the fitted model, named as in a verdict."""
    effects = (effect.cause for effect in found.chain.effects)
    return " + ".join(("geometry + frame", *effects))


def _deviations(found: Identification) -> list[str]:
    """Line on the parameters that differ clearly from the drawing, the clearest first."""
    geometry = found.chain.layout.geometry
    items = found.parameters.items[geometry]
    off = (found.theta - found.parameters.nominal)[geometry]
    ratio = np.abs(off) / found.std[geometry]
    clear = [int(k) for k in np.argsort(-ratio) if ratio[k] > _CLEAR]
    if not clear:
        return ["no single parameter differs clearly from the drawing"]
    parts = []
    for k in clear[:_SHOWN]:
        factor, unit = _FOR_PEOPLE.get(items[k].unit, (1.0, items[k].unit))
        value, std = off[k] * factor, found.std[k] * factor
        digits = _digits(std)
        parts.append(f"{items[k].name} {value:+.{digits}f} +- {std:.{digits}f} {unit}")
    more = f", and {len(clear) - _SHOWN} more" if len(clear) > _SHOWN else ""
    return [f"differs from the drawing: {', '.join(parts)}{more}"]


def _digits(std: float) -> int:
    """Decimals for a value with this standard error: three, or more to show its first digit."""
    return max(3, -math.floor(math.log10(std))) if std > 0.0 else 3


def _unset(found: Identification, verbose: bool) -> list[str]:
    redundancies = found.observability.redundancies
    if not redundancies:
        return []
    shown = redundancies if verbose else redundancies[:_SHOWN]
    rest = len(redundancies) - len(shown)
    return [
        f"{len(redundancies)} parameter combinations cannot be identified from these data; the "
        "tolerances determine them:",
        *(f"  {r.sentence()}" for r in shown),
        *([f"  and {rest} more (-v, or the calibration file)"] if rest else []),
    ]


def _correlated(found: Identification, verbose: bool) -> list[str]:
    pairs = found.correlations
    if not pairs:
        return []
    shown = pairs if verbose else pairs[:_SHOWN]
    rest = len(pairs) - len(shown)
    return [
        "strongly correlated estimates: "
        + ", ".join(f"{a} with {b} ({value:+.3f})" for a, b, value in shown)
        + (f", and {rest} more" if rest else "")
    ]
