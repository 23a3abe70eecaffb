"""Tests: nodes that a verb starts as child processes."""

from pathlib import Path

import pytest

from delta_calibration.cli import children
from delta_calibration.cli.children import Children
from delta_calibration.errors import CalibrationError


def test_after_all_have_been_stopped_none_starts(tmp_path: Path) -> None:
    """A thread that goes on while its cell is being stopped leaves no node behind."""
    with Children(1, tmp_path) as cell:
        pass
    with pytest.raises(CalibrationError, match="simulated_tracker was not started"):
        cell.start("simulated_tracker", {})


def test_each_cell_has_a_log_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder is made when the first node starts; what a node says on its way out is there."""
    monkeypatch.setattr(children, "_NODES", "json")
    with Children(1, tmp_path / "logs" / "session") as cell, pytest.raises(CalibrationError):
        cell.run("tool", ["no such file"], 20.0)
    assert "no such file" in (tmp_path / "logs" / "session" / "tool.log").read_text("utf-8")
