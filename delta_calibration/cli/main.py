"""The command `delta-cal`: finds the verb, turns known errors into one line and an exit code."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from difflib import get_close_matches

import click
from click.shell_completion import CompletionItem

from delta_calibration import __version__
from delta_calibration.cli.overview import TOLD, write_verbs
from delta_calibration.errors import CalibrationError
from delta_calibration.loading import load

VERBS = (
    "completion",
    "plan",
    "simulate",
    "check",
    "fit",
    "diagnose",
    "circle",
    "report",
    "certificate",
    "compare",
    "history",
    "fleet",
    "serve",
    "compensate",
    "export",
    "iso9283",
    "replay",
    "import",
    "printer",
    "info",
    "recover",
    "urdf",
    "robot",
    "sros2",
    "demo",
)
_MODULES = {"import": "import_table"}  # where a verb is no name in Python
_INTERRUPTED = 130

# The matrices here are small: threads of the linear algebra library cost more than they bring.
for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")


class Verbs(click.Group):
    """Loads a verb only when it is called: `info` need not load the libraries of `fit`."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the verbs, in the order of use."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The verb of that name."""
        if cmd_name not in VERBS:
            return None
        name = _MODULES.get(cmd_name, cmd_name)
        command = load(f"delta_calibration.cli.{name}").command
        return command if isinstance(command, click.Command) else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the verb that is called; if there is none, the error names the most similar one."""
        if args[0] not in VERBS and (near := get_close_matches(args[0], VERBS, 1)):
            ctx.fail(f"No such command {args[0]!r}. Did you mean {near[0]!r}?")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the verbs by purpose, with an example of each."""
        write_verbs(formatter, VERBS)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Verbs that begin with the typed text, without loading them."""
        verbs = [verb for verb in VERBS if verb.startswith(incomplete)]
        options = click.Command.shell_complete(self, ctx, incomplete)
        return [*(CompletionItem(verb, help=TOLD[verb].about) for verb in verbs), *options]


@click.group(cls=Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="delta-cal")
def group() -> None:
    """Calibrate and diagnose parallel robots from measured data.

    A session (a rosbag2 folder) holds the joint commands and the readings of a laser tracker.
    `fit` identifies the real geometry of the machine, `diagnose` finds what else is wrong with it,
    `compensate` computes the joint commands that put the tool where it should be, and `iso9283`
    measures the accuracy. `simulate` records sessions of a simulated machine, `import` makes one
    from your own table, and `demo` shows everything on a live simulated cell.

    \b
    A first look, in a folder of your own:
      delta-cal simulate --robot srbd --plan identify --seed 1 --out session
      delta-cal fit session --robot srbd --out calibration.yaml

    Run `delta-cal VERB --help` for details. Long work shows a progress bar. Exit codes: 0 done; 1
    the data cannot answer; 2 wrong use or bad input.
    """  # noqa: D301 - to click \b is the control character


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the console script; exits the process."""
    sys.exit(run(arguments))


def run(arguments: Sequence[str] | None = None) -> int:
    """Run a verb and return the exit code."""
    try:
        result = group.main(
            args=None if arguments is None else list(arguments),
            prog_name="delta-cal",
            standalone_mode=False,
        )
    except click.exceptions.Exit as leave:
        return leave.exit_code
    except click.Abort:
        return _INTERRUPTED
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except CalibrationError as error:
        click.echo(f"delta-cal: {error}", err=True)
        return error.exit_code
    except BrokenPipeError:  # the reader of the pipe has ended, which is no error here
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        return _INTERRUPTED
    return result if isinstance(result, int) else 0


if __name__ == "__main__":
    main()
