"""`delta-cal fleet`: process the sessions of many machines and report on all of them."""

from __future__ import annotations

import logging
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import TYPE_CHECKING

import click

from delta_calibration.cli.fleet_told import Told, priors_told
from delta_calibration.cli.kept import store_option
from delta_calibration.cli.options import require_folder, robots, seed_option, topics_option
from delta_calibration.cli.verb import OUTPUT, VerbGroup
from delta_calibration.effects import catalogue
from delta_calibration.errors import DataError, InputError
from delta_calibration.fleet.evidence import fitted
from delta_calibration.fleet.priors import write_priors
from delta_calibration.fleet.shared import shared_causes
from delta_calibration.fleet.standing import STATES, standing
from delta_calibration.history.opening import opened
from delta_calibration.report import require_libraries, write_page
from delta_calibration.report.fleet import page_of_fleet
from delta_calibration.robot import Robot, load_robot
from delta_calibration.wording import plain

if TYPE_CHECKING:  # other verbs need not load a cluster's library
    from delta_calibration.fleet.places import Machine

_ORDER = f"each machine counts once, in the first state that applies: {', '.join(STATES)}"
_LIBRARIES = ("dask", "distributed", "fsspec", "sqlalchemy")


class _Verbs(VerbGroup):
    """Group that calls `run` if the first argument is not a verb."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put `run` before the source of sessions."""
        if args and args[0] not in {*self.commands, "--help", "-h"}:
            args = ["run", *args]
        return super().parse_args(ctx, args)


@click.group("fleet", cls=_Verbs)
def command() -> None:
    """Check, fit and diagnose the sessions of many machines, and report what they have in common.

    `delta-cal fleet FOLDER` is short for `delta-cal fleet run FOLDER`.
    Needs Dask and SQLAlchemy: pip install 'delta_calibration[fleet]'.
    """


@command.command("run")
@click.argument("source", metavar="FOLDER|STORE")
@click.option(
    "--robot",
    "robot_given",
    default=None,
    metavar="FILE|NAME",
    shell_complete=robots,
    help="Robot of all machines.  [default: robot.yaml in the folder or in a machine's own]",
)
@click.option(
    "--store",
    "url",
    default=None,
    metavar="FILE|URL",
    help="History to write to.  [default: history.sqlite, or the given STORE]",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    default=None,
    help="Address of a Dask scheduler, such as tcp://host:8786.  [default: a local cluster]",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=None,
    help="Processes of the local cluster.  [default: as many as cores]",
)
@click.option(
    "--memory",
    "memory_gb",
    type=click.FloatRange(min=0.5),
    default=2.0,
    show_default=True,
    metavar="GB",
    help="Memory limit of a worker of the local cluster; one that exceeds it is restarted.",
)
@click.option("--quick", is_flag=True, help="Fit the geometry only; look for no causes.")
@click.option("--no-changes", is_flag=True, help="Do not compare the sessions of a machine.")
@click.option("--again", is_flag=True, help="Try sessions again that failed before.")
@seed_option
@topics_option
@click.option("-v", "--verbose", is_flag=True, help="Print a line for every session.")
def run_(
    source: str,
    robot_given: str | None,
    url: str | None,
    scheduler: str | None,
    workers: int | None,
    memory_gb: float,
    quick: bool,
    no_changes: bool,
    again: bool,
    seed: int,
    topics: tuple[str, ...],
    verbose: bool,
) -> None:
    """Check, fit and diagnose all sessions of the machines in FOLDER, or of a history, a STORE.

    FOLDER has a folder for each machine, with a folder for each of its sessions; it may be the URL
    of any file system that fsspec knows. Sessions whose result is in the history are skipped, so
    that an interrupted run can be resumed. A session that cannot be used is reported and skipped;
    the exit code is then 1.
    """
    _require_libraries()
    from delta_calibration.fleet.places import is_folder
    from delta_calibration.fleet.run import Settings, cluster, run
    from delta_calibration.history.ledger import Ledger

    folder = is_folder(source)
    store_url = url or ("history.sqlite" if folder else source)
    if not folder and (robot_given or topics):
        raise InputError("--robot and --topic are for a folder; a history contains its own")
    machines = _machines(source, folder, robot_given, topics)
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # lost workers appear in results
    told = Told(sum(len(machine.sessions) for machine in machines), verbose)
    with opened(store_url, make=True) as store, cluster(scheduler, workers, memory_gb) as client:
        settings = Settings(quick, again, not no_changes, seed)
        with told.bar:
            run(client, machines, Ledger(store), settings, told)
    click.echo(f"{store.name}: {told.summary(len(machines))}")
    if told.counts["failed"]:
        raise click.exceptions.Exit(1)


