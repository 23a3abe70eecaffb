"""Options of a table of corrections, which is computed, or loaded from an earlier run's file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click

from delta_calibration.calibration import Calibration
from delta_calibration.cli.options import progress, require_folder
from delta_calibration.cli.quantity import Quantity
from delta_calibration.cli.verb import OUTPUT
from delta_calibration.compensation import (
    SOLVERS,
    TABLE,
    JointCompensator,
    Table,
    TableSettings,
    load_table,
    save_table,
)
from delta_calibration.errors import InputError

Function = TypeVar("Function", bound=Callable[..., Any])


@dataclass(frozen=True)
class TableOptions:
    """Options of a table of corrections; None if an option is not given."""

    file: Path | None
    solver: str | None
    bound_um: float | None

    def require_method(self, method: str) -> None:
        """Refuse the options of a table beside another method, before any work is done.

        Raises:
            InputError: names the option.
        """
        if method != TABLE:
            for option, value in (
                ("--table", self.file),
                ("--table-by", self.solver),
                ("--table-bound-um", self.bound_um),
            ):
                if value is not None:
                    raise InputError(f"{option} is for --method {TABLE}, not {method}")
        elif self.file is not None:
            require_folder(self.file)

    def compensator(self, calibration: Calibration, seed: int) -> JointCompensator:
        """Compensator that uses the table; prints how its corrections are obtained.

        Raises:
            InputError: the file is not such a table.
            DataError: no table within its bound.
        """
        file = self.file
        there = file is not None and file.exists()
        table = self._loaded(file, calibration) if file and there else self._settings()
        made = JointCompensator(calibration, TABLE, seed, table=table, follow=_bar)
        said = f"corrections by {made.way}"
        if file and there:
            said += f", loaded from {file}"
        elif file and made.table is not None:
            save_table(file, made.table)
            said += f", written: {file}"
        click.echo(said)
        return made

    def _settings(self) -> TableSettings:
        usual = TableSettings()
        bound = usual.bound if self.bound_um is None else 1e-6 * self.bound_um
        return TableSettings(self.solver or usual.solver, bound)

    def _loaded(self, file: Path, calibration: Calibration) -> Table:
        """Table in the file, if it has the solver and bound that were asked for."""
        table = load_table(file, calibration)
        if self.solver not in (None, table.solver):
            raise InputError(f"{file}: made by {table.solver}, not by {self.solver}")
        if self.bound_um is not None and table.bound > 1e-6 * self.bound_um * (1 + 1e-9):
            raise InputError(
                f"{file}: its bound is {table.bound * 1e6:g} um, not {self.bound_um:g}"
            )
        return table


def table_options(function: Function) -> Function:
    """`--table`, `--table-by` and `--table-bound-um`."""
    options = (
        click.option(
            "--table",
            "table_file",
            type=OUTPUT,
            default=None,
            help="File for --method table: read if it exists, otherwise computed and written.",
        ),
        click.option(
            "--table-by",
            type=click.Choice(SOLVERS),
            default=None,
            help="Method that computes the entries of a new table.  [default: newton]",
        ),
        click.option(
            "--table-bound-um",
            default=None,
            metavar="UM",
            type=Quantity(0, 1, above=True),
            help="Largest interpolation error of a table between its nodes.  [default: 1]",
        ),
    )
    for option in reversed(options):
        function = option(function)
    return function


def _bar(blocks: range) -> Iterable[int]:
    return progress(blocks, len(blocks), "block")
