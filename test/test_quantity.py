"""Numbers on the command line and in tables are finite, and none of them overflows."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from delta_calibration.cli.main import VERBS, group, run
from delta_calibration.cli.quantity import OfPart, Quantity
from delta_calibration.errors import CalibrationError, InputError
from delta_calibration.plans import make_plan, read_targets
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.tables import read_table


def options() -> Iterator[tuple[str, click.Parameter]]:
    """All parameters of all commands."""
    for verb in VERBS:
        command = group.get_command(click.Context(group), verb)
        assert command is not None
        for parameter in command.params:
            yield verb, parameter


NUMBERS = [
    (verb, parameter)
    for verb, parameter in options()
    if isinstance(parameter.type, click.types.FloatParamType | Quantity | OfPart)
]


def test_every_option_that_is_a_number_is_a_quantity() -> None:
    """A range type of click accepts `nan`, because every comparison with it is false."""
    assert len(NUMBERS) >= 9
    loose = [
        (verb, parameter.opts)
        for verb, parameter in NUMBERS
        if not isinstance(parameter.type, Quantity | OfPart)
    ]
    assert loose == []


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e300"])
@pytest.mark.parametrize(("verb", "parameter"), NUMBERS, ids=lambda v: getattr(v, "name", v))
def test_no_number_that_is_not_finite_is_taken(
    verb: str, parameter: click.Parameter, value: str
) -> None:
    given = f"arm={value}" if isinstance(parameter.type, OfPart) else value
    with pytest.raises(click.BadParameter) as refused:
        parameter.type.convert(given, parameter, click.Context(click.Command(verb)))
    said = refused.value.format_message()
    assert parameter.opts[0] in said
    assert str(float(value)) in said or value in said
    assert "<=x<=" in said or "<x<=" in said


def test_a_rate_that_is_no_number_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate", "--robot", "srbd", "--rate", "nan", "--out", "never"]) == 2
    said = capsys.readouterr().err
    assert "'--rate': nan is not a finite number; allowed: 1<=x<=1000" in said


@pytest.mark.parametrize("name", known_robots())
@pytest.mark.parametrize("far", ["1e200", "-1e300", "3e6"])
def test_a_target_beyond_all_reach_is_refused_before_it_overflows(
    name: str, far: str, tmp_path: Path
) -> None:
    robot = load_robot(name)
    names = [
        f"{letter}_mm"
        for letter, k in zip("xyz", range(3), strict=True)
        if k in robot.commanded.freedoms
    ]
    row = [far, *["0"] * (len(names) - 1)]
    file = tmp_path / "targets.csv"
    file.write_text(f"{','.join(names)}\n{','.join(row)}\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(CalibrationError, match=rf"line 2: {names[0]}: '{far}' is not allowed"):
            read_targets(file, robot)


def test_any_cell_that_would_overflow_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    file.write_text("a\n1e300\n")
    with pytest.raises(InputError, match="line 2: a: '1e300' is not allowed; allowed: -1e\\+30"):
        read_table(file, ["a"])[0].number("a")


def test_a_hidden_cause_beyond_all_size_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    order = ["simulate", "--robot", "srbd", "--plan", "line", "--count", "2", "--out", "never"]
    assert run([*order, "--effect", "arm_length:value=1e300"]) == 2
    assert "effect arm_length: value 1e300 is not allowed; allowed: -1e+09" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("robot", "column", "said"),
    [
        ("five_axis", "A_deg", "column A_deg is not known; allowed: x_mm, y_mm, z_mm, turn_x_deg"),
        ("ur10", "rz_deg", "column rz_deg is not known; allowed: x_mm, y_mm, z_mm, turn_x_deg"),
        ("cdpr8", "payload_g", "column payload_g: not a known unit; allowed: payload_kg"),
        ("srbd", "duration_ms", "column duration_ms: not a known unit; allowed: duration_s"),
        ("srbd", "", "column '' is not known; allowed: "),
    ],
)
def test_no_column_is_left_out_in_silence(
    robot: str, column: str, said: str, tmp_path: Path
) -> None:
    """In targets and in plans: an ignored turn or load would give a wrong command."""
    file = tmp_path / "points.csv"
    file.write_text(f"x_mm,y_mm,z_mm,{column}\n0,0,0,1\n")
    with pytest.raises(InputError, match=rf"points\.csv: {said}"):
        read_targets(file, load_robot(robot))
    with pytest.raises(InputError, match=rf"points\.csv: {said}"):
        make_plan(str(file), load_robot(robot))
