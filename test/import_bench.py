"""Tables and mappings for the tests of `delta-cal import`."""

from __future__ import annotations

import csv

import numpy as np
from ruamel.yaml import YAML

from delta_calibration.cli.main import run
from delta_calibration.data import collect
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

SRBD = load_robot("srbd")
JOINTS = ("q1", "q2", "q3")


def measured():
    """A session, and its poses at rest."""
    machine = draw_machine(SRBD, 5)
    plan = make_plan("identify", SRBD, count=24, seed=5)
    session = simulate_session(machine, plan, 5)
    return session, collect(session, SRBD.joints.names)


def mapping_of(**changes):
    """Mapping for a table of stops in degrees and millimetres."""
    mapping = {
        "schema": 1,
        "rows": "stops",
        "commands": [
            {"joint": joint, "column": column, "unit": "deg"}
            for joint, column in zip(SRBD.joints.names, JOINTS, strict=True)
        ],
        "position": {"columns": ["x", "y", "z"], "unit": "mm"},
    }
    return {key: value for key, value in {**mapping, **changes}.items() if value is not None}


def stops(poses):
    """Header and rows of the poses, in degrees and millimetres."""
    joint, point = np.degrees(poses.joint), 1e3 * poses.point
    return [*JOINTS, "x", "y", "z"], [[*map(repr, r)] for r in np.hstack([joint, point]).tolist()]


def imported(folder, head, rows, mapping, robot="srbd", code=0):
    """Write table and mapping, run the verb; return the folder of the session."""
    number = len(list(folder.iterdir()))
    table, yaml, out = (folder / f"{number}{end}" for end in (".csv", ".yaml", "_session"))
    with table.open("w", newline="") as file:
        csv.writer(file, delimiter=mapping.get("delimiter", ",")).writerows([head, *rows])
    YAML(typ="safe").dump(mapping, yaml)
    verb = ["import", str(table), "--mapping", str(yaml), "--robot", robot, "--out", str(out)]
    assert run(verb) == code
    return out


def refused(capsys, folder, head, rows, mapping, robot="srbd"):
    """The one line of error that the verb prints, without the file's name."""
    out = imported(folder, head, rows, mapping, robot, code=2)
    assert not out.exists()
    text = capsys.readouterr().err.strip()
    assert "Traceback" not in text
    return text.splitlines()[-1]
