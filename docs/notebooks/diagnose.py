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
# # What the model gets wrong
#
# In `bags/srbd_backlash` a joint has play, which no dimension of the machine can explain. The
# calibrated model leaves an error many times the noise; the diagnosis says why.

# %%
from delta_calibration.notebook import open_session

session = open_session("bags/srbd_backlash", robot="srbd")
found = session.fit()
found

# %%
verdict = session.diagnose()
verdict

# %% [markdown]
# Each value that was found, in SI, with its standard error; then the errors of all poses, each
# predicted by a fit that had not seen it.

# %%
verdict.to_frame()

# %%
verdict.plot_residuals()

# %% [markdown]
# The errors of single poses, before and after the geometry was fitted: what is left goes with the
# side that a pose was reached from.

# %%
residuals = found.residuals()
side = session.survey.poses.direction[:, 1]
residuals.groupby(side)[["calibrated_dx_mm", "calibrated_dy_mm", "calibrated_dz_mm"]].mean()

# %%
assert list(verdict.to_frame()["cause"]) == ["backlash"]
verdict.save("extended.yaml")
