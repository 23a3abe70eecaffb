"""`delta-cal sros2`: what every node of the package may do, as a policy for SROS 2."""

from __future__ import annotations

from pathlib import Path

import click

from delta_calibration.access import policy, rights
from delta_calibration.cli.options import write_or_print


@click.command("sros2", short_help="what the nodes may do, as a policy for SROS 2")
@click.option("--policy", "wanted", is_flag=True, help="Write the policy (XML, format 0.2.0).")
@click.option("--namespace", default="/", show_default=True, help="Namespace of the nodes.")
@click.option(
    "--controller",
    "controllers",
    multiple=True,
    help="Controller that calibration_node sends to; may be given again.",
)
@click.option("--trajectory-input", default="", help="Topic of trajectories that it corrects.")
@click.option(
    "--operator/--no-operator",
    default=True,
    show_default=True,
    help="Whether there is an identity that may give orders and set parameters.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), default=None, help="File to write; else printed."
)
def command(
    wanted: bool,
    namespace: str,
    controllers: tuple[str, ...],
    trajectory_input: str,
    operator: bool,
    out: Path | None,
) -> None:
    """Write what each node may publish, listen to, answer and ask; all else is denied.

    Each node is an enclave of its own, /delta_calibration/NODE, which it is started in with
    --enclave; `operator` is the one whose processes may call services and set parameters of
    calibration_node. docs/security.md says how keys are made from it.
    """
    if not wanted:
        raise click.UsageError("nothing to write; give --policy")
    text = policy(rights(controllers, trajectory_input, operator), namespace)
    write_or_print(out, text)
