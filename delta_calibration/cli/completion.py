"""`delta-cal completion`: script with which a shell completes verbs, options, robots, causes."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from delta_calibration.errors import InputError

_PROGRAM, _VARIABLE = "delta-cal", "_DELTA_CAL_COMPLETE"


@click.command("completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def command(shell: str) -> None:
    """Print a script that lets SHELL complete delta-cal commands with the Tab key.

    \b
    bash, in ~/.bashrc:                   eval "$(delta-cal completion bash)"
    zsh, in ~/.zshrc, after compinit:     eval "$(delta-cal completion zsh)"
    fish, once:
      delta-cal completion fish > ~/.config/fish/completions/delta-cal.fish
    """  # noqa: D301 - to click \b is the control character
    kind = get_completion_class(shell)
    if kind is None:
        raise InputError(f"this version of click has no completion for {shell}")
    # A dummy command is enough: the variable makes the program complete when Tab is pressed.
    script = kind(click.Command(_PROGRAM), {}, _PROGRAM, _VARIABLE)
    click.echo(script.source_template % script.source_vars())
