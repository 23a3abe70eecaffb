"""A real cable robot, calibrated by its own redundancy: `python benchmarks/hangprinter.py FOLDER`.

Four lines hold a point with three degrees of freedom, so at every pose, measured or not, the
lengths of the lines must satisfy one condition. The anchors and the four gains (16 numbers) are
fitted to 44 poses, 9 of them with a position measured by camera. The residuals are those of the
closure, one length per line:

    measured pose      f(q, x, g)                        4 conditions
    any other          f(q, x*, g), x* = forward(q, g)   4, of which the pose takes 3

The fit is made without the drums' build-up, with its nominal value, and with it free, and compared
with lengths measured by hand at the origin, which no fit uses. The counters are zero at the
origin. Then other causes that the 16 numbers leave out are tried one at a time, each with the F
test of its parameters.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import f as fisher

from delta_calibration.data import at_rest
from delta_calibration.effects import Effect
from delta_calibration.effects.cable_elasticity import CableElasticity
from delta_calibration.effects.drum_build_up import DrumBuildUp
from delta_calibration.effects.pulley_radius import PulleyRadius
from delta_calibration.errors import DataError, RecordingError
from delta_calibration.mechanisms import CableDimensions, CableRobot, CableTolerances, Mechanism
from delta_calibration.mechanisms.cable_dimensions import CableMasses
from delta_calibration.robot import Robot, load_robot

DATA = Path(__file__).resolve().parents[2] / "shared" / "real" / "hangprinter"
LINES = "ABCD"
BUILD_UP = 0.06875e-3  # [m^2/m]
BY_HAND = np.array([1.597, 1.795, 1.5825, 2.355])  # [m] at the origin; not used in any fit
DRAWING = CableDimensions(  # rough anchors as start values
    anchors=1e-3
    * np.array([[0, -1590, -120], [1290, 1250, -160], [-1430, 740, -155], [0, 0, 2340]]),
    joints=np.zeros((4, 3)),
    drum_radius=np.full(4, 75e-3),
    gear=np.full(4, 255 / 20),
    tackle=np.array([2.0, 2.0, 2.0, 4.0]),
    home_place=np.zeros(3),
    pretension=30.0,  # assumed, like the mass; the recorded forces are 7 to 37 N
)
MASS = 1.5  # [kg] assumed; mass and pretension matter to elasticity alone
_STILL = 1e-9  # [m] change of a closure by the last step, at most
_STEPS = 100


@dataclass(frozen=True)
class ClosureProblem:
    """Closures at measured poses, and at poses that follow from the joints."""

    mechanism: Mechanism
    joint: np.ndarray  # (n, m) [rad]
    pose: np.ndarray  # (n, k), NaN rows where not measured
    effects: tuple[Effect, ...] = ()  # of the drive, linear in their parameters

    def at(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Closures (n, r) and their slopes (n, r, p + c), unmeasured poses at their best fit."""
        robot, p = self.mechanism, len(self.mechanism.parameters)
        columns = self.columns()
        q, g = self.joint + columns @ unknowns[p:], unknowns[:p]
        unseen = np.isnan(self.pose).any(axis=1)
        x = np.where(unseen[:, None], robot.forward(q, g), self.pose)
        robot.require_reach(x, q, "joints")
        slope = np.concatenate(
            [robot.closure_by_geometry(q, x, g), robot.closure_by_joints(q, x, g) @ columns], -1
        )
        by_pose = robot.closure_by_pose(q, x, g)
        taken = by_pose @ np.linalg.pinv(by_pose)  # part of the closure that a free pose absorbs
        slope = np.where(unseen[:, None, None], slope - taken @ slope, slope)
        return robot.closure(q, x, g), slope

    def columns(self) -> np.ndarray:
        """d(joint)/d(effects' parameters), (n, m, c)."""
        n = len(self.joint)
        at = replace(at_rest(self.joint), payload=np.zeros(n), payload_centre=np.zeros((n, 3)))
        none = np.zeros((*self.joint.shape, 0))
        return np.concatenate([none, *(effect.columns(at) for effect in self.effects)], -1)

    @property
    def conditions(self) -> int:
        """Number of equations, less the coordinates of the unmeasured poses."""
        unseen = int(np.isnan(self.pose).any(axis=1).sum())
        return self.joint.size - unseen * self.mechanism.pose_size


@dataclass(frozen=True)
class ClosureFit:
    """Result of the fit."""

    unknowns: np.ndarray  # (p + c,) geometry, effects
    std: np.ndarray  # (p + c,) scaled by the size of the residuals
    closure: np.ndarray  # (n, r)
    conditions: int
    rank: int

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.closure**2)))


