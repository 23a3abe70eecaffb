# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # From a recorded session to corrected commands
#
# `bags/srbd_plain` is a session of a simulated Delta whose parts deviate from the drawing. Its
# joints were commanded to some places, and a laser tracker measured the position of the tool.
# Open this file with Jupyter (jupytext) from the folder of the repository.

# %%
from delta_calibration.notebook import open_session

session = open_session("bags/srbd_plain", robot="srbd")
session

# %% [markdown]
# The measured data, one row per pose at rest: encoder angles of the joints, and position of the
# reflector in the tracker's frame.

# %%
session.to_frame().head()

# %% [markdown]
# The fit identifies dimensions, reflector offset and tracker frame together. The *error left* is
# computed at places that the fit has not seen ([glossary](../glossary.md)).

# %%
found = session.fit()
found

# %%
table = found.to_frame()
table[table["deviation"].abs() > 3 * table["std"]]

# %%
found.plot_residuals()

# %% [markdown]
# Joint commands that bring the tool to five targets. The last target is out of reach, which its
# status shows.

# %%
targets = [[0, 0, -750], [200, 0, -750], [0, 200, -700], [-100, -100, -700], [2000, 0, -750]]
commands = found.compensate(targets)
commands[["x_mm", "y_mm", "z_mm", "joint_1_rad", "joint_2_rad", "joint_3_rad", "status"]]

# %%
assert list(commands["status"]) == ["corrected"] * 4 + ["out_of_reach"]
found.save("calibration.yaml")
