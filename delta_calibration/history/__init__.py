"""One machine over months: its sessions kept together, and what changed between them.

`store.py` needs SQLAlchemy (`pip install 'delta_calibration[history]'`); the rest does not.
"""

from delta_calibration.history.changes import Change, History, find_changes
from delta_calibration.history.pooled import Dated
from delta_calibration.history.steps import Part, Step, Steps

__all__ = ["Change", "Dated", "History", "Part", "Step", "Steps", "find_changes"]
