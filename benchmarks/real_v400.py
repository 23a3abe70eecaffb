"""A linear Delta printer on three days: nine parameters from 19 data, and bed meshes."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.estimation.measurements import DistanceBetween, HeightAtContact
from delta_calibration.estimation.mixed_measurements import MixedFit
from delta_calibration.estimation.printer import Touched, fit_printer, left_out, printer

Array = NDArray[np.float64]

MEASURED = "2023-08-20_555230ee"  # the day with caliper distances
AUGUST = ("2023-08-20_41e2d223", MEASURED)
MARCH = "2024-03-10_acb53c76"
PRINTER = printer(0.160, np.radians([210.0, 330.0, 90.0]), 0.345, 0.415)
NOISE = 75e-6  # [m] of heights and distances: residual of the fit with its ten degrees of freedom
# A rotation about z changes no height and no distance: tower 3 is held at its nominal place.
NINE = np.array([name != "tower_angle_3" for name in PRINTER.parameters.names])


@dataclass(frozen=True)
class Mesh:
    """Probed height errors over the bed."""

    place: Array  # (n, 2) [m]
    error: Array  # (n,) [m]


def observations(folder: Path) -> list[Touched]:
    """Heights and, if there are any, distances of one day."""
    microstep = 1e-3 * np.array(_saved(folder)["microstep_mm"])
    heights = np.loadtxt(folder / "heights.csv", delimiter=",", skiprows=1)
    seen: list[Touched] = [
        HeightAtContact(heights[:, 1:] * microstep, heights[:, 0] * 1e-3, NOISE)
    ]
    if (folder / "distances.csv").exists():
        rows = np.loadtxt(folder / "distances.csv", delimiter=",", skiprows=1)
        one, two = rows[:, 1:4] * microstep, rows[:, 4:] * microstep
        seen.append(DistanceBetween(one, two, rows[:, 0] * 1e-3, NOISE))
    return seen


def fit(folder: Path, priors: bool) -> MixedFit:
    """Fit the nine parameters of a day."""
    return fit_printer(PRINTER, observations(folder), priors)


def mesh(folder: Path) -> Mesh:
    """Nodes inside the probed circle; the file repeats values outside it."""
    saved = _saved(folder)["mesh"]
    error = 1e-3 * np.loadtxt(folder / "mesh_z_error_mm.csv", delimiter=",")
    edge = float(saved["max_x"]) * 1e-3
    axis = np.linspace(-edge, edge, len(error))
    x, y = np.meshgrid(axis, axis)
    inside = np.hypot(x, y) <= edge * (1 + 1e-9)
    return Mesh(np.stack([x[inside], y[inside]], axis=1), error[inside])


def beyond_geometry(mesh: Mesh) -> Array:
    """Part of a mesh that the nine parameters cannot explain, (n,) [m]: bed or machine."""
    return _left(mesh.error, _heights_by_geometry(mesh))


def lean_share(mesh: Mesh, error: Array) -> float:
    """Share of the squares that straight towers leaning by constant angles can explain."""
    slope, joint = _heights_by_geometry(mesh), _joints(mesh)
    beside = joint - joint.mean(axis=0)  # position of each carriage about the middle of its travel
    lean = [_by_foot(mesh, axis) * beside for axis in (0, 1)]
    left = _left(error, np.column_stack([slope, *lean]))
    return float(1 - np.sum(left**2) / np.sum(error**2))


def bed_share(mesh: Mesh, error: Array, degree: int) -> float:
    """Share of the squares that a smooth bed, a polynomial of the position, can explain."""
    x, y = mesh.place.T / np.abs(mesh.place).max()
    powers = [x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)]
    left = _left(error, np.column_stack([_heights_by_geometry(mesh), *powers]))
    return float(1 - np.sum(left**2) / np.sum(error**2))


def threefold_share(mesh: Mesh, error: Array, fold: int = 3) -> float:
    """Share of the squares that a shape with `fold` lobes can explain, r^k cos and sin k phi."""
    x, y = mesh.place.T / np.abs(mesh.place).max()
    shape = (x + 1j * y) ** fold
    columns = np.column_stack([_heights_by_geometry(mesh), shape.real, shape.imag])
    left = _left(error, columns)
    return float(1 - np.sum(left**2) / np.sum(error**2))


def to_and_fro(mesh: Mesh, error: Array, sign: Array | None = None) -> float:
    """Share of the squares that depends on the rows' parity: they are probed back and forth.

    Args:
        mesh: nodes.
        error: (n,) [m].
        sign: of each row, used instead of its parity for comparison.
    """
    row = np.unique(np.round(mesh.place[:, 1], 6), return_inverse=True)[1]
    way = (-1.0) ** row if sign is None else sign[row]
    x = mesh.place[:, 0] / np.abs(mesh.place).max()
    left = _left(error, np.column_stack([way * x**power for power in range(4)]))
    return float(1 - np.sum(left**2) / np.sum(error**2))


def by_chance(mesh: Mesh, error: Array, draws: int = 500) -> float:
    """99 % quantile of the same share when the sign of each row is random."""
    rng = np.random.default_rng(1)
    rows = len(np.unique(np.round(mesh.place[:, 1], 6)))
    signs = rng.choice([-1.0, 1.0], (draws, rows))
    return float(np.quantile([to_and_fro(mesh, error, sign) for sign in signs], 0.99))


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def report(root: Path) -> None:
    """Print all results."""
    print("V400, nine parameters of 7 heights and 12 distances")
    for priors in (False, True):
        found = fit(root / MEASURED, priors)
        kind = "with priors" if priors else "data alone"
        heights, distances = found.rms(0) * 1e3, found.rms(1) * 1e3
        print(f"  {kind}: heights {heights:.4f} mm, distances {distances:.4f} mm RMS", end="; ")
        rank, weakest = found.observability.rank, found.observability.indices["O2"]
        print(f"rank {rank} of {len(found.names)}, weakest to strongest {weakest:.4f}")
        values = found.machine.geometry[NINE]
        for name, value, std, prior in zip(
            found.names, values, found.std, PRINTER.parameters.prior[NINE], strict=True
        ):
            unit, scale = ("deg", 180 / np.pi) if "angle" in name else ("mm", 1e3)
            told = max(0.0, 1 - (std / prior) ** 2)
            print(f"    {name:18s} {value * scale:9.3f} +- {std * scale:6.3f} {unit}", end="  ")
            print(f"prior {prior * scale:6.3f}  told {told:5.1%}")
        print(f"    told by the data {found.told:.2f} of 9,", end=" ")
        print(f"chi square {found.chi_square:.2f} per degree of freedom", end="; ")
        heights, distances = (
            1e3 * rms(each) for each in left_out(PRINTER, observations(root / MEASURED), priors)
        )
        print(f"each left out in turn: {heights:.3f}, {distances:.3f} mm RMS")
    meshes = [mesh(root / day) for day in AUGUST]
    one, two = (beyond_geometry(m) for m in meshes)
    print("V400, meshes beyond the nine parameters")
    correlation = np.corrcoef(one, two)[0, 1]
    stays, changes = (one + two) / 2, (one - two) / 2
    print(f"  August: {rms(one) * 1e3:.4f} and {rms(two) * 1e3:.4f} mm, correlation", end=" ")
    print(f"{correlation:.3f}; mean of both {rms(stays) * 1e3:.4f} mm", end=", ")
    print(f"half of what differs {rms(changes) * 1e3:.4f} mm", end=", ")
    print(f"own to one mesh {rms(changes) * np.sqrt(2) * 1e3:.4f} mm")
    march = mesh(root / MARCH)
    near = nearest(meshes[0], march)
    later = np.corrcoef(stays[near], beyond_geometry(march))[0, 1]
    print(f"  March 2024 ({len(march.error)} nodes): correlation with it {later:.3f}")
    lean = lean_share(meshes[0], stays)
    print(f"  of what stays: leaning towers could make {lean:.0%}", end=", ")
    shares = [f"{bed_share(meshes[0], stays, degree):.0%}" for degree in (3, 4, 6)]
    print(f"a smooth bed of degree 3, 4, 6: {', '.join(shares)}")
    lobes = [f"{threefold_share(meshes[0], stays, fold):.0%}" for fold in (2, 3, 4, 6)]
    print(f"  one shape of 2, 3, 4, 6 lobes: {', '.join(lobes)}")
    for name, error in (("first", one), ("second", two), ("what changes", changes)):
        share, chance = to_and_fro(meshes[0], error), by_chance(meshes[0], error)
        print(f"  {name}: {share:.0%} goes with the rows' parity", end=", ")
        print(f"by chance {chance:.0%} once in a hundred; {rms(error) * share**0.5 * 1e3:.4f} mm")


def nearest(mesh: Mesh, other: Mesh) -> NDArray[np.intp]:
    """For each node of `other` the index of the nearest node of `mesh`."""
    apart = np.linalg.norm(mesh.place[:, None] - other.place, axis=-1)
    return np.asarray(apart.argmin(axis=0))


def _joints(mesh: Mesh) -> Array:
    flat = np.column_stack([mesh.place, np.zeros(len(mesh.place))])
    return PRINTER.inverse(flat, PRINTER.parameters.nominal)


def _heights_by_geometry(mesh: Mesh) -> Array:
    joint, g = _joints(mesh), PRINTER.parameters.nominal
    x = PRINTER.forward(joint, g)
    return PRINTER.identification_jacobian(joint, x, g)[:, 2]


def _by_foot(mesh: Mesh, axis: int) -> Array:
    """Derivative of the height by the foot of each tower along x or y, (n, 3 towers)."""
    joint, g = _joints(mesh), PRINTER.parameters.nominal
    x = PRINTER.forward(joint, g)
    arms = PRINTER.closure_by_pose(joint, x, g)  # of |x - c|^2 by x; by c it is the opposite
    return np.asarray(np.linalg.inv(arms)[:, 2] * arms[:, :, axis])


def _left(error: Array, columns: Array) -> Array:
    unit = columns / np.linalg.norm(columns, axis=0)
    return np.asarray(error - unit @ np.linalg.lstsq(unit, error, rcond=1e-9)[0])


def _saved(folder: Path) -> dict:
    return json.loads((folder / "saved_geometry.json").read_text(encoding="utf-8"))
