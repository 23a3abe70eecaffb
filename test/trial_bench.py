"""One blind trial: a machine of the independent generator, its session diagnosed and evaluated."""

from __future__ import annotations

from delta_calibration.robot import load_robot
from study.judge import judge
from study.trials import Task

ROBOT = load_robot("srbd")
SIGNAL = 600.0  # lambda, well above the 160 that a name needs


def trial(seed: int, *causes: tuple[str, float], **options) -> dict:
    return judge(Task("test", seed, causes, **options).key)
