"""Calibration, diagnosis and compensation of parallel robots from measured data.

What `delta-cal fit` does, in Python (no ROS needed):

```python
from pathlib import Path

from delta_calibration.calibration_file import save_calibration
from delta_calibration.estimation import identify
from delta_calibration.recording import read_session
from delta_calibration.robot import load_robot
from delta_calibration.data import collect

robot = load_robot("srbd")
poses = collect(read_session("bags/srbd_plain"), robot.joints.names)
found = identify(poses, robot)
left, before = found.full.held_out, found.frame_only.held_out
print(f"{1e3 * left:.4f} mm are left, {1e3 * before:.4f} before")
save_calibration(Path("calibration.yaml"), found, robot, poses)
```

- `recording`: reads and writes sessions (rosbag2 folders), imports tables of other systems
- `data`: sessions, their poses at rest and motions
- `robot`, `mechanisms`: the robot file, and the kinematic models it selects
- `estimation`, `diagnosis`, `effects`: geometric identification, search for non-geometric causes,
  the catalogue of effects; `papers`: identification methods of the papers
- `calibration`, `calibration_file`: the identified robot, and its file
- `compensation`: joint commands that put the tool where it was meant to be
- `simulation`, `plans`, `accuracy`: a machine with errors, measurement plans, ISO 9283
- `report`: figures, tables, the page
- `notebook`: the same functions in a notebook: `open_session`, tables and plots
- `cli`: `delta-cal`; `cell`, `ros`: the live cell and its nodes
"""

__version__ = "0.2.0"