def fit(problem: ClosureProblem, effects: np.ndarray, free: np.ndarray) -> ClosureFit:
    """Gauss-Newton on the closures from the nominal geometry; `free` masks the unknowns."""
    unknowns = np.append(problem.mechanism.parameters.nominal, effects)
    for _ in range(_STEPS):
        closure, slope = problem.at(unknowns)
        rows = slope[..., free].reshape(closure.size, -1)
        norms = np.linalg.norm(rows, axis=0)
        step, _, rank, _ = np.linalg.lstsq(rows / norms, -closure.reshape(-1), rcond=1e-10)
        unknowns[free] += step / norms
        if np.abs(rows / norms * step).max() < _STILL:
            break
    else:
        raise DataError(f"the closures still change after {_STEPS} steps")
    closure, _ = problem.at(unknowns)
    scatter = np.sum(closure**2) / (problem.conditions - rank)
    std = np.zeros_like(unknowns)
    inverse = np.linalg.pinv(rows / norms)
    std[free] = np.sqrt(scatter * np.sum(inverse**2, axis=1)) / norms
    return ClosureFit(unknowns, std, closure, problem.conditions, int(rank))


def load(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Motor angles (44, 4) [rad] and positions (44, 3) [m], NaN where not measured."""
    tables = []
    for name in ("motor_pos_samp_deg.csv", "xyz_of_samp_mm.csv"):
        if not (folder / name).is_file():
            raise RecordingError(f"{folder / name} is not there")
        tables.append(np.loadtxt(folder / name, delimiter=",", ndmin=2))
    joint = np.radians(tables[0])
    position = np.full((len(joint), 3), np.nan)
    position[: len(tables[1])] = 1e-3 * tables[1]
    return joint, position


def model(free_zeros: bool = False) -> tuple[CableRobot, Robot]:
    """The machine, and a robot file for the effects, which use its masses alone."""
    zero = 0.01 if free_zeros else None
    tolerances = CableTolerances(anchor=0.1, joint=0.0, gain=0.02, zero=zero)
    return CableRobot(DRAWING, tolerances), replace(load_robot("srbd"), masses=CableMasses(MASS))


def fits(folder: Path = DATA) -> dict[str, ClosureFit]:
    """Fits without build-up, with the nominal one, and with it free."""
    robot, file = model()
    problem = ClosureProblem(robot, *load(folder), (DrumBuildUp(file, robot),))
    free = np.ones(len(robot.parameters) + 1, dtype=bool)
    held = free & (np.arange(len(free)) < len(free) - 1)
    return {
        "none": fit(problem, np.zeros(1), held),
        "nominal": fit(problem, np.array([BUILD_UP]), held),
        "fitted": fit(problem, np.array([BUILD_UP]), free),
    }


def rivals(folder: Path = DATA) -> dict[str, tuple[ClosureFit, float]]:
    """Fit one cause at a time beside the geometry: fits and p values, strongest first."""
    data, (plain, file), (zeros, _) = load(folder), model(), model(free_zeros=True)
    causes: dict[str, tuple[CableRobot, tuple[Effect, ...]]] = {
        "drum_build_up": (plain, (DrumBuildUp(file, plain),)),
        "cable_elasticity": (plain, (CableElasticity(file, plain),)),
        "pulley_radius": (plain, (PulleyRadius(file, plain, 0.02),)),
        "joint_zero_offset": (zeros, ()),
    }
    base = fit(ClosureProblem(plain, *data), np.zeros(0), np.ones(16, dtype=bool))
    found = {}
    for cause, (robot, effects) in causes.items():
        free = np.ones(len(robot.parameters) + len(effects), dtype=bool)
        each = fit(ClosureProblem(robot, *data, effects), np.zeros(len(effects)), free)
        more, left = each.rank - base.rank, each.conditions - each.rank
        ratio = (base.rms**2 / each.rms**2 - 1) * left / more
        found[cause] = each, float(fisher.sf(ratio, more, left))
    return dict(sorted(found.items(), key=lambda item: item[1][1]))


def missed_by_hand(found: ClosureFit) -> np.ndarray:
    """Identified minus hand-measured line lengths at the origin, (4,) [m]."""
    anchors = found.unknowns[:16].reshape(4, 4)[:, :3]
    return np.linalg.norm(anchors, axis=1) - BY_HAND


def main(folder: Path) -> int:
    """Print the residuals of each fit."""
    for name, found in fits(folder).items():
        by_hand = zip(LINES, 1e3 * missed_by_hand(found), strict=True)
        missed = ", ".join(f"{line} {value:+.1f}" for line, value in by_hand)
        build_up, std = 1e3 * found.unknowns[16], 1e3 * found.std[16]
        radius = 1e3 * found.unknowns[3:16:4] * DRAWING.gear * DRAWING.tackle
        print(
            f"build-up {name}: {build_up:.4f} +- {std:.4f} mm2/mm\n"
            f"  line residual {1e3 * found.rms:.3f} mm RMS over {found.closure.size} lines, "
            f"{found.conditions} conditions, rank {found.rank}\n"
            f"  by hand missed by [mm]: {missed}\n"
            f"  drum radius [mm]: {', '.join(f'{r:.2f}' for r in radius)}"
        )
    print("one cause beside the geometry:")
    for cause, (found, p) in rivals(folder).items():
        print(f"  {cause}: {1e3 * found.rms:.3f} mm RMS, p {p:.1e}")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else DATA))
