"""How often chance coincidences are reported as shared causes, and how often batches are found.

Fleets have 200 machines and 22 causes at three joints. Each machine has a cause with that cause's
own rate: 1.5 % in the median, with the stated standard deviation of its logarithm between causes.
The machines of a batch have one more.
"""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Any

import numpy as np

from delta_calibration.fleet.shared import PERHAPS, SURE, shared_causes
from delta_calibration.fleet.standing import FINE, Standing

MACHINES, CAUSES, PLACES = 200, 22, 3
DAY = datetime(2026, 6, 1, tzinfo=timezone.utc)
BATCHES = (8, 14, 20, 30)


def drawn(rng: np.random.Generator, spread: float, batch: int) -> list[Standing]:
    """Draw a fleet; the first machines are the batch."""
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
        alarms = [_surest(drawn(rng, spread, 0), "") for _ in range(trials)]
        print(f"rates spread by {spread:g} (ln): {_told(alarms)}: false alarms")
        for batch in BATCHES:
            found = [_surest(drawn(rng, spread, batch), "gear") for _ in range(trials // 5)]
            print(f"  batch of {batch}: {_told(found)}", flush=True)


def _surest(fleet: list[Standing], what: str) -> float:
    """Smallest p value of the (perhaps) shared causes that begin with `what`; else 1."""
    told = shared_causes(fleet, CAUSES, PLACES)
    return min((each.p_value for each in told if each.what.startswith(what)), default=1.0)


def _told(p_values: list[float]) -> str:
    sure, any_ = (sum(p < limit for p in p_values) for limit in (SURE, PERHAPS))
    return f"shared {sure}, at least perhaps {any_} of {len(p_values)} fleets"
