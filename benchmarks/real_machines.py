"""Measurements of real machines: what the models and the diagnosis find in them.

python benchmarks/real_machines.py [--data ../shared/real] [--out docs/real] [machine ...]

With `--out` the pictures of the pages in docs/ and the verdicts as JSON are written to a folder.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import real_hangprinter
import real_ur10
import real_v400
import ur10_pictures
import v400_pictures
from delta_calibration.report import Report, Section, write_figures
from delta_calibration.report.drawing import Figure

DATA = Path(__file__).resolve().parents[2] / "shared" / "real"


def hangprinter(folder: Path, out: Path | None) -> list[Figure]:
    """A cable robot: verdict from its own closures."""
    return real_hangprinter.report(folder, out)


def v400(folder: Path, out: Path | None) -> list[Figure]:
    """A linear Delta: 19 data, and bed meshes."""
    del out  # no verdict: these data show nothing beyond geometry
    real_v400.report(folder)
    return v400_pictures.figures(folder)


def ur10(folder: Path, out: Path | None) -> list[Figure]:
    """A serial arm: blocks of time held out; its verdicts are made by `delta-cal diagnose`."""
    del out
    return ur10_pictures.figures(*real_ur10.report(folder))


MACHINES: dict[str, tuple[str, Callable[[Path, Path | None], list[Figure]]]] = {
    "hangprinter": ("hangprinter", hangprinter),
    "v400": ("v400_linear_delta", v400),
    "ur10": ("ur10_lasertracker", ur10),
}


def main() -> int:
    """Print the results, and draw figures with `--out`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--out", type=Path, default=None)
    parser.add_argument("machines", nargs="*", metavar="machine", help=", ".join(MACHINES))
    given = parser.parse_args()
    unknown = sorted(set(given.machines) - set(MACHINES))
    if unknown:
        parser.error(f"no machine {', '.join(unknown)}; there are: {', '.join(MACHINES)}")
    for name in given.machines or MACHINES:
        folder, report = MACHINES[name]
        if not (given.data / folder).is_dir():
            print(f"{given.data / folder} is not there", file=sys.stderr)
            return 2
        drawn = report(given.data / folder, given.out)
        if given.out is not None:
            section = Section(name, name, figures=tuple(drawn))
            write_figures(Report(name, "", "", (), (), (section,)), given.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
