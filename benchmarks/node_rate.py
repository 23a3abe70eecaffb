"""Latency of the calibration node at 1 kHz, beside nodes that only pass messages on.

    python benchmarks/node_rate.py [--seconds 60] [--round 2] [--priority 0]

Three processes: a commander publishes joint commands, a node sends them on, and a listener
measures the time between the two by the machine's steady clock. Commander and listener run at a
higher priority than other programs if the system allows it. In turns of `--round` seconds the
commands pass through: an ordinary node (`rclpy.spin`) that copies each message into one of its
own; the same node on the executor of the calibration node; a node on that executor that sends on
the serialised bytes; and the calibration node, compensating by geometry alone, with backlash, and
with three effects. By taking turns all see the same load of the machine. Then the rate is raised
until messages are lost.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from array import array
from collections.abc import Mapping
from pathlib import Path
from typing import Any

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np

from delta_calibration.calibration_file import save_calibration
from delta_calibration.robot import load_robot
from node_processes import (
    PATIENCE_S,
    Processes,
    given,
    identified,
    motion,
    processes,
    with_effects,
)

COPYING, EVENTS, RAW = "copying", "copying by events", "raw"
PLAY: tuple[Mapping[str, object], float] = ({}, 4e-4)  # [rad]
EFFECTS: dict[str, dict[str, tuple[Mapping[str, object], float]]] = {
    "geometry": {},
    "backlash": {"backlash": PLAY},
    "three effects": {
        "backlash": PLAY,
        "joint_compliance": ({}, 4e-5),  # [rad/(N m)]
        "thermal_growth_arm": ({"sensor": "arm"}, 23e-6),  # [1/K]
    },
}
PASSING = (COPYING, EVENTS, RAW)
WAYS = (*PASSING, *EFFECTS)
SPACE = {way: "/" + way.replace(" ", "_") for way in WAYS}
RATES = (1000, 1500, 2000, 2500, 3000, 4000, 5000)
RATE_S = 2.0  # [s] at each of the rates
SILENCE_S = 3.0  # [s] without messages after which a listener ends
SETTLE_S = 2.0  # [s] for a listener to find all nodes
TOLD_S = 0.2  # [s] before a turn, for a node to receive the conditions
BEGIN_S = 0.1  # [s] at the begin of a turn that are not counted: after a pause a node is slower
KEPT_UP = 0.98  # share of the rate that the commander itself has to reach
NODE = "delta_calibration.ros.calibration_node"
BEFORE = 40  # priority of commander and listener, before other programs


def run_node(build: Any, name: str) -> int:
    """Run a role of this script as a node; rclpy is imported in the roles only."""
    from delta_calibration.ros.runtime import run

    return run(build, name, [name])


def command(plan: str, out: str) -> int:
    """Publish by a plan `way:seconds:rate,...`; write each message's time by way and block."""
    from geometry_msgs.msg import InertiaStamped
    from sensor_msgs.msg import JointState, Temperature

    from delta_calibration.ros.conversions import ns_to_stamp
    from delta_calibration.ros.own_process import take_priority
    from delta_calibration.ros.qos import PAYLOAD, STREAM_OUT
    from delta_calibration.ros.runtime import BaseNode

    robot = load_robot("srbd")
    names, middle = list(robot.joints.names), robot.model().home

    class Commander(BaseNode):
        def __init__(self) -> None:
            super().__init__("commander")
            self.way = {
                way: self.create_publisher(JointState, f"{space}/joint_command", STREAM_OUT)
                for way, space in SPACE.items()
            }
            self.around = {
                way: (
                    self.create_publisher(Temperature, f"{space}/cell/temperature", STREAM_OUT),
                    self.create_publisher(InertiaStamped, f"{space}/cell/payload", PAYLOAD),
                )
                for way, space in SPACE.items()
                if way in EFFECTS
            }

        def tell(self, way: str) -> None:
            """Send the conditions that effects need; without them a node is slower and warns."""
            arm, held = Temperature(temperature=24.0), InertiaStamped()
            arm.header.frame_id, held.inertia.m = "arm", 1.0
            for publisher, message in zip(self.around.get(way, ()), (arm, held), strict=False):
                publisher.publish(message)

        def find_all(self) -> None:
            """Wait until every node subscribes: it never receives what is sent before that."""
            told = [publisher for pair in self.around.values() for publisher in pair]
            until = time.monotonic() + PATIENCE_S
            while missing := [
                publisher.topic_name
                for publisher in (*self.way.values(), *told)
                if not publisher.get_subscription_count()
            ]:
                if time.monotonic() > until:
                    raise RuntimeError(f"nobody listens to {', '.join(missing)}")
                time.sleep(0.1)
            time.sleep(SETTLE_S)

        def start(self) -> None:
            self.find_all()
            take_priority(BEFORE)
            sent = []
            for block, entry in enumerate(plan.split(",")):
                way, seconds, rate = entry.split(":")
                self.tell(way)
                time.sleep(TOLD_S)
                sent += self.block(block, way, float(seconds), float(rate))
            np.save(out, np.array(sent))
            self.finish()

        def block(self, block: int, way: str, seconds: float, rate: float) -> list[Any]:
            publish, sent, begin = self.way[way].publish, [], time.monotonic_ns()
            for k in range(int(seconds * rate)):
                due = begin + int(k * 1e9 / rate)
                while (wait := due - time.monotonic_ns()) > 0:
                    time.sleep(wait * 1e-9)
                q = motion(middle, k / 1000.0)
                now = time.monotonic_ns()
                message = JointState(name=names, position=array("d", q))
                message.header.stamp = ns_to_stamp(now)
                publish(message)
                sent.append((block, now))
            return sent

    return run_node(Commander, "commander")


