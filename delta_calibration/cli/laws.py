"""Generate the code of all laws of the package again: `make laws`."""

from __future__ import annotations

import click

from delta_calibration.laws import every_law, folder, write


@click.command()
def command() -> None:
    """Write the generated files of the package, and remove those of laws that are no more."""
    changed = write(every_law(), folder())
    for path in changed:
        click.echo(f"{'written' if path.exists() else 'removed'}: {path.name}")
    click.echo(f"generated files that changed: {len(changed)}")


if __name__ == "__main__":
    command()
