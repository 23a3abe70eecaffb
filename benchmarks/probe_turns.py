"""How much more information on each cause a probe gives by its rotations than by positions alone.

    python benchmarks/probe_turns.py srbd ur10 five_axis cdpr8
    python benchmarks/probe_turns.py --turn-urad 50 srbd

One machine of each robot without a hidden cause is measured by the plan `rich`. For every effect
of the catalogue the table shows the information beside geometry, reflector and frame, summed over
its parameters at their typical sizes: with rotations, with positions alone, and the ratio.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from delta_calibration.data import survey
from delta_calibration.diagnosis.diagnose import calibrated
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.effects import Effect, catalogue
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import draw_machine, simulate_session

SEED = 5


def evidence_of(probed: Robot) -> tuple[LinearizedModel, LinearizedModel]:
    """Evidence of one session, with rotations and by positions alone."""
    plan = make_plan("rich", probed, seed=SEED)
    session = simulate_session(draw_machine(probed, SEED), plan, SEED)
    seen = survey(session, probed.joints.names, probed.commanded.joint_size)
    plain = replace(probed, tracker=replace(probed.tracker, measures="position"))
    return calibrated(seen, probed).evidence, calibrated(seen, plain).evidence


def told(evidence: LinearizedModel, effect: Effect) -> float:
    """Trace of the information matrix of an effect."""
    return float(np.trace(evidence.information(evidence.columns(effect))))


def rows(name: str, turn: float) -> Iterator[str]:
    """Yield table rows, one for each effect that is observable in the session."""
    robot = load_robot(name)
    probed = replace(robot, tracker=replace(robot.tracker, measures="pose", turn=turn))
    both = evidence_of(probed)
    for effect in catalogue(probed, both[0].chain.mechanism):
        if effect.missing(both[0].at):
            continue
        shape = next(iter(effect.shapes(both[0].at)))
        with_turns, without = (told(evidence, shape) for evidence in both)
        if without > 1.0:
            ratio = with_turns / without
            yield f"| {name} | {effect.cause} | {with_turns:.0f} | {without:.0f} | {ratio:.2f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("robots", nargs="+")
    parser.add_argument("--turn-urad", type=float, default=20.0)
    options = parser.parse_args()
    print("| robot | cause | with turns | positions alone | ratio |\n|---|---|---|---|---|")
    for name in options.robots:
        for row in rows(name, 1e-6 * options.turn_urad):
            print(row, flush=True)


if __name__ == "__main__":
    main()
