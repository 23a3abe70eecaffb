"""Reasons for the choices of the table: other grids and splines with the same number of nodes.

    python benchmarks/table_choices.py

The largest error on the disc of benchmarks/table.py, with the same machines: nodes spaced evenly
in the joints or closer at their ends, evenly in the target's coordinates, and cubics of three
kinds. Places of the disc without a value are counted: a neighbouring node of the grid is out of
reach.
"""

from __future__ import annotations

import sys
from itertools import product

import numpy as np

from delta_calibration.compensation import Newton, NewtonSettings
from delta_calibration.compensation.table import BEND, Stamp, Table, nodes_between
from delta_calibration.plans import nominal_joints
from delta_calibration.robot import load_robot
from table import MACHINES, PLANE, RADIUS, disc, identified, machine

K, PAD = 15, 0.01  # nodes per axis; margin beyond the joints of the disc, relative to the box
EVEN = 1e-9  # parameter b of an even grid
MARGIN = 0.01  # [m] margin of a grid over the targets, around the disc
WAYS = (
    ("joints, closer at the ends", "splines"),
    ("joints, evenly", "splines"),
    ("joints, evenly", "Lagrange"),
    ("joints, evenly", "Catmull-Rom"),
    ("targets, evenly", "Lagrange"),
)
SETTINGS = NewtonSettings(bound_rad=0.2, iterations=40)


def weights(kind: str, t: np.ndarray) -> np.ndarray:
    """Weights of the four nodes around a position, t in 0...1 between the middle two, (4, n)."""
    if kind == "Catmull-Rom":
        parts = -t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2
        return np.stack(parts) / 2
    a, b, c = t + 1, t - 1, t - 2
    return np.stack([-t * b * c / 6, a * b * c / 2, -a * t * c / 2, a * t * b / 6])


def local(kind: str, values: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Cubics by the 64 nodes around u (n, 3) in steps; beyond the ends by cubic extrapolation."""
    for axis in range(3):
        v = np.moveaxis(values, axis, 0)
        first = 4 * v[0] - 6 * v[1] + 4 * v[2] - v[3]
        last = 4 * v[-1] - 6 * v[-2] + 4 * v[-3] - v[-4]
        values = np.moveaxis(np.concatenate([first[None], v, last[None]]), 0, axis)
    cell = np.clip(u.astype(int), 0, K - 2)
    w = np.stack([weights(kind, t) for t in (u - cell).T])
    found = np.zeros(u.shape)
    for i, j, k in product(range(4), repeat=3):
        here = values[cell[:, 0] + i, cell[:, 1] + j, cell[:, 2] + k]
        found += (w[0, i] * w[1, j] * w[2, k])[:, None] * here
    return found


def main() -> int:
    """Print the table."""
    robot = load_robot("srbd")
    nominal = robot.model("rotary_delta")
    drawn = nominal.parameters.nominal
    target = disc(30_000, 1)
    q = nominal_joints(robot, target)
    pad = PAD * np.ptp(q, axis=0)
    joints = q.min(axis=0) - pad, q.max(axis=0) + pad
    wide = np.array([RADIUS + MARGIN, RADIUS + MARGIN, MARGIN])
    space = np.array([0, 0, PLANE]) - wide, np.array([0, 0, PLANE]) + wide
    print(f"| {K} nodes an axis over | between them | largest error [um] | without a value |")
    print("|---|---|---|---|")
    for grid, kind in WAYS:
        errors, lacking = [], 0.0
        low, high = space if grid.startswith("targets") else joints
        bend = BEND if "closer" in grid else EVEN
        axes = nodes_between(low, high, np.linspace(-1, 1, K), bend)
        nodes = np.stack(np.meshgrid(*axes.T, indexing="ij"), axis=-1).reshape(-1, 3)
        start = nominal.inverse(nodes, drawn) if grid.startswith("targets") else nodes
        there = np.isfinite(start).all(axis=1)
        for model, seed in product(("rotary_delta", "six_rod_delta"), range(MACHINES)):
            known = machine(robot, model, seed)
            geometry = identified(known)
            meant = nominal.forward(start[there], drawn)
            dq = np.full_like(nodes, np.nan)
            dq[there] = Newton(geometry, SETTINGS).correct(start[there], meant).dq
            values, places = dq.reshape(K, K, K, 3), target if grid.startswith("targets") else q
            if kind == "splines":
                stamp = Stamp("", "", model, (0.0, 0.0, 0.0))
                table = Table(low, high, values, stamp, "newton", 1e-6, 0.0, 1, bend)
                found = table.at(places)
            else:
                found = local(kind, values, (places - low) / (high - low) * (K - 1))
            known_rows = np.isfinite(found).all(axis=1)
            off = geometry.point(q[known_rows] + found[known_rows]) - target[known_rows]
            errors.append(np.linalg.norm(off, axis=1).max())
            lacking = 1 - known_rows.mean()
        least, most = 1e6 * min(errors), 1e6 * max(errors)
        print(f"| {grid} | {kind} | {least:.2g} to {most:.3g} | {lacking:.0%} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
