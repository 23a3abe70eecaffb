"""Tests of the table of constants: each has a reason and a use, and decisions use no others."""

from __future__ import annotations

import ast
import tokenize
from pathlib import Path

import pytest

from delta_calibration.diagnosis import constants

FOLDER = Path(constants.__file__).parent
TABLE = {
    target.id: node
    for node in ast.parse((FOLDER / "constants.py").read_text()).body
    if isinstance(node, ast.Assign)
    for target in node.targets
    if isinstance(target, ast.Name)
}
MODULES = sorted(set(FOLDER.glob("*.py")) - {FOLDER / "constants.py"})
DECIDE = ("statement", "findings", "name_checks", "rivals", "judge", "joint_fit", "search")
NUMERICS = {"MM", "_RANK"}  # a unit, and the rounding of a matrix


def names_in(path: Path) -> set[str]:
    return {n.id for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Name)}


def test_each_says_what_sets_it() -> None:
    with tokenize.open(FOLDER / "constants.py") as file:
        comments = {
            token.start[0]
            for token in tokenize.generate_tokens(file.readline)
            if token.type == tokenize.COMMENT
        }
    silent = [n for n, node in TABLE.items() if not {node.lineno, node.lineno - 1} & comments]
    assert silent == []


def test_each_is_used() -> None:
    assert set(TABLE) - set().union(*map(names_in, MODULES)) == set()


@pytest.mark.parametrize("name", DECIDE)
def test_what_decides_has_no_number_of_its_own(name: str) -> None:
    tree = ast.parse((FOLDER / f"{name}.py").read_text())
    own = {
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant)
        for target in node.targets
        if isinstance(target, ast.Name) and isinstance(node.value.value, int | float)
    }
    assert own - NUMERICS == set()
