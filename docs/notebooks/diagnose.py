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
# # Errors that the geometry does not explain
#
# In the session `bags/srbd_backlash` a joint has backlash, which no dimension of the machine can
# explain. The calibrated model leaves an error many times the noise; the diagnosis names its
# cause.

# %%
from delta_calibration.notebook import open_session

session = open_session("bags/srbd_backlash", robot="srbd")
found = session.fit()
found

# %%
verdict = session.diagnose()
verdict

# %% [markdown]
# The identified values in SI units with their standard errors; then the errors of all poses, each
# predicted by a fit that has not seen it.

# %%
verdict.to_frame()

# %%
verdict.plot_residuals()

# %% [markdown]
# The errors of single poses with the calibrated geometry, averaged by the side from which joint 2
# reached the pose: they depend on that side.

# %%
residuals = found.residuals()
side = session.survey.poses.direction[:, 1]
residuals.groupby(side)[["calibrated_dx_mm", "calibrated_dy_mm", "calibrated_dz_mm"]].mean()

# %%
assert list(verdict.to_frame()["cause"]) == ["backlash"]
verdict.save("extended.yaml")
