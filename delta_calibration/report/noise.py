"""Noise of the tracker and the joints in a session, compared with the specified noise."""

from __future__ import annotations

import numpy as np

from delta_calibration.data import Poses
from delta_calibration.estimation.noise import Noise
from delta_calibration.report.document import Table
from delta_calibration.report.drawing import CALIBRATED, PAPER, Axis, Figure, Line, Panel, Points
from delta_calibration.robot import Robot
from delta_calibration.wording import figures

UM = 1e6
_ENOUGH = 5  # smallest number of readings of a still moment for its scatter


def noise_figure(poses: Poses, robot: Robot) -> Figure | None:
    """Figure of the scatter of single readings at rest along and across the beam, or None."""
    several = np.flatnonzero(poses.count >= _ENOUGH)
    if not several.size:
        return None
    point = poses.point[several]
    distance = np.linalg.norm(point, axis=1)
    beam = point / distance[:, None]
    scatter = poses.scatter[several]
    along = np.einsum("ni,nij,nj->n", beam, scatter, beam)
    across = (np.trace(scatter, axis1=1, axis2=2) - along) / 2
    course = np.linspace(distance.min(), distance.max(), 50)
    panels = tuple(
        Panel(
            f"{way} the beam",
            Axis("distance from the tracker [m]"),
            Axis("one reading, std [µm]"),
            (
                Points("still moments", distance, UM * np.sqrt(np.maximum(found, 0)), CALIBRATED),
                Line("specified", course, UM * filed, PAPER, "dash"),
            ),
        )
        for way, found, filed in zip(
            ("along", "across"), (along, across), robot.tracker.sigmas(course), strict=True
        )
    )
    return Figure(
        "noise",
        "Noise against the tracker's specification",
        f"Standard deviation of a single reading within each of {len(several)} still moments; "
        "dashed: the robot file's tracker.",
        panels,
    )


def noise_table(noise: Noise, poses: Poses, robot: Robot) -> Table:
    """Table of the noise: specified, found and their ratio, and the noise of a pose."""
    tracker = robot.tracker
    distance = np.linalg.norm(poses.point, axis=1)
    along, across = (float(np.mean(s)) for s in tracker.sigmas(distance))
    repeat = robot.joints.repeatability
    rows = [
        ("one reading, along the beam [µm]", UM * along, noise.radial_scale),
        ("one reading, across the beam [µm]", UM * across, noise.transverse_scale),
        ("repeatability of the joints [µrad]", UM * repeat, noise.repeatability / repeat),
    ]
    measured = [(n, figures(s), figures(s * f), f"{f:.2f}") for n, s, f in rows]
    if noise.measured:
        origin = f"from repeats, {noise.degrees} degrees of freedom"
    elif noise.raised > 1.0:
        origin = "from the residuals, which follow nothing: too few repeats"
    else:
        origin = "computed from the specification: too few repeats"
    return Table(
        "noise_table",
        "Noise in numbers",
        ("one standard deviation", "specified", "found", "found / specified [1]"),
        tuple(measured),
        f"Distance from the tracker {distance.min():.2f} to {distance.max():.2f} m. Noise "
        f"of a pose: {1e3 * noise.floor:.4f} mm RMS in 3-D ({origin}).",
    )
