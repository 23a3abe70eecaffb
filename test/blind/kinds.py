"""All machines by the names of their robot files, and the causes that each can hide."""

from __future__ import annotations

from blind.arm import SCARA, UR10
from blind.arm_causes import arm_causes
from blind.cables import winch_causes
from blind.cause import Draw
from blind.delta import DELTA
from blind.kind import Kind
from blind.slider_causes import slider_causes
from blind.sliders import FIVE_AXIS, LINEAR_DELTA
from blind.winches import CDPR8

EVERY: tuple[Kind, ...] = (DELTA, SCARA, LINEAR_DELTA, UR10, FIVE_AXIS, CDPR8)
KINDS: dict[str, Kind] = {kind.robot: kind for kind in EVERY}
# Causes of machines other than the Delta by name, and kinds that are in no catalogue.
OTHERS: dict[str, tuple[dict[str, Draw], dict[str, Draw]]] = {
    **{kind.robot: arm_causes(kind) for kind in (SCARA, UR10)},
    **{kind.robot: slider_causes(kind) for kind in (LINEAR_DELTA, FIVE_AXIS)},
    CDPR8.robot: winch_causes(),
}
