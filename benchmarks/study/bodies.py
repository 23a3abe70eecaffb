"""Study of the diagnosis on rigid bodies with springs, gaps and friction in a physics engine.

    PYTHONPATH=test:benchmarks python -m study.bodies --seed 21

A Delta of rigid bodies (test/physics, MuJoCo; extra `[physics]`) with one or two faults executes a
plan and is diagnosed from its session. `make study` runs it.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

for library in ("OPENBLAS", "MKL", "OMP"):  # one thread a process: the matrices are small
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import click
import numpy as np

from delta_calibration.data import survey
from delta_calibration.diagnosis import Diagnosis, diagnose
from delta_calibration.robot import load_robot
from physics.machine import ELBOW_END, PLATFORM_END, from_the_workshop
from physics.plan import HEAVY, circles, stops
from physics.session import measured

_SPRING, _ROD, _MOUNT = 2.5e4, 1e6, 2e6  # [N m/rad], [N/m], [N/m]
_GAP, _CLEARANCE = 0.3e-3, 20e-6  # [rad], [m]
_HELD = "backlash held by weight"


@dataclass(frozen=True)
class Case:
    """One kind of machine, and how it is measured.

    Attributes:
        name: in words.
        faults: of the machine, see `physics.machine.Machine`.
        causes: that a verdict has to name, all of them and nothing else.
        values: true value of a parameter of a finding, by the begin of its name.
        moves: whether circles are measured as well.
        reach: of the places from the middle of the workspace [m].
        told: what `cannot_tell` has to contain, if anything.
        nameless: whether the hidden fault is not in the catalogue: unknown structure is right.
    """

    name: str
    faults: Mapping[str, Any] = field(default_factory=dict)
    causes: tuple[str, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    moves: bool = False
    reach: float = 0.4
    told: str = ""
    nameless: bool = False


_GIVE = {"compliance": 1 / _SPRING}
_STRETCH = {"rod_compliance": 1 / _ROD}
_SINKS = {"give": 1 / _MOUNT}
CASES = (
    Case("nothing"),
    Case("nothing, measured in motion as well", moves=True),
    Case("drive springs", {"drive": _SPRING}, ("joint_compliance",), _GIVE),
    Case(
        "drive springs, in motion as well",
        {"drive": _SPRING},
        ("joint_compliance",),
        _GIVE,
        moves=True,
    ),
    Case(
        "springy rods, in motion as well",
        {"rod_spring": _ROD},
        ("forearm_compliance",),
        _STRETCH,
        moves=True,
    ),
    Case(
        "drive springs and springy rods, in motion as well",
        {"drive": _SPRING, "rod_spring": _ROD},
        ("joint_compliance", "forearm_compliance"),
        _GIVE | _STRETCH,
        moves=True,
    ),
    Case("backlash under friction", {"gap": _GAP, "friction": 20.0}, ("backlash",), {"gap": _GAP}),
    Case(
        "backlash under friction and weight",
        {"gap": _GAP, "friction": 3.0},
        ("backlash",),
        {"gap": _GAP},
    ),
    Case("backlash under weight", {"gap": _GAP}, ("backlash",), {"gap": _GAP}, reach=0.5),
    Case("backlash closed by weight", {"gap": _GAP}, reach=0.15, told=_HELD),
    Case(
        "backlash and drive springs under weight and friction",
        {"gap": _GAP, "friction": 3.0, "drive": _SPRING},
        # friction winds the spring up by its torque: the arm also sticks
        ("backlash", "joint_compliance", "stick_slip"),
        {"gap": _GAP, "friction": 3.0 / _SPRING} | _GIVE,
    ),
    Case(
        "worn at the platform",
        {"clearance": _CLEARANCE, "worn": PLATFORM_END},
        ("ball_joint_clearance",),
        {"clearance": _CLEARANCE},
    ),
    Case(
        "worn at the elbow",
        {"clearance": _CLEARANCE, "worn": ELBOW_END},
        ("ball_joint_clearance",),
        {"clearance": _CLEARANCE},
    ),
    Case("base on soft mounts", {"mount": 2e6}, nameless=True),
    Case("base on soft feet", {"mount": _MOUNT, "feet": 1.2}, ("base_compliance",), _SINKS),
    Case(
        "base on soft feet, in motion as well",
        {"mount": _MOUNT, "feet": 1.2},
        ("base_compliance",),
        _SINKS,
        moves=True,
    ),
    Case(
        "friction that winds up drive springs",
        {"friction": 3.0, "drive": _SPRING},
        # the same signal as play; the verdict has to say so
        ("backlash", "joint_compliance"),
        {"gap": 2 * 3.0 / _SPRING} | _GIVE,
        told="stick_slip",
    ),
)


def judge(number: int, seed: int) -> dict[str, Any]:
    """Outcome of one case, ready for JSON."""
    case, rng = CASES[number], np.random.default_rng([seed, number])
    machine = from_the_workshop(rng).with_(**case.faults)
    items = stops(rng, 30, reach=case.reach)
    if case.moves:
        for payload in (0.0, HEAVY):
            items += circles(items[-1].command[-1], payload)
    session, robot = measured(machine, items, rng), load_robot("srbd")
    begin = time.process_time()
    found = diagnose(survey(session, robot.joints.names), robot, seed=seed)
    return {"case": case.name, "seed": seed, "seconds": time.process_time() - begin} | _said(
        case, found
    )


def _said(case: Case, found: Diagnosis) -> dict[str, Any]:
    """Content of the verdict, and whether it is right."""
    verdict = found.verdict
    names = [finding.cause for finding in verdict.findings]
    told = [name for item in verdict.cannot_tell for name in item.between]
    unknown = verdict.unknown_structure.found
    right = sorted(names) == sorted(case.causes) and (not unknown or case.nameless)
    values = [
        {"of": name, "true": true, "value": each.value, "std": each.std}
        for finding in verdict.findings
        for name, each in finding.parameters.items()
        for begin, true in case.values.items()
        if name == begin or name.rsplit("_", 1)[0] == begin
    ]
    return {
        "said": names + ["unknown structure"] * unknown,
        "shape": {f.cause: " ".join(f.shape_told()) for f in verdict.findings if f.shape},
        "right": bool(right and (not case.told or case.told in told)),
        "held": _HELD in told,
        "values": values,
        "calibrated_um": 1e3 * verdict.calibrated.held_out_rms_mm,
        "extended_um": 1e3 * verdict.extended.held_out_rms_mm,
    }


def page(outcomes: Sequence[Mapping[str, Any]]) -> str:
    """The outcomes as a Markdown table, one line per case."""
    lines = [
        "| hidden | n | right | reported | error of values, in standard deviations | held out, "
        "calibrated → extended [µm] | CPU [s] |",
        "|---|---:|---:|---|---|---:|---:|",
    ]
    for case in CASES:
        own = [o for o in outcomes if o["case"] == case.name]
        if own:
            lines.append(_line(case, own))
    return "\n".join(lines) + "\n"


def _line(case: Case, own: Sequence[Mapping[str, Any]]) -> str:
    said = dict.fromkeys(_words(o) for o in own)
    off = [(v["value"] - v["true"]) / v["std"] for o in own for v in o["values"]]
    spread = f"{min(off):+.1f} to {max(off):+.1f}" if off else ""
    before, after, took = (
        np.median([o[name] for o in own]) for name in ("calibrated_um", "extended_um", "seconds")
    )
    right = sum(o["right"] for o in own)
    return (
        f"| {case.name} | {len(own)} | {right} | {'; '.join(said)} | {spread} | "
        f"{before:.1f} → {after:.1f} | {took:.0f} |"
    )


def _words(outcome: Mapping[str, Any]) -> str:
    names = [
        f"{name} ({outcome['shape'][name]})" if name in outcome["shape"] else name
        for name in outcome["said"]
    ]
    held = ["(" + _HELD + " cannot be distinguished)"] if outcome["held"] else []
    return " ".join([" + ".join(names) or "nothing", *held])


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--seed", type=click.IntRange(0), default=21, show_default=True)
@click.option(
    "--each", type=click.IntRange(1), default=1, show_default=True, help="Seeds per case."
)
@click.option(
    "--only", multiple=True, metavar="WORDS", help="Only cases whose name contains this."
)
@click.option("--workers", type=click.IntRange(1), default=1, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="JSON file for the outcomes.")
def bodies(seed: int, each: int, only: tuple[str, ...], workers: int, out: Path | None) -> None:
    """Run the study of the diagnosis on rigid bodies."""
    wanted = [
        (number, seed + k)
        for number, case in enumerate(CASES)
        for k in range(each)
        if not only or any(words in case.name for words in only)
    ]
    with ProcessPoolExecutor(workers) as pool:
        outcomes = list(pool.map(judge, *zip(*wanted, strict=True))) if wanted else []
    if out is not None:
        out.write_text(json.dumps(outcomes, indent=1), encoding="utf-8")
    click.echo(page(outcomes))


if __name__ == "__main__":
    bodies()
