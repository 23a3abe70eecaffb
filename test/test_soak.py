"""One minute of the soak test with faults, and tests that its checks can fail."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from soak import growth
from soak_outputs import Outputs, Told

ROOT = Path(__file__).parents[1]
Q = np.array([0.1, 0.2, 0.3])


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_minute_of_faults(tmp_path: Path) -> None:
    pytest.importorskip("rclpy")
    from ros_helpers import environment

    # Other tests share the processors; a quarter of the rate shows the same faults.
    script = str(ROOT / "benchmarks" / "soak.py")
    run = subprocess.run(
        [sys.executable, script, "--seconds", "60", "--hz", "250", "--logs", str(tmp_path)],
        env=environment(),
        text=True,
        capture_output=True,
        check=False,
        timeout=540,
    )
    assert run.returncode == 0, run.stdout + run.stderr[-4000:]
    assert run.stdout.rstrip().endswith("passed")


def checked(*steps: tuple[float, np.ndarray, np.ndarray, bool]) -> Outputs:
    """Outputs for commands that are received when sent: time, command, output, held."""
    outputs = Outputs(bound=0.01, rate=0.05, speed=1.0)
    for k, (when, q, out, held) in enumerate(steps):
        outputs.told[k] = Told(when, q, held)
        outputs.take(k, out, when)
    return outputs


def test_what_is_sound_breaks_nothing() -> None:
    far = Q + 0.5
    assert not checked((0.0, Q, Q + 0.009, False), (0.1, far, far, False)).broken
    assert not checked((0.0, Q, Q, False), (0.1, far, Q, True), (0.2, far, Q + 0.1, True)).broken


@pytest.mark.parametrize(
    ("out", "said"),
    [
        (Q + 0.011, "a correction of"),
        (Q + np.array([0.0, np.nan, 0.0]), "not finite"),
        (Q + 0.2, "a step of"),
    ],
)
def test_what_is_not_is_told(out: np.ndarray, said: str) -> None:
    broken = checked((0.0, Q, Q, False), (0.1, Q, out, False)).broken
    assert any(said in text for text in broken)


def test_an_output_for_no_command_is_told() -> None:
    outputs = checked()
    outputs.take(7, Q, 0.0)
    assert "a stamp that no command had: 7" in outputs.broken[0]


def test_growth_is_that_of_the_second_half() -> None:
    time = np.linspace(0.0, 120.0, 61)
    size = np.where(time < 60, 100 + time, 160 + 0.05 * (time - 60))
    noise = np.random.default_rng(1).normal(0.0, 0.01, len(time))
    slope, minutes = growth(list(zip(time, size + noise, strict=True)))
    assert slope == pytest.approx(3.0, abs=0.05)
    assert minutes == pytest.approx(1.0)
