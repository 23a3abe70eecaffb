"""`delta-cal sros2`: write the permissions of every node of the package as an SROS 2 policy."""

from __future__ import annotations

from pathlib import Path

import click

from delta_calibration.access import policy, rights
from delta_calibration.cli.options import write_or_print
from delta_calibration.cli.verb import OUTPUT, verb


@verb("sros2")
@click.option("--policy", "_", is_flag=True, help="Write the policy (XML, format 0.2.0).")
@click.option("--namespace", default="/", show_default=True, help="ROS namespace of the nodes.")
@click.option(
    "--controller",
    "controllers",
    multiple=True,
    help="Controller of ros2_control to which calibration_node sends; may be repeated.",
)
@click.option(
    "--trajectory-input",
    default="",
    help="Topic of the trajectories that calibration_node corrects.",
)
@click.option(
    "--operator/--no-operator",
    default=True,
    show_default=True,
    help="Whether the policy contains an operator, who may call services and set parameters.",
)
@click.option(
    "--out",
    type=OUTPUT,
    default=None,
    help="File to write; printed if not given.",
)
def command(
    _: bool,
    namespace: str,
    controllers: tuple[str, ...],
    trajectory_input: str,
    operator: bool,
    out: Path | None,
) -> None:
    """Write the SROS 2 policy: what each node may publish, subscribe to, serve and call.

    Everything else is denied. Each node is an enclave of its own, /delta_calibration/NODE, given
    to it by --enclave. Processes of the enclave `operator` may call the services of
    calibration_node and set its parameters. docs/security.md explains how keys are made from the
    policy.
    """
    text = policy(rights(controllers, trajectory_input, operator), namespace)
    write_or_print(out, text)
