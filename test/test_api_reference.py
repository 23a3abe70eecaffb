"""The API reference is built of every module, without a warning."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from delta_calibration.processes import child_environment

ROOT = Path(__file__).parents[1]
pytest.importorskip("pdoc", reason="needs pdoc (the extra [docs]), which this Python does not have")


@pytest.mark.slow
def test_the_reference_is_built_without_warnings(tmp_path: Path) -> None:
    script = ROOT / "docs" / "make_api.py"
    done = subprocess.run(
        [sys.executable, script, tmp_path], cwd=ROOT, capture_output=True, text=True, check=False,
        env=child_environment() | {"PYTHONPATH": ":".join([str(ROOT), *sys.path[1:]])},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "delta_calibration" / "chain.html").read_text(encoding="utf-8")
    assert "One chain of measurement" in page or "chain" in page
    sources = {p.relative_to(ROOT / "delta_calibration").with_suffix("")
               for p in (ROOT / "delta_calibration").rglob("*.py") if p.name != "__init__.py"}  # fmt: skip
    built = {p.relative_to(tmp_path / "delta_calibration").with_suffix("")
             for p in (tmp_path / "delta_calibration").rglob("*.html")}  # fmt: skip
    left_out = {path for path in sources - built if path.parts[0] != "ros"}
    assert not left_out
    assert "<script" in page


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
        [sys.executable, "-c", code], capture_output=True, text=True, check=False,
        env=child_environment() | {"PYTHONPATH": ":".join([str(ROOT), *sys.path[1:]])},
    )  # fmt: skip
    assert done.returncode != 0
    assert "Nothing" in done.stderr
