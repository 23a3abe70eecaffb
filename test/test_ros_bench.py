"""The bench with a real node: it shows the node's messages, passes orders on, and ends cleanly."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest

pytest.importorskip("rclpy")

from delta_calibration.bench.cell import Answer, Cell
from delta_calibration.errors import InputError, MistakeError
from ros_helpers import Launch, launch_fixture  # noqa: F401

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NODE = "/calibration_node"
PATIENCE_S = 60.0


@pytest.fixture
def cell() -> Iterator[Cell]:
    watched = Cell()
    yield watched
    watched.close()


def until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def answer(cell: Cell, order: str) -> Answer:
    """Send an order and return its answer; another order in the meantime is refused."""
    cell.order(NODE, order)
    with pytest.raises(MistakeError, match="has not answered"):
        cell.order(NODE, order)
    until(lambda: cell.answers()[0].state != "waiting")
    return cell.answers()[0]


def test_a_node_is_watched_and_takes_orders(launch: Launch, cell: Cell) -> None:
    launch("delta_calibration.ros.calibration_node", robot="srbd", autostart=True)
    until(cell.nodes)
    (node,) = cell.nodes()
    assert (node.name, node.robot, node.old) == (NODE, "srbd", False)

    assert answer(cell, "start_capture") == Answer(
        cell.answers()[0].when, NODE, "start_capture", "done", "capturing"
    )
    until(lambda: cell.nodes()[0].doing)
    assert cell.nodes()[0].doing[0].startswith("capture: 0 messages held")
    assert cell.nodes()[0].groups()["Captured"]["captured tracker"] == "0"

    refused = answer(cell, "fit")
    assert refused.state == "refused"
    assert refused.said.startswith("nothing was captured")
    assert [each.order for each in cell.answers()] == ["fit", "start_capture"]

    with pytest.raises(InputError, match="was not found"):
        cell.order("/another", "fit")
    with pytest.raises(InputError, match="is not known"):
        cell.order(NODE, "shutdown")
    cell.close()
    assert all(child.poll() is not None for child in cell._children)
