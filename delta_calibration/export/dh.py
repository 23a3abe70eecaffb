"""Identified dimensions of a serial arm as tables of Denavit-Hartenberg (DH) parameters.

The same arm is written in both conventions, each with Hayati's angle beta where neighbouring axes
are parallel:

    modified (Craig)    A_i = R_x(alpha_i) R_y(beta_i) T_x(a_i) R_z(q_i + theta_i) T_z(d_i)
    standard (distal)   B_i = R_z(q_i + theta_i) T_z(d_i) R_x(alpha_i) R_y(beta_i) T_x(a_i)

The standard table begins with the transform from the base to the first axis; its row i has the
alpha, beta and a that lead to axis i + 1. The alpha and a of its last row are those of the drawing
if that is in standard DH, and its tool follows them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from delta_calibration.calibration import Calibration
from delta_calibration.errors import InputError
from delta_calibration.geometry import rotations
from delta_calibration.mechanisms import SerialArm

Link = Mapping[str, float]

X = np.array([1.0, 0.0, 0.0])
_TO_AXIS = ("alpha_rad", "beta_rad", "a_m")
_CONVENTION = {
    "units": "metres and radians; the z axis of a frame is the axis of its joint; all rotations "
    "are right-handed",
    "modified": "A_i = R_x(alpha) R_y(beta) T_x(a) R_z(q_i + theta) T_z(d); "
    "base to tool = A_1 ... A_m TOOL",
    "standard": "B_i = R_z(q_i + theta) T_z(d) R_x(alpha) R_y(beta) T_x(a); "
    "base to tool = R_x(alpha) R_y(beta) T_x(a) of `first`, B_1 ... B_m TOOL, with the TOOL of "
    "this table",
    "tool": "TOOL = T(place_m) R_z R_y R_x (angles mount_zyx_rad) R_x R_y R_z (turn_xyz_rad)",
    "sign_of_joints": "q_i is right-handed about z of frame i. From the reading of the drive, "
    "q_i = sign (reading - zero), see `drives`. If a controller counts a joint opposite to the "
    "drive, the reading is minus its angle; nothing else changes",
    "beta": "not zero only where neighbouring axes are nominally parallel; d keeps its nominal "
    "value there. A controller without beta (the tables of Universal Robots are standard DH "
    "without it) describes the same arm with other d and theta, far from the nominal ones; "
    "setting beta to zero gives a different arm",
}


def dh_tables(calibration: Calibration) -> dict[str, Any]:
    """Make a document with both DH tables of a calibrated arm, their conventions, and the drawing.

    Effects other than geometry are not in the tables; their names are listed.

    Raises:
        InputError: the machine is not a serial arm.
    """
    arm, robot = calibration.chain.mechanism, calibration.robot
    if not isinstance(arm, SerialArm):
        raise InputError(f"robot {robot.name} is a {arm.name}; DH tables need a {SerialArm.name}")
    return {
        "robot": {"name": robot.name, "sha256": robot.hash},
        "calibration": {"sha256": calibration.seal, "session": calibration.source},
        "not_in_it": list(calibration.live_causes),
        "convention": _CONVENTION,
        "joints": list(robot.joints.names),
        "drives": {
            "sign": [int(sign) for sign in arm.drives.sense],
            "zero_rad": arm.drives.zero.tolist(),
        },
        **_tables(arm, calibration.geometry.tolist()),
        "drawing": _tables(arm, arm.parameters.nominal.tolist()),
    }


def _tables(arm: SerialArm, geometry: Sequence[float]) -> dict[str, Any]:
    """Both DH tables for given dimensions (p,), each with its tool."""
    links = _links(arm, geometry)
    return {
        "modified": [dict(link) for link in links],
        "standard": {**_standard(arm, links), "tool": _behind(arm, _tool(arm, geometry))},
        "tool": _tool(arm, geometry),
    }


def _links(arm: SerialArm, geometry: Sequence[float]) -> list[Link]:
    """Rows of the modified table."""
    given = dict(zip(arm.parameters.names, geometry, strict=True))
    return [
        {
            "alpha_rad": given[f"twist_{i}"],
            "beta_rad": given.get(f"skew_{i}", 0.0),
            "a_m": given[f"length_{i}"],
            "theta_rad": given[f"zero_{i}"],
            "d_m": given.get(f"offset_{i}", float(drawn.offset)),
        }
        for i, drawn in enumerate(arm.dimensions.links, 1)
    ]


def _standard(arm: SerialArm, links: Sequence[Link]) -> dict[str, Any]:
    """Rows of the standard table, from those of the modified one."""
    last = dict(zip(_TO_AXIS, _last(arm), strict=True))
    rows = [
        {**{name: here[name] for name in ("theta_rad", "d_m")}, **_to_axis(after)}
        for here, after in zip(links, [*links[1:], last], strict=True)
    ]
    return {"first": _to_axis(links[0]), "links": rows}


def _last(arm: SerialArm) -> tuple[float, float, float]:
    """alpha [rad], beta [rad] and a [m] of the last row of the standard table."""
    twist, length = arm.drawn.behind
    return twist, 0.0, length


def _behind(arm: SerialArm, tool: dict[str, list[float]]) -> dict[str, list[float]]:
    """The tool after the last row of the standard table: R_x(-alpha) T_x(-a) TOOL."""
    twist, _, length = _last(arm)
    place = rotations.exp(-twist * X) @ (np.array(tool["place_m"]) - length * X)
    mount = [float(angle) for angle in arm.drawn.mount]
    return {**tool, "place_m": place.tolist(), "mount_zyx_rad": mount}


def _to_axis(link: Link) -> dict[str, float]:
    """alpha, beta and a, which lead to a joint's axis."""
    return {name: link[name] for name in _TO_AXIS}


def _tool(arm: SerialArm, geometry: Sequence[float]) -> dict[str, list[float]]:
    """Position and rotation angles of the tool in the frame of the last link."""
    given = dict(zip(arm.parameters.names, geometry, strict=True))
    return {
        "place_m": [given[f"tool_{axis}"] for axis in "xyz"],
        "mount_zyx_rad": [float(angle) for angle in arm.dimensions.mount],
        "turn_xyz_rad": [given[f"tool_turn_{axis}"] for axis in "xyz"],
    }
