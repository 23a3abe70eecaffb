"""Classes of installed packages, added to those of this package."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest

from delta_calibration.errors import ConfigError
from delta_calibration.registry import Registry


@dataclass
class Kind:
    name: ClassVar[str] = "own"


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Install a distribution with the given entry point."""

    def install(entry: str, source: str) -> Registry[Kind]:
        info = tmp_path / "another-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: another\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[test_registry.kinds]\n{entry}\n")
        (tmp_path / "another_kinds.py").write_text(source)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "another_kinds", raising=False)
        return Registry(Kind, "name", "test_registry.kinds", [Kind])

    return install


SOURCE = "from test_registry import Kind\nclass New(Kind):\n    name = 'new'\nvalue = 3\n"


def test_what_is_installed_is_known_beside_the_own(installed) -> None:
    kinds = installed("new = another_kinds:New", SOURCE)
    assert list(kinds) == ["own", "new"]
    assert kinds["own"] is Kind
    assert kinds["new"].__name__ == "New"
    assert issubclass(kinds["new"], Kind)
    assert len(kinds) == 2
    assert "other" not in kinds


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("own = another_kinds:New", "the package already has a own"),
        ("new = another_kinds:Missing", "cannot be loaded: .*Missing"),
        ("new = not_there:New", "cannot be loaded: .*not_there"),
        ("new = another_kinds:value", "is not a class derived from Kind"),
        ("other = another_kinds:New", "its name is 'new'"),
    ],
)
def test_an_entry_that_will_not_do_is_named(installed, entry: str, said: str) -> None:
    kinds = installed(entry, SOURCE)
    with pytest.raises(ConfigError, match=f"entry point test_registry.kinds: {entry}: .*{said}"):
        list(kinds)


def test_a_foreign_module_may_be_imported_first(tmp_path: Path) -> None:
    """When it imports this package, the registry must not load its unfinished module."""
    info = tmp_path / "another-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: another\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[delta_calibration.effects]\nlong_scale = another_effect:LongScale\n"
    )
    (tmp_path / "another_effect.py").write_text(
        "from delta_calibration.effects.joint_scale import JointScale\n"
        "class LongScale(JointScale):\n    cause = 'long_scale'\n"
    )
    path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[1])])
    code = (
        "import another_effect\nfrom delta_calibration.effects import EFFECTS\n"
        "print(EFFECTS['long_scale'].__name__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "LongScale\n", done.stderr
