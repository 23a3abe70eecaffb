"""How often causes are told as shared that machines have by chance, and batches that are there.

Fleets of 200 machines and 22 causes at three joints; each machine has a cause with the cause's own
rate, 1.5 % in the middle, e-fold spread from cause to cause where told so. A batch has one more.
"""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Any

import numpy as np

from delta_calibration.fleet.shared import shared_causes
from delta_calibration.fleet.standing import FINE, Standing

MACHINES, CAUSES, PLACES = 200, 22, 3
DAY = datetime(2026, 6, 1, tzinfo=timezone.utc)
BATCHES = (8, 14, 20, 30)


def drawn(rng: np.random.Generator, spread: float, batch: int) -> list[Standing]:
    """A fleet; the first machines are of the batch."""
    rates = np.minimum(0.015 * np.exp(spread * rng.standard_normal(CAUSES)), 0.1)
    fleet = []
    for number in range(MACHINES):
        has = [f"cause_{k}" for k in np.flatnonzero(rng.random(CAUSES) < rates)]
        causes: list[dict[str, Any]] = [
            {"cause": cause, "location": f"joint_{rng.integers(1, PLACES + 1)}"} for cause in has
        ]
        if number < batch:
            gear = {"cause": "gear", "location": f"joint_{rng.integers(1, PLACES + 1)}"}
            causes.append({**gear, "shape": {"order": float(rng.normal(27.0, 0.02))}})
        fleet.append(
            Standing(f"m{number}", "r", FINE, "", "", DAY, 1, 0.01, 0.0, tuple(causes), (), ())
        )
    return fleet


def shared(trials: int, seed: int) -> None:
    """Print the rates."""
    rng = np.random.default_rng([seed, 22])
    for spread in (0.0, 0.5, 1.0):
        alarms = sum(
            bool(shared_causes(drawn(rng, spread, 0), CAUSES, PLACES)) for _ in range(trials)
        )
        print(f"rates spread by {spread:g} (ln): {alarms} false alarms in {trials} fleets")
        for batch in BATCHES:
            found = [
                shared_causes(drawn(rng, spread, batch), CAUSES, PLACES)
                for _ in range(trials // 5)
            ]
            right = sum(any(each.what.startswith("gear") for each in one) for one in found)
            print(f"  batch of {batch}: found in {right} of {len(found)}", flush=True)
