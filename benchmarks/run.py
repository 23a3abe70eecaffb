"""Time of the parts on this machine, all in one run: `make bench`.

Each value is the smallest of several repeats (other load can only increase it), per item and with
its unit. They are also written to out/bench.json. Values of different runs or machines are not
comparable; ratios within one run are.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
import timeit
from collections.abc import Callable
from functools import partial
from pathlib import Path

for library in ("OPENBLAS", "MKL", "OMP"):  # as on the command line: the matrices are small
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np

from delta_calibration.calibration_file import from_identification
from delta_calibration.compensation import JointCompensator
from delta_calibration.data import at_rest, collect
from delta_calibration.estimation import identify
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session, write_session
from delta_calibration.robot import load_robot
from delta_calibration.simulation import RICH_PERIOD, draw_machine, simulate_session

SAMPLES = 10_000
REPEATS = 5


def least(
    function: Callable[..., object], *arguments: object, items: int = 1, repeats: int = REPEATS
) -> float:
    """Time per item of a call with these arguments [s]."""
    call = partial(function, *arguments)
    return min(timeit.repeat(call, number=1, repeat=repeats)) / items


def kinematics() -> list[tuple[str, float, str]]:
    """The two models of the Delta, many samples at once."""
    robot = load_robot("srbd")
    rng = np.random.default_rng(0)
    q = rng.uniform(-0.3, 1.2, (SAMPLES, 3))
    rows = []
    for name in ("rotary_delta", "six_rod_delta"):
        model = robot.model(name)
        parameters = model.parameters
        g = parameters.nominal + parameters.prior * rng.standard_normal(len(parameters))
        x = model.forward(q, g)
        n = SAMPLES if name == "rotary_delta" else SAMPLES // 10
        q_n, x_n = q[:n], x[:n]
        calls = {
            "forward": (model.forward, q_n, g),
            "inverse": (model.inverse, x_n[:, :3], g),
            "velocity Jacobian": (model.velocity_jacobian, q_n, x_n, g),
            "identification Jacobian": (model.identification_jacobian, q_n, x_n, g),
        }
        rows += [
            (f"{name}: {what}", 1e6 * least(*call, items=n), "us a pose")
            for what, call in calls.items()
        ]
    return rows


def session_work() -> list[tuple[str, float, str]]:
    """Time to write, read, clean and fit a two-hour session, and to compensate the line."""
    robot = load_robot("srbd")
    machine = draw_machine(robot, 1)
    session = simulate_session(machine, make_plan("rich", robot, seed=1), 1, period=RICH_PERIOD)
    assert session.tracker is not None
    messages = 3 * len(session.tracker.stamp_ns)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session"
        writing = least(write_session, path, session, {}, repeats=1)
        reading = least(read_session, path)
    poses = collect(session, robot.joints.names)
    rows = [
        (f"write a session of {messages} messages", writing, "s"),
        (f"read a session of {messages} messages", reading, "s"),
        (
            "find still moments and poses",
            least(collect, session, robot.joints.names),
            "s",
        ),
    ]
    line = make_plan("line", robot, count=61, both_sides=False).joint
    for model in ("rotary_delta", "six_rod_delta"):
        seconds = least(identify, poses, robot, model, repeats=2)
        rows.append((f"fit {len(poses)} poses, {model}, held-out parts within", seconds, "s"))
        calibration = from_identification(identify(poses, robot, model), robot, poses)
        for method in ("newton", "apso"):
            compensator = JointCompensator(calibration, method)
            compensator.compensate(line[:1])  # compiles
            batch = 1e3 * least(compensator.compensate, line, items=len(line), repeats=3)
            alone = 1e3 * least(compensator.compensate, line[:1], at_rest(line[:1]), repeats=3)
            name = f"{method}, {model}"
            rows.append((f"{name}, {len(line)} targets at once", batch, "ms a target"))
            rows.append((f"{name}, one target alone", alone, "ms"))
    return rows


def main() -> int:
    """Print and write the table."""
    rows = kinematics() + session_work()
    print("| what | | |\n|---|---|---|")
    for name, value, unit in rows:
        print(f"| {name} | {value:.4g} | {unit} |")
    out = Path("out")
    out.mkdir(exist_ok=True)
    record = {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "processors": os.cpu_count(),
        "figures": [{"name": n, "value": v, "unit": u} for n, v, u in rows],
    }
    (out / "bench.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