def listen(out: str) -> int:
    """Write the time at which each message arrives, by its stamp; end when none come any more."""
    from sensor_msgs.msg import JointState

    from delta_calibration.ros.conversions import stamp_to_ns
    from delta_calibration.ros.own_process import take_priority
    from delta_calibration.ros.qos import COMMAND
    from delta_calibration.ros.runtime import BaseNode

    class Listener(BaseNode):
        def __init__(self) -> None:
            super().__init__("listener")
            self.heard: list[tuple[int, int]] = []
            for space in SPACE.values():
                topic = f"{space}/joint_command_compensated"
                self.create_subscription(JointState, topic, self.take, COMMAND)
            self.create_timer(0.5, self.look)
            take_priority(BEFORE)

        def take(self, message: JointState) -> None:
            now = time.monotonic_ns()
            self.heard.append((stamp_to_ns(message.header.stamp), now))

        def look(self) -> None:
            silent = self.heard and time.monotonic_ns() - self.heard[-1][1] > SILENCE_S * 1e9
            if silent:
                np.save(out, np.array(self.heard))
                self.finish()

    return run_node(Listener, "listener")


def pass_on(way: str, priority: str) -> int:
    """Send commands on: copied into the robot's joint order, or as serialised bytes."""
    import rclpy
    from sensor_msgs.msg import JointState

    from delta_calibration.ros.conversions import JointReader, JointWriter
    from delta_calibration.ros.own_process import take_priority
    from delta_calibration.ros.qos import COMMAND, STREAM_OUT
    from delta_calibration.ros.runtime import BaseNode

    names = load_robot("srbd").joints.names

    class PassThrough(BaseNode):
        def __init__(self) -> None:
            super().__init__("pass_on")
            self.reader, self.writer = JointReader(names), JointWriter(names)
            into, out = f"{SPACE[way]}/joint_command", f"{SPACE[way]}/joint_command_compensated"
            self.out = self.create_publisher(JointState, out, STREAM_OUT)
            raw = way == RAW
            take = self.out.publish if raw else self.take
            self.create_subscription(JointState, into, take, COMMAND, raw=raw)
            if int(priority):
                take_priority(int(priority))

        def take(self, message: JointState) -> None:
            q = self.reader.positions(message)
            self.out.publish(self.writer.message(q, message.header.stamp))

    if way == COPYING:
        rclpy.init()
        rclpy.spin(PassThrough())
    return run_node(PassThrough, "pass_on")


def measured(cell: Processes, plan: list[tuple[str, float, float]], name: str) -> list[np.ndarray]:
    """Latencies [ms] of each block: one for every message sent, infinite for a lost one."""
    sent_file, heard_file = (cell.logs / f"{name}_{what}.npy" for what in ("sent", "heard"))
    listener = cell.start("listener", "node_rate", ["listen", str(heard_file)])
    text = ",".join(f"{way}:{seconds}:{rate}" for way, seconds, rate in plan)
    commander = cell.start("commander", "node_rate", ["command", text, str(sent_file)])
    seconds = sum(s for _, s, _ in plan)
    for child in (commander, listener):
        if child.wait(10 * seconds + 60.0) != 0:
            raise RuntimeError(f"a process failed; see {cell.logs}")
    sent, heard = np.load(sent_file), np.load(heard_file)
    came = dict(zip(heard[:, 0].tolist(), heard[:, 1].tolist(), strict=True))
    blocks = []
    for block, (_, _, rate) in enumerate(plan):
        stamps = sent[sent[:, 0] == block, 1][int(BEGIN_S * rate) :]
        took = np.array([(came.get(s, np.inf) - s) * 1e-6 for s in stamps.tolist()])
        span = (stamps[-1] - stamps[0]) * 1e-9
        if len(stamps) < KEPT_UP * rate * span:  # the commander itself is too slow
            took = np.append(took, np.nan)
        blocks.append(took)
    return blocks


