"""Time of one call of an exported machine in C99, as `delta-cal export --format c` writes it.

    python benchmarks/export_c.py                     a table, some minutes
    python benchmarks/export_c.py --calls 1000        fewer calls for each row
    python benchmarks/export_c.py --robot srbd cdpr8  some robots only

A program in C calls `correct` for one command after the other, in motion and with a payload, and
times each call with the monotonic clock (which itself takes some 30 ns). It is compiled by `cc
-O2`. Machines and effects are those of `commands.py`. Every command is called many times. `slowest
command` is the largest of the medians of the commands, which is a property of the code; `p99` and
`longest` are over all calls and include whatever else the computer does. The columns of `one
command` repeat the first command, whose computation never changes, and show the scatter of the
computer alone. `corrected` is the share of the commands that were corrected; the others were
rejected by a guard.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from commands import AT_ONCE, COMMANDS, DELTA, MODELS, conditions, known, live
from delta_calibration.calibration import Calibration
from delta_calibration.effects import Effect
from delta_calibration.export import c_files
from delta_calibration.plans import make_plan
from delta_calibration.robot import known_robots, load_robot

PROGRAM = r"""
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "machine.h"

static int by_size(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double between(struct timespec begin, struct timespec end) {
    return 1e6 * (double)(end.tv_sec - begin.tv_sec)
           + 1e-3 * (double)(end.tv_nsec - begin.tv_nsec);
}

/* Median, p99 and longest of the calls; sorts them. */
static void tell(double *times, int calls) {
    qsort(times, (size_t)calls, sizeof(double), by_size);
    printf("%.2f %.2f %.2f ", times[calls / 2], times[calls - 1 - calls / 100], times[calls - 1]);
}

/* Largest median of a command. */
static double slowest(const double *times, int calls, int count) {
    const int repeats = calls / count;
    double *own = malloc(sizeof(double) * (size_t)repeats), most = 0.0;
    for (int command = 0; own && command < count; command++) {
        for (int i = 0; i < repeats; i++) own[i] = times[i * count + command];
        qsort(own, (size_t)repeats, sizeof(double), by_size);
        if (own[repeats / 2] > most) most = own[repeats / 2];
    }
    free(own);
    return most;
}

int main(int argc, char **argv) {
    static double numbers[100000];
    const int count = argc == 3 ? atoi(argv[1]) : 0, calls = argc == 3 ? atoi(argv[2]) : 0;
    const int row = 4 * CORRECT_JOINTS;
    double *times = malloc(sizeof(double) * (size_t)calls), out[CORRECT_JOINTS];
    struct timespec begin, end;
    conditions same;
    int corrected = 0;
    if (count < 1 || calls < count || !times) return 1;
    for (int i = 0; i < count * row; i++)
        if (scanf("%lf", &numbers[i]) != 1) return 1;
    for (int call = 0; call < calls; call++) {
        const double *given = numbers + (call % count) * row;
        conditions at;
        conditions_at_rest(&at);
        for (int i = 0; i < CORRECT_JOINTS; i++) {
            at.rate[i] = given[CORRECT_JOINTS + i];
            at.acceleration[i] = given[2 * CORRECT_JOINTS + i];
            at.direction[i] = given[3 * CORRECT_JOINTS + i];
        }
        at.payload = 1.0;
        at.payload_centre[0] = at.payload_centre[1] = at.payload_centre[2] = 0.0;
#if CORRECT_TEMPERATURES
        for (int i = 0; i < CORRECT_TEMPERATURES; i++) at.temperature[i] = 25.0;
#endif
        if (call == 0) same = at;
        clock_gettime(CLOCK_MONOTONIC, &begin);
        corrected += correct(given, &at, out) == CORRECT_PASSED;
        clock_gettime(CLOCK_MONOTONIC, &end);
        times[call] = between(begin, end);
    }
    printf("%.2f ", slowest(times, calls, count));
    tell(times, calls);
    printf("%.1f ", 100.0 * corrected / calls);
    for (int call = 0; call < calls; call++) {
        clock_gettime(CLOCK_MONOTONIC, &begin);
        correct(numbers, &same, out);
        clock_gettime(CLOCK_MONOTONIC, &end);
        times[call] = between(begin, end);
    }
    tell(times, calls);
    printf("\n");
    free(times);
    return 0;
}
"""


COLUMNS = (
    "slowest command [us]",
    "p50 [us]",
    "p99 [us]",
    "longest [us]",
    "corrected [%]",
    "one command: p50 [us]",
    "p99 [us]",
    "longest [us]",
    "room [kB]",
)


def cases(names: list[str], each: bool) -> Iterator[tuple[str, str | None, tuple[Effect, ...]]]:
    """Yield the robots, models and effects that are timed."""
    for name in names:
        robot = load_robot(name)
        for model in MODELS if name == DELTA else (None,):
            yield name, model, ()
            effects = live(robot, model or robot.mechanism)
            if name == DELTA:
                yield name, model, tuple(e for e in effects if e.cause in AT_ONCE)
            if each:
                for effect in effects:
                    yield name, model, (effect,)


def measured(calibration: Calibration, calls: int) -> list[float]:
    """Values of one row, see `COLUMNS`: times [us], percentage corrected, memory [kB]."""
    files = c_files(calibration, "machine")
    robot = calibration.robot
    q = make_plan("identify", robot, count=COMMANDS, both_sides=False).joint
    at = conditions(q)
    rows = np.hstack([q, at.velocity, at.acceleration, at.direction])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in (
            ("machine.h", files.header),
            ("machine.c", files.source),
            ("time.c", PROGRAM),
        ):
            (folder / file).write_text(text, encoding="utf-8")
        compiler = ["cc", "-std=c99", "-O2", "-o", "time", "time.c", "machine.c", "-lm"]
        subprocess.run(compiler, cwd=folder, check=True)
        said = subprocess.run(
            [str(folder / "time"), str(len(q)), str(calls)],
            input=" ".join(map(repr, rows.ravel().tolist())),
            text=True,
            capture_output=True,
            check=True,
        )
    scratch = next(line for line in files.header.splitlines() if "CORRECT_ROOM" in line)
    return [*map(float, said.stdout.split()), 8e-3 * float(scratch.split()[2])]


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=20_000, help="calls timed for each row")
    parser.add_argument(
        "--robot", nargs="*", default=list(known_robots()), help="names of the robots"
    )
    parser.add_argument("--each", action="store_true", help="also each effect by itself")
    asked = parser.parse_args()
    print(f"| robot | model | effects | {' | '.join(COLUMNS)} |")
    print("|---" * (3 + len(COLUMNS)) + "|")
    for name, model, effects in cases(asked.robot, asked.each):
        calibration = known(load_robot(name), model, effects)
        causes = ", ".join(effect.cause for effect in effects) or "none"
        numbers = " | ".join(f"{x:.1f}" for x in measured(calibration, asked.calls))
        print(
            f"| {name} | {calibration.chain.mechanism.name} | {causes} | {numbers} |", flush=True
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
