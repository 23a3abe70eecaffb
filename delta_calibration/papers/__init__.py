"""Identification methods of the papers, complete and tested; nothing in the core needs them.

Alternating fits (cable robot), swarms (Delta, five-axis machine), stepwise swarms (five-axis
machine). The swarm that searches joint corrections is `compensation/apso.py`, the search that uses
measured errors alone (SCARA) `compensation/grid_search.py`.
"""

from delta_calibration.papers.alternating import (
    TogetherFit,
    alternate,
    fit_together,
    in_turn,
)
from delta_calibration.papers.error_model import (
    box_of,
    error_model,
)
from delta_calibration.papers.joint_residual import (
    JointProblem,
    joint_covariance,
)
from delta_calibration.papers.methods import (
    METHODS,
    ORDERS,
    method_named,
)
from delta_calibration.papers.pose_residual import (
    LinearResidual,
    PoseResidual,
    in_rounds,
    least_squares,
)
from delta_calibration.papers.stepwise import (
    Settled,
    all_singular,
    stepwise,
    stepwise_singular,
)
from delta_calibration.papers.swarm import (
    Apso,
    Box,
    Pso,
    Qpso,
    SwarmResult,
    SwarmSettings,
    minimise,
)

__all__ = [
    "METHODS",
    "ORDERS",
    "Apso",
    "Box",
    "JointProblem",
    "LinearResidual",
    "PoseResidual",
    "Pso",
    "Qpso",
    "Settled",
    "SwarmResult",
    "SwarmSettings",
    "TogetherFit",
    "all_singular",
    "alternate",
    "box_of",
    "error_model",
    "fit_together",
    "in_rounds",
    "in_turn",
    "joint_covariance",
    "least_squares",
    "method_named",
    "minimise",
    "stepwise",
    "stepwise_singular",
]
