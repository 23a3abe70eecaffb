"""The page of 200 simulated machines."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from delta_calibration.cli.main import run as run_verb
from delta_calibration.data import survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import catalogue
from delta_calibration.history.adding import entry_of, made_of
from delta_calibration.history.ledger import Compared, Failure, Ledger
from delta_calibration.history.store import Entry, open_store
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot
from delta_calibration.simulation import draw_machine, simulate_session


def page(robot: Robot, out: Path, seed: int) -> None:
    """Write the page of 200 machines; results are one real fit with random verdicts."""
    rng = np.random.default_rng([seed, 200])
    machine = draw_machine(robot, seed)
    plan = make_plan("identify", robot, count=24, seed=seed)
    seen = survey(
        simulate_session(machine, plan, seed), robot.joints.names, robot.commanded.joint_size
    )
    made = made_of(seen, robot, seed, diagnose)
    fit = entry_of("m", "s", "/sessions/m/s", "0" * 64, seen.poses, *made)
    day = datetime(2026, 6, 1, tzinfo=timezone.utc)
    with TemporaryDirectory() as folder:
        url = str(Path(folder) / "fleet.sqlite")
        with open_store(url, make=True) as store:
            ledger = Ledger(store)
            for number in range(200):
                _add_machine(ledger, robot, fit, number, day, rng)
        run_verb(["fleet", "report", "--store", url, "--on", f"{day:%Y-%m-%d}", "--out", str(out)])


def _add_machine(
    ledger: Ledger,
    robot: Robot,
    fit: Entry,
    number: int,
    day: datetime,
    rng: np.random.Generator,
) -> None:
    """Add a machine with sessions: most are fine, 12 % have a cause, a batch shares one."""
    name, sessions = f"press_{number:03d}", int(rng.integers(2, 6))
    last = day - timedelta(days=float(rng.exponential(30.0)))
    verdict = _verdict(fit, robot, number, rng)
    for k in range(sessions):
        began = last - timedelta(days=30.0 * (sessions - 1 - k))
        entry = replace(
            fit,
            machine=name,
            id=f"{began:%Y-%m-%d}",
            sha256=hashlib.sha256(f"{name} {k}".encode()).hexdigest(),
            began=began,
            verdict=verdict if k == sessions - 1 else fit.verdict,
        )
        ledger.keep(entry, "srbd", robot.machine_hash)
    changes: tuple[dict[str, Any], ...] = ()
    if rng.random() < 0.06:
        entries = ledger.store.sessions(name)
        what, where = str(rng.choice(["backlash", "arm_length"])), f"joint_{rng.integers(1, 4)}"
        change = {"after": entries[-2].id, "before": entries[-1].id, "what": what}
        signal = float(rng.exponential(3000.0))
        changes = ({**change, "location": where, "signal": signal},)
    ledger.keep_compared(Compared(name, "", changes))
    if rng.random() < 0.02:
        ledger.fail(Failure(name, "last_week", "", "last_week: holds no tracker readings"))


def _verdict(fit: Entry, robot: Robot, number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Verdict of a fit with causes drawn for a machine; machines 60 to 73 are the batch."""
    assert fit.verdict is not None
    verdict: dict[str, Any] = {**fit.verdict, "findings": []}
    left = float(rng.lognormal(np.log(0.015), 0.15))
    verdict["calibrated"] = verdict["extended"] = {"model": "m", "held_out_rms_mm": left}
    every = {effect.cause: effect for effect in catalogue(robot, robot.model())}
    batch = 60 <= number < 74
    if batch or rng.random() < 0.12:
        cause = "transmission_error" if batch else str(rng.choice(list(every)))
        effect, size = every[cause], float(rng.lognormal(np.log(0.06), 0.5))
        remedy = effect.remedy
        where = f"joint_{rng.integers(1, 4)}" if effect.parameters.items[0].location else None
        orders = {"order": float(rng.normal(33.0, 0.02))} if batch else {}
        finding = {
            "cause": cause,
            "location": where,
            "kind": effect.kind,
            "shape": orders,
            "action": {
                "do": remedy.do,
                "part": f"{remedy.part} of {where}" if where else remedy.part,
            },
        }
        verdict["findings"] = [finding]
        verdict["calibrated"] = {"model": "m", "held_out_rms_mm": float(np.hypot(left, size))}
    elif rng.random() < 0.03:
        unknown = {
            "found": True,
            "moves_with": "position",
            "rms_mm": float(rng.uniform(0.01, 0.05)),
        }
        verdict["unknown_structure"] = {**verdict["unknown_structure"], **unknown}
    return verdict
