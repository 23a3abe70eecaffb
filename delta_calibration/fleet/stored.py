"""Read the data that `standing.py` needs of each machine from a store."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

from delta_calibration.fleet.standing import Known, Measured
from delta_calibration.history.ledger import Ledger
from delta_calibration.history.store import Entry


def known_machines(ledger: Ledger) -> Iterator[Known]:
    """Yield the machines of a store, one at a time, by name."""
    failed = defaultdict(list)
    for failure in ledger.failures():
        failed[failure.machine].append(f"{failure.id}: {failure.told}")
    compared = ledger.compared()
    for machine, robot in ledger.store.machines():
        entries = ledger.store.sessions(machine)
        changes = compared[machine].changes if machine in compared else ()
        sessions = tuple(map(_measured, entries))
        yield Known(machine, robot, sessions, changes, tuple(failed.pop(machine, ())))


def never_measured(ledger: Ledger) -> dict[str, tuple[str, ...]]:
    """Machines without any result, with the error messages of their sessions."""
    known = dict(ledger.store.machines())
    failed = defaultdict(list)
    for failure in ledger.failures():
        if failure.machine not in known:
            failed[failure.machine].append(f"{failure.id}: {failure.told}")
    return {machine: tuple(said) for machine, said in failed.items()}


def _measured(entry: Entry) -> Measured:
    calibration = entry.calibration
    return Measured(
        entry.id,
        entry.began,
        entry.verdict,
        entry.error_left_mm,
        float(calibration["noise"]["floor_mm"]),
        int(calibration["provenance"]["poses"]),
        entry.is_update,
    )
