"""One diagnosed session that the tests of the report share: backlash, measured at rest."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from blind import hide
from delta_calibration.data import survey
from delta_calibration.diagnosis import Diagnosis, diagnose
from delta_calibration.report import Provenance
from delta_calibration.robot import load_robot

ROBOT = load_robot("srbd")
SEED = 1100
# Names that a page must display and not execute.
JOINTS = ("<script>ask(1)</script>", 'b"onload="ask(2)', "$x_1$ & <b>")
NAME = "</script><img src=x onerror=ask(3)>"
HOSTILE = replace(ROBOT, name=NAME, joints=replace(ROBOT.joints, names=JOINTS))
PROVENANCE = Provenance(
    session=f"session {NAME}",
    session_sha256="5e55" * 16,
    start_ns=1_700_000_000_000_000_000,
    robot=HOSTILE.name,
    robot_source="srbd.yaml",
    robot_sha256=ROBOT.hash,
    seed=7,
    recorded={"plan": '<a href="https://example.org">{{ 7 * 7 }}</a>'},
)


@lru_cache
def hidden():
    """The session and its hidden cause."""
    return hide({"backlash": 1.0}, SEED, "still")


@lru_cache
def found() -> Diagnosis:
    """Diagnosis of the session."""
    return diagnose(survey(hidden().session, ROBOT.joints.names), ROBOT)
