"""Generated laws of users are stored by their content, not by their name."""

from __future__ import annotations

import errno
import os
import pickle
import subprocess
import sys
from functools import partial
from pathlib import Path

import numba
import numpy as np
import pytest

from delta_calibration.model import kernels, library
from delta_calibration.model.law import Law

pytest.importorskip("casadi", exc_type=ImportError)
X = (("q", 1), ("g", 0), ("c", 0))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "delta_calibration" / "laws"


def value(express, q=2.0):
    """Value of a law with one number at q."""
    law = Law("own", X, 1, express)
    found, none = np.zeros((1, 1)), np.zeros((1, 0))
    at = np.array([law.offsets[name] for name in ("q", "g", "c", "f")])
    addresses = np.array(law.compiled.addresses)
    size = law.compiled.size
    kernels.started(addresses, at, size, np.zeros(0), np.full((1, 1), q), none, found)
    return found[0, 0]


def times(factor):
    return lambda q, g, c: np.sum(factor) * q


def scaled(factor, q, g, c):
    return factor * q


class Gear:
    """A law that is a method depends on the attributes of its object."""

    def __init__(self, ratio):
        self.ratio = ratio

    def law(self, q, g, c):
        return self.ratio * q


def recursive(depth):
    def law(q, g, c, left=depth):
        return q if left == 0 else q * law(q, g, c, left - 1)

    return law


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (times(3.0), times(5.0)),
        (times(np.float64(3.0)), times(np.float64(5.0))),
        (times(np.array([1.0, 2.0])), times(np.array([1.0, 4.0]))),
        (times([1.0, 2.0]), times([1.0, 4.0])),
        (partial(scaled, 3.0), partial(scaled, 5.0)),
        (partial(scaled, np.float32(3.0)), partial(scaled, np.float32(5.0))),
        (Gear(3.0).law, Gear(5.0).law),
    ],
    ids=["number", "numpy number", "array", "list", "partial", "partial numpy", "method"],
)
def test_laws_of_one_text_that_say_different_things_are_kept_apart(one, other, folder):
    assert value(one) == pytest.approx(6.0)
    assert value(other) == pytest.approx(10.0)
    assert value(one) == pytest.approx(6.0)
    assert len([*folder.glob("own_*.py")]) == 2


def test_a_law_that_calls_itself_has_an_end():
    assert value(recursive(1)) == pytest.approx(4.0)
    assert value(recursive(3)) == pytest.approx(16.0)


def test_what_is_typed_in_goes_by_what_it_says(folder):
    """Without a source file, the content of the called function `gear` has to be compared."""
    names = {}
    for ratio, expected in ((3.0, 6.0), (5.0, 10.0)):
        text = f"def gear(q):\n    return {ratio} * q\ndef law(q, g, c):\n    return gear(q)\n"
        exec(text, {"__name__": "prompt"}, names)
        names["law"].__globals__["gear"] = names["gear"]
        assert value(names["law"]) == pytest.approx(expected)
    assert len([*folder.glob("own_*.py")]) == 2


MINE = """
{how}
from delta_calibration.model.law import Law
from test_library import X, value

def law(q, g, c):
    return {name} * q

print(value(law))
"""


@pytest.mark.parametrize(
    ("how", "name"),
    [
        ("from sizes import RATIO", "RATIO"),
        ("from parts.sizes import RATIO as OWN", "OWN"),
        ("from parts import own", "own.RATIO"),
        ("def ratio():\n    from sizes import RATIO\n    return RATIO", "ratio()"),
    ],
)
def test_an_edit_of_a_number_that_is_imported_is_noticed(how, name, tmp_path):
    """A number does not know its module; the import statement does."""
    (tmp_path / "mine.py").write_text(MINE.format(how=how, name=name))
    package = tmp_path / "parts"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "own.py").write_text("from .sizes import RATIO\n")
    paths = os.pathsep.join([str(tmp_path), os.path.dirname(__file__)])
    own = {**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
    for ratio in (3.0, 5.0):
        for place in (tmp_path, package):
            (place / "sizes.py").write_text(f"RATIO = {ratio}\n")
        done = subprocess.run(
            [sys.executable, "-c", "import mine"],
            env=own,
            capture_output=True,
            text=True,
            check=True,
        )
        assert float(done.stdout) == pytest.approx(2 * ratio)


def test_a_full_disk_is_no_reason_to_stop(folder, monkeypatch):
    """The law is still generated for this process, and no partial file is left."""

    def full(text, path, write=library._write):
        if path.parent == folder:
            monkeypatch.setattr(os, "fdopen", no_space)
        try:
            write(text, path)
        finally:
            monkeypatch.setattr(os, "fdopen", fdopen)

    def no_space(descriptor, *_, **__):
        os.close(descriptor)
        raise OSError(errno.ENOSPC, "No space left on device")

    fdopen = os.fdopen
    monkeypatch.setattr(library, "_write", full)
    assert value(times(7.0)) == pytest.approx(14.0)
    assert [*folder.iterdir()] == []


KEPT = """
from delta_calibration.model.jit import compiled


@compiled()
def twice(value):
    return 2.0 * value
"""


def test_machine_code_of_another_version_is_made_anew(tmp_path: Path) -> None:
    """A cache index that names a missing class cannot be unpickled to see that it is stale."""
    path = tmp_path / "kept_before.py"
    path.write_text(KEPT)
    run = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import kept_before as k; "
    run += "print(k.twice(2.0), len(k.twice.stats.cache_hits))"

    def told() -> str:
        command = [sys.executable, "-c", run]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    assert told() == "4.0 0\n"
    assert told() == "4.0 1\n"
    (index,) = (tmp_path / "__pycache__").glob("*.nbi")
    index.write_bytes(pickle.dumps(numba.__version__) + b"cno_such_module\nGone\n.")
    assert told() == "4.0 0\n"
    assert told() == "4.0 1\n"


CALLED = """
from delta_calibration.model.jit import compiled


@compiled(borrows=True, shared=True)
def doubled(value):
    return 2.0 * value
"""
CALLER = """
from delta_calibration.model.jit import compiled
from called_by_name import doubled


@compiled()
def times_six(value):
    return 3.0 * doubled(value)
"""


def test_shared_machine_code_is_found_again_or_made_anew(tmp_path: Path) -> None:
    """A caller that is kept holds a name only; it must not run if nothing has that name."""
    for path, text in (("called_by_name", CALLED), ("kept_caller", CALLER)):
        (tmp_path / f"{path}.py").write_text(text)
    run = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); "
    run += "import kept_caller as k, called_by_name as c; "
    run += "print(k.times_six(2.0), *(len(f.stats.cache_hits) for f in (k.times_six, c.doubled)))"

    def told() -> str:
        command = [sys.executable, "-c", run]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    assert told() == "12.0 0 0\n"
    assert told() == "12.0 1 1\n"
    for kept in (tmp_path / "__pycache__").glob("called_by_name.doubled*.nb*"):
        kept.unlink()
    assert told() == "12.0 0 0\n"
    assert told() == "12.0 1 1\n"
