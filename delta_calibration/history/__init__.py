"""One machine over months: its sessions kept together, and what changed between them.

`store.py` needs SQLAlchemy (`pip install 'delta_calibration[history]'`); the rest does not.
"""

from delta_calibration.history.changes import Change, History, find_changes
from delta_calibration.history.continual import Prospect, prospect
from delta_calibration.history.pooled import Dated
from delta_calibration.history.steps import Steps
from delta_calibration.history.walk import Part, Step, Walk

__all__ = [
    "Change",
    "Dated",
    "History",
    "Part",
    "Prospect",
    "Step",
    "Steps",
    "Walk",
    "find_changes",
    "prospect",
]