def latencies(cell: Processes, seconds: float, turn: float) -> None:
    """Print the table at 1 kHz."""
    turns = max(round(seconds / turn), 1)
    plan = [(way, turn, 1000.0) for _ in range(turns) for way in WAYS]
    blocks = measured(cell, plan, "latency")
    took = {way: np.concatenate(blocks[k :: len(WAYS)]) for k, way in enumerate(WAYS)}
    columns = ["1 kHz", "messages", "lost", "p50 [ms]", "p99 [ms]", "ratio to copying: p50", "p99"]
    columns += ["median over turns: p50", "p99"]
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    figures = {way: percentiles(all_) for way, all_ in took.items()}
    base = [percentiles(block) for block in blocks[:: len(WAYS)]]
    for k, (way, all_) in enumerate(took.items()):
        known = all_[~np.isnan(all_)]
        ratio = figures[way] / figures[COPYING]
        each = [percentiles(block) for block in blocks[k :: len(WAYS)]]
        middle = np.median(np.array(each) / np.array(base), axis=0)
        numbers = [*figures[way].round(3), *ratio.round(2), *middle.round(2)]
        cells = [way, len(known), np.isinf(known).sum(), *numbers]
        print(f"| {' | '.join(map(str, cells))} |")


def percentiles(took: np.ndarray) -> np.ndarray:
    """Median and p99 [ms] of the messages that arrived."""
    return np.percentile(took[np.isfinite(took)], [50, 99])


def rates(cell: Processes) -> None:
    """Print the highest rate of the list up to which nothing was lost."""
    print()
    plan = [(way, RATE_S, float(rate)) for rate in RATES for way in WAYS]
    blocks = measured(cell, plan, "rate")
    for k, way in enumerate(WAYS):
        free = 0  # [1/s]
        why = "and more were not tried"
        for rate, block in zip(RATES, blocks[k :: len(WAYS)], strict=True):
            if np.isinf(block).any():
                why = f"{np.isinf(block).sum()} lost at {rate}"
                break
            if np.isnan(block).any():
                why = f"the commander itself did not keep up with {rate}"
                break
            free = rate
        print(f"{way}: nothing lost up to {free} messages a second; {why}.")


def bench(seconds: float, turn: float, priority: int) -> int:
    """Start the nodes, measure, print."""
    robot = load_robot("srbd")
    with tempfile.TemporaryDirectory() as folder, processes(Path(folder)) as cell:
        found, poses = identified(robot)
        for way, effects in EFFECTS.items():
            calibration = Path(folder) / f"{way}.yaml"
            save_calibration(calibration, with_effects(found, robot, effects), robot, poses)
            node = given(
                autostart=True,
                calibration=calibration,
                ramp_s=0.0,
                realtime_priority=priority,
                temperature_timeout_s=86400.0,  # it is sent once
            )
            cell.start(f"node_{way}", NODE, [*node, "-r", f"__ns:={SPACE[way]}"])
        for way in PASSING:
            cell.start(f"pass_{way}", "node_rate", ["pass_on", way, str(priority)])
        for way in EFFECTS:
            cell.call(f"{SPACE[way]}/calibration_node/enable", "true")
        latencies(cell, seconds, turn)
        rates(cell)
    print(f"Load averages: {', '.join(f'{load:.1f}' for load in os.getloadavg())}")
    return 0


def main() -> int:
    """Measure, or run one of the roles."""
    roles = {"command": command, "listen": listen, "pass_on": pass_on}
    if len(sys.argv) > 1 and sys.argv[1] in roles:
        return roles[sys.argv[1]](*sys.argv[2:])
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="duration for each node, at 1 kHz"
    )
    parser.add_argument("--round", type=float, default=2.0, help="duration [s] of a turn")
    parser.add_argument(
        "--priority", type=int, default=0, help="real-time priority of all nodes; 0 for none"
    )
    arguments = parser.parse_args()
    return bench(arguments.seconds, arguments.round, arguments.priority)


if __name__ == "__main__":
    sys.exit(main())
