"""Measurements of real machines: what the models make of them.

python benchmarks/real_machines.py [--data ../shared/real] [v400] [ur10]
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import real_ur10
import real_v400

DATA = Path(__file__).resolve().parents[2] / "shared" / "real"
REPORTS = {
    "v400": ("v400_linear_delta", real_v400.report),
    "ur10": ("ur10_lasertracker", real_ur10.report),
}


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("machines", nargs="*", metavar="machine", help=", ".join(REPORTS))
    given = parser.parse_args()
    unknown = sorted(set(given.machines) - set(REPORTS))
    if unknown:
        parser.error(f"no machine {', '.join(unknown)}; there are: {', '.join(REPORTS)}")
    for name in given.machines or REPORTS:
        folder, report = REPORTS[name]
        if not (given.data / folder).is_dir():
            print(f"{given.data / folder} is not there", file=sys.stderr)
            return 2
        report(given.data / folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