def _machines(
    source: str, folder: bool, robot_given: str | None, topics: tuple[str, ...]
) -> tuple[Machine, ...]:
    from delta_calibration.fleet.places import machines_in, robot_file
    from delta_calibration.fleet.run import machines_of

    if folder:
        robot = None if robot_given is None else robot_file(robot_given)
        return machines_in(source, robot, topics)
    with opened(source) as store:
        return machines_of(store)


@command.command("report")
@store_option
@click.option("--out", type=OUTPUT, required=True, help="HTML page to write; it opens offline.")
@click.option(
    "--on",
    "day",
    type=click.DateTime(["%Y-%m-%d"]),
    default=None,
    metavar="DATE",
    help="Date of the report, such as 2026-05-31.  [default: today]",
)
@click.option(
    "--lately",
    type=click.IntRange(min=1),
    default=90,
    show_default=True,
    metavar="DAYS",
    help="Number of days for which sessions and changes count as recent.",
)
def report(url: str, out: Path, day: datetime | None, lately: int) -> None:
    """Write one page of all machines: their states, what they share, which to visit first."""
    _require_libraries()
    require_folder(out)
    require_libraries()
    from delta_calibration.fleet.stored import known_machines, never_measured
    from delta_calibration.history.ledger import Ledger

    now = datetime.now(timezone.utc)
    on = now if day is None else day.replace(tzinfo=timezone.utc, hour=23, minute=59)
    with opened(url) as store:
        ledger = Ledger(store)
        fleet = [standing(known, on, timedelta(days=lately)) for known in known_machines(ledger)]
        never = never_measured(ledger)
    if not fleet:
        raise DataError(f"{store.name}: no machine has a session with a result")
    shared = shared_causes(fleet, *_looked_for({each.robot for each in fleet}))
    page = page_of_fleet(fleet, shared, never, on, lately)
    write_page(out, page)
    click.echo(plain(f"{page.sentence}\n{_ORDER}\n{page.statements[1].answer}"))
    apart = [each.machine for each in fleet if not each.compared]
    if apart:
        click.echo(
            f"not compared, so that no change is known: {', '.join(apart)}; "
            f"`delta-cal fleet run {url}` compares them"
        )
    click.echo(f"written: {out}")


@command.command("priors")
@store_option
@click.option(
    "--robot",
    "robot_given",
    default=None,
    metavar="FILE|NAME",
    shell_complete=robots,
    help="Robot of the machines, needed if the history contains several.",
)
@click.option("--out", type=OUTPUT, required=True, help="File of priors (YAML) to write.")
def priors(url: str, robot_given: str | None, out: Path) -> None:
    """Estimate the dimensions that machines of one type have in common, as priors for the next.

    Computes mean and spread of every dimension over the machines, from all their fits weighted by
    their standard errors. Unusual machines are reported and left out. `delta-cal fit --priors`
    uses the file.
    """
    require_folder(out)
    _require_libraries()
    from delta_calibration.history.ledger import Ledger

    with opened(url) as store:
        known = Ledger(store).made_for()
        robot = _type_of(store.name, known, robot_given)
        names = sorted(name for name, (_, made) in known.items() if made == robot.machine_hash)
        machines = [
            fitted(name, (e.calibration for e in store.sessions(name)), robot) for name in names
        ]
    told = write_priors(out, machines, robot)
    click.echo(priors_told(told))
    click.echo(f"written: {out}")


def _type_of(url: str, known: dict[str, tuple[str, str]], given: str | None) -> Robot:
    """Robot type whose priors are to be estimated."""
    if given is not None:
        return load_robot(given)
    types = {made_for: robot for robot, made_for in known.values()}
    if len(types) != 1:
        several = ", ".join(sorted(types.values())) or "none"
        raise InputError(f"{url}: machines of several robots ({several}): choose one with --robot")
    return load_robot(next(iter(types.values())))


def _looked_for(robots: set[str]) -> tuple[int, int]:
    """Number of causes that a diagnosis looks for in these robots, and of joints at most."""
    known = [load_robot(robot) for robot in robots]
    causes = {e.cause for robot in known for e in catalogue(robot, robot.model())}
    return len(causes), max(len(robot.joints.names) for robot in known)


def _require_libraries() -> None:
    try:
        import delta_calibration.fleet.run  # noqa: F401 - whether it can be
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] not in _LIBRARIES:
            raise
        raise InputError(
            f"a fleet needs {error.name}: pip install 'delta_calibration[fleet]'"
        ) from error
