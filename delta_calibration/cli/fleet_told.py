"""Console output of `delta-cal fleet`: each result as it arrives, and priors."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import click
from tqdm import tqdm

from delta_calibration.wording import plain, spoken

if TYPE_CHECKING:  # needs a cluster's library
    from delta_calibration.fleet.run import Result


class Told:
    """Prints results as they arrive, and counts them."""

    def __init__(self, sessions: int, verbose: bool) -> None:
        """Start with none of so many sessions done."""
        self.counts: Counter[str] = Counter()
        self.bar = tqdm(total=sessions, unit="session", delay=1.0, disable=None, leave=False)
        self._verbose = verbose

    def __call__(self, result: Result, new: bool) -> None:
        """Print and count a result; `new` if it has just been written to the history."""
        from delta_calibration.fleet.work import There
        from delta_calibration.history.ledger import Compared, Failure

        if isinstance(result, Compared):
            self.counts["changes"] += len(result.changes)
            if result.told:
                self._say(f"not compared: {result.machine}: {result.told}", True)
            for change in result.changes:
                self._say(f"{result.machine}: {change['told']}")
            return
        self.bar.update()
        name = f"{result.machine}/{result.id}"
        if isinstance(result, Failure):
            self.counts["failed"] += 1
            self._say(f"failed: {name}: {result.told}", True)
        elif isinstance(result, There):
            self.counts["failed" if result.failed else "there"] += 1
            state = "failed before (--again tries it once more)" if result.failed else "there"
            self._say(f"{state}: {name}")
        else:
            self.counts["added" if new else "there"] += 1
            state = "added" if new else "there"
            self._say(f"{state}: {name}; {result.found}")

    def _say(self, text: str, always: bool = False) -> None:
        if always or self._verbose:
            with tqdm.external_write_mode():
                click.echo(plain(text), err=always)

    def summary(self, machines: int) -> str:
        """Counts of all results, in one line."""
        of = self.counts
        return (
            f"{of['added']} sessions added, {of['there']} already there, {of['failed']} failed, "
            f"of {machines} machines; {of['changes']} changes found"
        )


def priors_told(document: dict[str, Any]) -> str:
    """Text of the priors: spread of the machines over the tolerances, outliers, and causes."""
    known = [p for p in document["parameters"] if p["machines_worth"] >= 1.0]
    ratio = sorted(p["spread"] / p["tolerance"] for p in known)
    odd: dict[str, list[str]] = {}
    for each in document["odd"]:
        odd.setdefault(each["machine"], []).append(each["parameter"])
    lines = [
        f"{document['machines']} machines, {document['sessions']} sessions; "
        f"{len(known)} of {len(document['parameters'])} dimensions are determined by them"
    ]
    if ratio:
        lines.append(f"their spread is {ratio[len(ratio) // 2]:.2f} of the tolerance (median)")
    lines += [f"unusual: {machine}: {', '.join(names)}" for machine, names in sorted(odd.items())]
    common = {effect["cause"] for effect in document["effects"]}
    lines += [
        f"{spoken(e['cause'])}: found in {e['found_in']} of {e['of']} machines"
        + ("; expected for the next machine" if e["cause"] in common else "")
        for e in document["causes"]
        if e["found_in"]
    ]
    return "\n".join(lines)
