"""The calibration node at 1 kHz, three processes, beside a node that only passes messages on.

    python benchmarks/node_rate.py [--seconds 60] [--round 5]

A commander publishes joint commands, a node sends them on, a listener takes the time from the one
to the other by the machine's steady clock. In turns of `--round` seconds the commands go straight
to the listener, through a pass-through node of the same skeleton (executor, joint order, message
filled), and through the calibration node with compensation on; so all three see the same
machine. Then the rate is raised until messages are lost.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from array import array
from pathlib import Path
from typing import Any

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np

from delta_calibration.calibration_file import save_calibration
from delta_calibration.robot import load_robot
from node_processes import Processes, given, identified, motion, processes

WAYS = ("direct", "pass-through", "compensating")
IN = {"direct": "/direct/out", "pass-through": "/passing/in", "compensating": "/cell/in"}
OUT = {"direct": "/direct/out", "pass-through": "/passing/out", "compensating": "/cell/out"}
RATES = (1000, 1500, 2000, 2500, 3000, 4000, 5000)
RATE_S = 2.0  # [s] at each of the rates
SILENCE_S = 3.0  # [s] after which a listener has heard all
SETTLE_S = 2.0  # [s] for processes to find one another
KEPT_UP = 0.98  # of the rate, that the commander itself has to manage
NODE = "delta_calibration.ros.calibration_node"


def run_node(build: Any, name: str) -> int:
    """A role of this script as a node; rclpy is there in the roles only."""
    from delta_calibration.ros.runtime import run

    return run(build, name, [name])


def command(plan: str, out: str) -> int:
    """Publish by a plan `way:seconds:rate,...`; write when each message was, by way and block."""
    from sensor_msgs.msg import JointState

    from delta_calibration.ros.conversions import ns_to_stamp
    from delta_calibration.ros.qos import STREAM_OUT
    from delta_calibration.ros.runtime import BaseNode

    robot = load_robot("srbd")
    names, middle = list(robot.joints.names), robot.model().home

    class Commander(BaseNode):
        def __init__(self) -> None:
            super().__init__("commander")
            self.way = {w: self.create_publisher(JointState, t, STREAM_OUT) for w, t in IN.items()}

        def start(self) -> None:
            time.sleep(SETTLE_S)
            sent = []
            for block, entry in enumerate(plan.split(",")):
                way, seconds, rate = entry.split(":")
                sent += self.block(block, way, float(seconds), float(rate))
                time.sleep(0.2)
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
    """Write when each message came, by its stamp; end when nothing comes any more."""
    from sensor_msgs.msg import JointState

    from delta_calibration.ros.conversions import stamp_to_ns
    from delta_calibration.ros.qos import COMMAND
    from delta_calibration.ros.runtime import BaseNode

    class Listener(BaseNode):
        def __init__(self) -> None:
            super().__init__("listener")
            self.heard: list[tuple[int, int]] = []
            for topic in OUT.values():
                self.create_subscription(JointState, topic, self.take, COMMAND)
            self.create_timer(0.5, self.look)

        def take(self, message: JointState) -> None:
            now = time.monotonic_ns()
            self.heard.append((stamp_to_ns(message.header.stamp), now))

        def look(self) -> None:
            silent = self.heard and time.monotonic_ns() - self.heard[-1][1] > SILENCE_S * 1e9
            if silent:
                np.save(out, np.array(self.heard))
                self.finish()

    return run_node(Listener, "listener")


def pass_on() -> int:
    """Take a command, put it into the robot's order, send it on."""
    from sensor_msgs.msg import JointState

    from delta_calibration.ros.conversions import JointReader, JointWriter
    from delta_calibration.ros.qos import COMMAND, STREAM_OUT
    from delta_calibration.ros.runtime import BaseNode

    names = load_robot("srbd").joints.names

    class PassThrough(BaseNode):
        def __init__(self) -> None:
            super().__init__("pass_through")
            self.reader, self.writer = JointReader(names), JointWriter(names)
            self.out = self.create_publisher(JointState, OUT["pass-through"], STREAM_OUT)
            self.create_subscription(JointState, IN["pass-through"], self.take, COMMAND)

        def take(self, message: JointState) -> None:
            q = self.reader.positions(message)
            self.out.publish(self.writer.message(q, message.header.stamp))

    return run_node(PassThrough, "pass_through")


