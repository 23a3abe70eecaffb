"""Read the data that `standing.py` needs of each machine from a store."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

from delta_calibration.fleet.standing import Known, Measured
from delta_calibration.history.ledger import Compared, Ledger, hash_of_sessions
from delta_calibration.history.store import Entry


def known_machines(ledger: Ledger) -> Iterator[Known]:
    """Yield the machines of a store, one at a time, by name."""
    failed = defaultdict(list)
    for failure in ledger.failures():
        failed[failure.machine].append(f"{failure.id}: {failure.told}")
    compared = ledger.compared()
    for machine, robot in ledger.store.machines():
        entries = ledger.store.sessions(machine)
        last = compared.get(machine)
        changes = () if last is None else last.changes
        sessions, whole = tuple(map(_measured, entries)), _is_whole(last, entries)
        yield Known(machine, robot, sessions, changes, tuple(failed.pop(machine, ())), whole)


def never_measured(ledger: Ledger) -> dict[str, tuple[str, ...]]:
    """Machines without any result, with the error messages of their sessions."""
    known = dict(ledger.store.machines())
    failed = defaultdict(list)
    for failure in ledger.failures():
        if failure.machine not in known:
            failed[failure.machine].append(f"{failure.id}: {failure.told}")
    return {machine: tuple(said) for machine, said in failed.items()}


def _is_whole(last: Compared | None, entries: Sequence[Entry]) -> bool:
    """Whether the last comparison was of all sessions; a single one needs none."""
    if len(entries) < 2:
        return True
    digest = hash_of_sessions(entry.sha256 for entry in entries)
    return last is not None and not last.told and last.sessions_sha256 == digest


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
