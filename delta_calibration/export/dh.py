"""The identified dimensions of a serial arm as tables of Denavit and Hartenberg's parameters.

The same arm in the two ways of drawing lines between transforms, both with Hayati's angle beta
where neighbouring axes are parallel:

    modified (Craig)    A_i = R_x(alpha_i) R_y(beta_i) T_x(a_i) R_z(q_i + theta_i) T_z(d_i)
    standard (distal)   B_i = R_z(q_i + theta_i) T_z(d_i) R_x(alpha_i) R_y(beta_i) T_x(a_i)

The standard table begins with what leads from the base to the first axis, and its row i holds the
alpha, beta and a that lead to axis i + 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from delta_calibration.calibration import Calibration
from delta_calibration.errors import InputError
from delta_calibration.mechanisms import SerialArm

Link = Mapping[str, float]

_TO_AXIS = ("alpha_rad", "beta_rad", "a_m")
_CONVENTION = {
    "units": "metres and radians; a frame's z is its joint's axis, every turn is right-handed",
    "modified": "A_i = R_x(alpha) R_y(beta) T_x(a) R_z(q_i + theta) T_z(d); "
    "base to tool = A_1 ... A_m TOOL",
    "standard": "B_i = R_z(q_i + theta) T_z(d) R_x(alpha) R_y(beta) T_x(a); "
    "base to tool = R_x(alpha) R_y(beta) T_x(a) of `first`, B_1 ... B_m TOOL",
    "tool": "TOOL = T(place) R_z R_y R_x of the mount, then R_x R_y R_z of the turn",
    "sign_of_joints": "q_i is the commanded joint, positive by the right hand about z of frame i, "
    "as in the robot file. Of a controller that counts a joint the other way (some vendors do, of "
    "some joints), minus its angle is q_i; nothing else changes",
    "beta": "not zero only at neighbouring axes that are parallel as drawn, whose d is the "
    "drawing's. A controller without beta (tables of Universal Robots are standard and have none) "
    "says the same by other d and theta, far from the drawing's; leaving beta out is another arm",
}


def dh_tables(calibration: Calibration) -> dict[str, Any]:
    """A document with the tables of a calibrated arm, how to read them, and the drawing's.

    Effects beside the geometry are not in it; their names are.

    Raises:
        InputError: the machine is no serial arm.
    """
    arm, robot = calibration.chain.mechanism, calibration.robot
    if not isinstance(arm, SerialArm):
        raise InputError(
            f"robot {robot.name} is a {arm.name}; tables of Denavit and Hartenberg are of a "
            f"{SerialArm.name}"
        )
    found = _links(arm, calibration.geometry.tolist())
    drawn = _links(arm, arm.parameters.nominal.tolist())
    return {
        "robot": {"name": robot.name, "sha256": robot.hash},
        "calibration": {"sha256": calibration.seal, "session": calibration.source},
        "not_in_it": [effect.cause for effect, _ in calibration.live],
        "convention": _CONVENTION,
        "joints": list(robot.joints.names),
        "modified": [dict(link) for link in found],
        "standard": _standard(found),
        "tool": _tool(arm, calibration.geometry.tolist()),
        "drawing": {
            "modified": [dict(link) for link in drawn],
            "tool": _tool(arm, arm.parameters.nominal.tolist()),
        },
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


def _standard(links: Sequence[Link]) -> dict[str, Any]:
    """The same links with the lines drawn behind each joint."""
    last = dict.fromkeys(_TO_AXIS, 0.0)
    rows = [
        {**{name: here[name] for name in ("theta_rad", "d_m")}, **_to_axis(after)}
        for here, after in zip(links, [*links[1:], last], strict=True)
    ]
    return {"first": _to_axis(links[0]), "links": rows}


def _to_axis(link: Link) -> dict[str, float]:
    """What leads to a joint's axis."""
    return {name: link[name] for name in _TO_AXIS}


def _tool(arm: SerialArm, geometry: Sequence[float]) -> dict[str, list[float]]:
    """Place and turns of the tool in the last link."""
    given = dict(zip(arm.parameters.names, geometry, strict=True))
    return {
        "place_m": [given[f"tool_{axis}"] for axis in "xyz"],
        "mount_zyx_rad": [float(angle) for angle in arm.dimensions.mount],
        "turn_xyz_rad": [given[f"tool_turn_{axis}"] for axis in "xyz"],
    }