def measured(cell: Processes, plan: list[tuple[str, float, float]], name: str) -> list[np.ndarray]:
    """Latencies [ms] of each block, one for every message sent, infinite for one lost."""
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
        stamps = sent[sent[:, 0] == block, 1]
        took = np.array([(came.get(s, np.inf) - s) * 1e-6 for s in stamps.tolist()])
        span = (stamps[-1] - stamps[0]) * 1e-9
        if len(stamps) < KEPT_UP * rate * span:  # the commander is what is too slow
            took = np.append(took, np.nan)
        blocks.append(took)
    return blocks


def latencies(cell: Processes, seconds: float, turn: float) -> None:
    """The table at 1 kHz."""
    turns = max(round(seconds / turn), 1)
    plan = [(way, turn, 1000.0) for _ in range(turns) for way in WAYS]
    blocks = measured(cell, plan, "latency")
    took = {way: np.concatenate(blocks[k :: len(WAYS)]) for k, way in enumerate(WAYS)}
    head = "1 kHz, messages, lost, median [ms], p99 [ms], times pass-through: median, p99"
    columns = [*head.split(", "), "what it adds: median", "p99"]
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    figures = {}
    for way, all_ in took.items():
        known = all_[~np.isnan(all_)]
        figures[way] = np.percentile(known[np.isfinite(known)], [50, 99])
    for way, all_ in took.items():
        known = all_[~np.isnan(all_)]
        base, direct = figures["pass-through"], figures["direct"]
        ratio, added = figures[way] / base, (figures[way] - direct) / (base - direct)
        print(
            f"| {way} | {len(known)} | {np.isinf(known).sum()} | {figures[way][0]:.3f} "
            f"| {figures[way][1]:.3f} | {ratio[0]:.2f} | {ratio[1]:.2f} "
            f"| {added[0]:.2f} | {added[1]:.2f} |"
        )


def rates(cell: Processes) -> None:
    """The highest rate of the list, up to which nothing was lost."""
    print()
    ways = WAYS[1:]
    plan = [(way, RATE_S, float(rate)) for rate in RATES for way in ways]
    blocks = measured(cell, plan, "rate")
    for k, way in enumerate(ways):
        free = 0  # [1/s]
        why = "and more were not tried"
        for rate, block in zip(RATES, blocks[k :: len(ways)], strict=True):
            if np.isinf(block).any():
                why = f"{np.isinf(block).sum()} lost at {rate}"
                break
            if np.isnan(block).any():
                why = f"the commander itself did not keep up with {rate}"
                break
            free = rate
        print(f"{way}: nothing lost up to {free} messages a second; {why}.")


def bench(seconds: float, turn: float) -> int:
    """Start the nodes, measure, print."""
    robot = load_robot("srbd")
    with tempfile.TemporaryDirectory() as folder, processes(Path(folder)) as cell:
        calibration = Path(folder) / "calibration.yaml"
        found, poses = identified(robot)
        save_calibration(calibration, found, robot, poses)
        node = [
            *given(autostart=True, calibration=calibration, ramp_s=0.0),
            *("-r", f"joint_command:={IN['compensating']}"),
            *("-r", f"joint_command_compensated:={OUT['compensating']}"),
        ]
        cell.start("calibration_node", NODE, node)
        cell.start("pass_through", "node_rate", ["pass_on"])
        cell.call("/calibration_node/enable", "true")
        latencies(cell, seconds, turn)
        rates(cell)
    print(f"Load averages: {', '.join(f'{load:.1f}' for load in os.getloadavg())}")
    return 0


def main() -> int:
    """Measure, or play one of the roles."""
    roles = {"command": command, "listen": listen, "pass_on": pass_on}
    if len(sys.argv) > 1 and sys.argv[1] in roles:
        return roles[sys.argv[1]](*sys.argv[2:])
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="of each way, at 1 kHz")
    parser.add_argument("--round", type=float, default=5.0, help="seconds before ways change")
    arguments = parser.parse_args()
    return bench(arguments.seconds, arguments.round)


if __name__ == "__main__":
    sys.exit(main())
