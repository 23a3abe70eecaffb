"""`delta-cal printer`: identify a Delta printer from measurements saved by its firmware."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from delta_calibration.cli.options import table, write_text
from delta_calibration.cli.quantity import Quantity
from delta_calibration.cli.verb import OUTPUT, verb
from delta_calibration.estimation.measurements import (
    DistanceBetween,
    HeightAtContact,
    PlacedMachine,
)
from delta_calibration.estimation.mixed_measurements import MixedFit
from delta_calibration.estimation.printer import (
    Touched,
    endstops,
    fit_printer,
    left_out,
    printer,
)
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms.linear_delta import LinearDelta
from delta_calibration.recording.klipper import TOWERS, PrinterFile, read_printer
from delta_calibration.wording import listed, mm

Array = NDArray[np.float64]

_MM = 1e3


@verb("printer")
@click.argument("config", type=click.Path(path_type=Path))
@click.option(
    "--noise-um",
    type=Quantity(1.0, 10_000.0),
    default=75.0,
    show_default=True,
    help="Standard deviation of a measured height or distance [um].",
)
@click.option(
    "--data-alone",
    is_flag=True,
    help="Use the measurements alone, without the usual tolerances of a printer kit.",
)
@click.option("--out", type=OUTPUT, help="File to write the new entries to.")
def command(config: Path, noise_um: float, data_alone: bool, out: Path | None) -> None:
    """Identify the dimensions of a Delta printer from CONFIG, its Klipper printer.cfg.

    DELTA_CALIBRATE probes the bed; DELTA_ANALYZE adds distances on a printed part measured with a
    caliper; SAVE_CONFIG stores both at the end of the file. From them the radius, towers, endstops
    and arms are identified with standard errors. The output also says what the measurements leave
    undetermined, and how well each one is predicted from the others. CONFIG is not changed; --out
    writes the entries that replace the old ones.
    """
    given = read_printer(config)
    height = float(given.endstop.mean())
    machine = printer(given.radius, given.angle, float(given.arm.mean()), height)
    seen = _observations(given, 1e-6 * noise_um)
    now = _as_given(given, machine)
    found = fit_printer(machine, seen, priors=not data_alone)
    counts = ", ".join(f"{len(o.joint)} {o.kind}s" for o in seen)
    click.echo(f"{config}: {counts}")
    click.echo(_errors(seen, now, found, left_out(machine, seen, not data_alone)))
    click.echo("")
    click.echo(_dimensions(now, found))
    click.echo("")
    click.echo(
        f"determined by the measurements: {found.told:.1f} of {len(found.names)}; chi square per "
        f"degree of freedom {found.chi_square:.2f} of the stated noise"
    )
    if found.unset:
        click.echo(f"not determined: {listed(found.unset)}")
    if out is not None:
        write_text(out, _entries(found.machine.geometry))
        click.echo(f"written: {out}")


def _observations(given: PrinterFile, noise: float) -> list[Touched]:
    """Heights and distances, each kind only if there are any."""
    every: tuple[Touched, ...] = (
        HeightAtContact(given.at_height, given.height, noise),
        DistanceBetween(given.one, given.other, given.distance, noise),
    )
    return [o for o in every if len(o.joint)]


def _as_given(given: PrinterFile, machine: LinearDelta) -> PlacedMachine:
    """Machine with the dimensions that are configured in the firmware."""
    lean = np.sqrt(given.arm**2 - given.radius**2)
    dimensions = [given.radius, *given.angle, *(given.endstop + lean), *given.arm]
    return PlacedMachine.of(machine, np.array(dimensions), Frame.identity())


def _errors(seen: list[Touched], now: PlacedMachine, found: MixedFit, unseen: list[Array]) -> str:
    rows = [
        (
            f"{observation.kind}s",
            mm(_MM * _rms(observation.missed(now))),
            mm(_MM * _rms(observation.missed(found.machine))),
            mm(_MM * _rms(apart)),
        )
        for observation, apart in zip(seen, unseen, strict=True)
    ]
    return table(("RMS [mm]", "as configured", "identified", "each left out"), rows)


def _dimensions(now: PlacedMachine, found: MixedFit) -> str:
    """Table of the dimensions as in the firmware: radius, angles, endstops and arms."""
    free = [found.machine.chain.mechanism.parameters.row(name) for name in found.names]
    covariance = np.zeros((10, 10))
    covariance[np.ix_(free, free)] = found.covariance
    g = found.machine.geometry
    slope = np.eye(10)
    for i in range(3):
        lean = np.sqrt(g[7 + i] ** 2 - g[0] ** 2)
        slope[4 + i, 0], slope[4 + i, 7 + i] = g[0] / lean, -g[7 + i] / lean
    spread = np.sqrt(np.diag(slope @ covariance @ slope.T))
    rows = [
        (name, f"{_shown(value, unit):.3f}", f"{_shown(new, unit):.3f}", _error(std, unit), unit)
        for (name, unit), value, new, std in zip(
            _names(), _configured(now.geometry), _configured(g), spread, strict=True
        )
    ]
    return table(("entry", "as configured", "identified", "standard error", "unit"), rows)


def _entries(g: Array) -> str:
    """Sections of a printer.cfg with the identified dimensions."""
    values = [_shown(v, unit) for v, (_, unit) in zip(_configured(g), _names(), strict=True)]
    lines = ["[printer]", f"delta_radius: {values[0]:.6f}"]
    for i, tower in enumerate(TOWERS):
        angle, endstop, arm = (values[n + i] for n in (1, 4, 7))
        lines += ["", f"[stepper_{tower}]", f"angle: {angle:.6f}"]
        lines += [f"arm_length: {arm:.6f}", f"position_endstop: {endstop:.6f}"]
    return "\n".join(lines) + "\n"


def _configured(g: Array) -> Array:
    """Dimensions (10,) with the firmware's endstops instead of the heights of the carriages."""
    return np.concatenate([g[:4], endstops(g), g[7:]])


def _names() -> list[tuple[str, str]]:
    """Name and unit of each dimension, in the order of `_configured`."""
    own = (("angle", "deg"), ("position_endstop", "mm"), ("arm_length", "mm"))
    each = [(f"stepper_{tower} {name}", unit) for name, unit in own for tower in TOWERS]
    return [("printer delta_radius", "mm"), *each]


def _shown(value: float, unit: str) -> float:
    return float(np.degrees(value)) if unit == "deg" else _MM * value


def _error(std: float, unit: str) -> str:
    return f"{_shown(std, unit):.3f}" if std > 0 else "held"


def _rms(missed: Array) -> float:
    return float(np.sqrt(np.mean(missed**2)))
