"""The API reference is built of every module, without a warning."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from delta_calibration.processes import child_environment

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "delta_calibration"
pytest.importorskip("pdoc", reason="needs pdoc (the extra [docs]), which is not installed")


def modules_in(folder: Path, suffix: str) -> set[Path]:
    """Modules by their paths, less those of the nodes, which need rclpy, and generated ones."""
    paths = (path.relative_to(folder).with_suffix("") for path in folder.rglob(f"*.{suffix}"))
    left_out = {"ros", "generated"}
    return {path for path in paths if path.name != "__init__" and not left_out & {*path.parts}}


@pytest.mark.slow
def test_the_reference_is_built_without_warnings(tmp_path: Path) -> None:
    script = ROOT / "docs" / "make_api.py"
    done = subprocess.run(
        [sys.executable, script, tmp_path],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env=child_environment() | {"PYTHONPATH": ":".join([str(ROOT), *sys.path[1:]])},
    )
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "delta_calibration" / "chain.html").read_text(encoding="utf-8")
    assert "The chain of measurement" in page
    assert not modules_in(PACKAGE, "py") - modules_in(tmp_path / "delta_calibration", "html")


def test_a_warning_is_an_error(tmp_path: Path) -> None:
    """An annotation that nobody can resolve stops the build."""
    broken = tmp_path / "broken.py"
    broken.write_text('"""Broken."""\n\n\ndef f(x: "Nothing") -> None:\n    """Take x."""\n')
    code = (
        f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT / 'docs')!r}]\n"
        "import make_api; from pathlib import Path\n"
        f"make_api.modules = lambda: ['broken']\nmake_api.main(Path({str(tmp_path / 'o')!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env=child_environment() | {"PYTHONPATH": ":".join([str(ROOT), *sys.path[1:]])},
    )
    assert done.returncode != 0
    assert "Nothing" in done.stderr
