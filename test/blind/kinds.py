"""All machines by the names of their robot files, and what each can hide."""

from __future__ import annotations

from blind.arm import SCARA, UR10, arm_causes
from blind.cause import Draw
from blind.delta import DELTA
from blind.kind import Kind

KINDS: dict[str, Kind] = {kind.robot: kind for kind in (DELTA, SCARA, UR10)}
# what machines other than the Delta hide: causes by name, and kinds of what no catalogue has
OTHERS: dict[str, tuple[dict[str, Draw], dict[str, Draw]]] = {
    kind.robot: arm_causes(kind) for kind in (SCARA, UR10)
}
