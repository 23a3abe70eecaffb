"""Tests of the small sessions in bags/: they agree with their table and can be made again."""

from __future__ import annotations

import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.recording import read_session

FOLDER = Path(__file__).parents[1] / "bags"
sys.path.insert(0, str(FOLDER))
from make import (  # noqa: E402
    BAGS,
    BALLBAR,
    SPREADSHEET,
    ballbar,
    make,
    sha256,
    spreadsheet,
    table,
)

MOST_BYTES = 1_000_000
TOGETHER_BYTES = 3_000_000


def numbers(part: object, name: str = "") -> dict[str, np.ndarray]:
    """Every array in a session, by its path."""
    if isinstance(part, np.ndarray):
        return {name: part}
    if is_dataclass(part):
        part = {field.name: getattr(part, field.name) for field in fields(part)}
    if isinstance(part, dict | tuple):
        pairs = part.items() if isinstance(part, dict) else enumerate(part)
        return {k: v for key, item in pairs for k, v in numbers(item, f"{name}.{key}").items()}
    return {}


def require_same(one: Path, other: Path) -> None:
    first, second = numbers(read_session(one)), numbers(read_session(other))
    assert first.keys() == second.keys()
    assert any("tracker" in name for name in first)
    for name, values in first.items():
        np.testing.assert_allclose(second[name], values, rtol=0, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("name", BAGS)
def test_a_remade_session_has_the_same_values(name: str, tmp_path: Path) -> None:
    require_same(FOLDER / name, make(name, tmp_path))


def test_a_remade_spreadsheet_has_the_same_values(tmp_path: Path) -> None:
    (tmp_path / "srbd_plain").symlink_to(FOLDER / "srbd_plain")
    made, kept = (
        np.loadtxt(path, delimiter=",", skiprows=1)
        for path in (spreadsheet(tmp_path), FOLDER / SPREADSHEET)
    )
    np.testing.assert_allclose(made, kept, rtol=0, atol=2e-4)


def test_a_remade_ballbar_has_the_same_lengths(tmp_path: Path) -> None:
    made, kept = (
        np.loadtxt(path, delimiter=",", skiprows=1)
        for path in (ballbar(tmp_path), FOLDER / BALLBAR)
    )
    np.testing.assert_allclose(made, kept, rtol=0, atol=2e-4)


def test_another_session_is_told_apart() -> None:
    with pytest.raises(AssertionError):
        require_same(FOLDER / "srbd_backlash", FOLDER / "srbd_warm")


def test_the_table_is_that_of_the_files() -> None:
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert table(FOLDER).rpartition("Table made by")[0] in page
    for name in BAGS:
        assert sha256(FOLDER / name) in page


def test_they_are_small() -> None:
    sizes = {n: sum(f.stat().st_size for f in (FOLDER / n).iterdir()) for n in BAGS}
    assert max(sizes.values()) < MOST_BYTES
    assert sum(sizes.values()) < TOGETHER_BYTES
    assert {path.name for path in FOLDER.iterdir() if path.is_dir()} - {"__pycache__"} == {*sizes}
