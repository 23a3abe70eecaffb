"""Plot of the errors of all poses over time, for notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.report.drawing import BEFORE, CALIBRATED, EXTENDED, INK
from delta_calibration.report.missing import required

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes

Array = NDArray[np.float64]

_LOOKS = {"before": (BEFORE, "o"), "calibrated": (CALIBRATED, "s"), "extended": (EXTENDED, "^")}


def plot_errors(time: Array, errors: Mapping[str, Array], noise: float, axes: Any = None) -> Axes:
    """Plot 3-D errors of poses against time, on a logarithmic axis.

    Args:
        time: time of each pose, (n,) [s].
        errors: errors of each model, by name (`before`, `calibrated`, `extended`), (n,) [m].
        noise: noise of a pose [m RMS], drawn as a line.
        axes: matplotlib axes to draw into; new ones if not given.

    Raises:
        InputError: matplotlib is not installed.
    """
    if axes is None:
        _, axes = required("matplotlib.pyplot", "a plot").subplots(figsize=(8.0, 3.6))
    for name, values in errors.items():
        colour, mark = _LOOKS[name]
        rms = 1e3 * float(np.sqrt(np.nanmean(values**2)))
        axes.semilogy(
            time / 60.0, 1e3 * values, mark, color=colour, markersize=4, label=f"{name}: {rms:.4f}"
        )
    label = f"noise of a pose: {1e3 * noise:.4f}"
    axes.axhline(1e3 * noise, color=INK, linestyle="--", linewidth=1, label=label)
    axes.set_xlabel("time since the start [min]")
    axes.set_ylabel("3-D error of a pose [mm]")
    axes.legend(title="RMS [mm]", frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return axes  # type: ignore[no-any-return]
