"""The API reference is built from every module, without a warning."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from delta_calibration.processes import child_environment

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "delta_calibration"
pytest.importorskip("pdoc", reason="needs pdoc (the extra [docs]), which is not installed")


def modules_in(folder: Path, suffix: str) -> set[Path]:
    """Modules by their paths, without nodes, which need rclpy, and without generated ones."""
    paths = (path.relative_to(folder).with_suffix("") for path in folder.rglob(f"*.{suffix}"))
    left_out = {"ros", "generated"}
    return {path for path in paths if path.name != "__init__" and not left_out & {*path.parts}}


def built(code: str) -> subprocess.CompletedProcess[str]:
    """Run lines that use `make_api` in a separate process, in which nothing is imported yet."""
    head = f"import sys; sys.path.insert(0, {str(ROOT / 'docs')!r})\n"
    head += "import make_api; from pathlib import Path\n"
    return subprocess.run(
        [sys.executable, "-c", head + code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env=child_environment() | {"PYTHONPATH": ":".join([str(ROOT), *sys.path[1:]])},
    )


@pytest.mark.slow
def test_the_reference_is_built_without_warnings(tmp_path: Path) -> None:
    """All pages, and one page with its source, as in `make docs`."""
    every, one = tmp_path / "every", tmp_path / "one"
    done = built(
        f"make_api.main(Path({str(every)!r}), make_api.modules(), sources=False)\n"
        f"sys.argv[1:] = [{str(one)!r}, 'delta_calibration.chain']\n"
        "import runpy; runpy.run_path(make_api.__file__, run_name='__main__')"
    )
    assert done.returncode == 0, done.stderr
    pages = [folder / "delta_calibration" / "chain.html" for folder in (every, one)]
    texts = [page.read_text(encoding="utf-8") for page in pages]
    assert all("The chain of measurement" in text for text in texts)
    assert ["def predict" in re.sub("<[^>]*>", "", text) for text in texts] == [False, True]
    assert not modules_in(PACKAGE, "py") - modules_in(every / "delta_calibration", "html")


def test_a_warning_is_an_error(tmp_path: Path) -> None:
    """An annotation that cannot be resolved stops the build."""
    broken = tmp_path / "broken.py"
    broken.write_text('"""Broken."""\n\n\ndef f(x: "Nothing") -> None:\n    """Take x."""\n')
    done = built(
        f"sys.path.insert(0, {str(tmp_path)!r})\n"
        f"make_api.main(Path({str(tmp_path / 'o')!r}), ['broken'])"
    )
    assert done.returncode != 0
    assert "Nothing" in done.stderr
