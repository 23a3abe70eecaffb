"""Computed plans determine parameters better than others, and their files are read back."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.cli.main import run
from delta_calibration.data import at_rest, collect, survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.diagnosis.candidates import Candidate, columns_of
from delta_calibration.effects import EFFECTS
from delta_calibration.errors import InputError, ReachError
from delta_calibration.estimation import identify
from delta_calibration.plans import make_plan, write_plan
from delta_calibration.plans.optimal import candidates, choose, optimal_plan
from delta_calibration.plans.parting import part
from delta_calibration.plans.points import RADIUS, tool_points
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("srbd")
HEAD = "x_mm,y_mm,z_mm"


def run_plan(tmp_path, *arguments, name="poses.csv"):
    """Exit code, and the plan that was written."""
    out = tmp_path / name
    code = run(["plan", "--robot", "srbd", "--out", str(out), *arguments])
    return code, make_plan(str(out), ROBOT) if code == 0 else None


# Files


@pytest.mark.parametrize("name", ["line", "disc", "iso9283", "identify", "circles", "rich"])
def test_a_named_plan_is_read_back_as_it_was(tmp_path, name):
    code, plan = run_plan(tmp_path, "--name", name, "--count", "4", "--seed", "2")
    assert code == 0
    load = 2.0 if name == "rich" else 0.0
    expected = make_plan(name, ROBOT, count=4, seed=2, payload=load)
    np.testing.assert_allclose(plan.target, expected.target, atol=1e-9)
    np.testing.assert_allclose(plan.joint, expected.joint, atol=1e-8)
    np.testing.assert_array_equal(plan.direction, expected.direction)
    np.testing.assert_array_equal(plan.payload, expected.payload)
    assert len(plan.paths) == len(expected.paths)
    for path, way in zip(plan.paths, expected.paths, strict=True):
        assert path.name.startswith(way.name)
        assert path.duration == pytest.approx(way.duration, rel=1e-5)
        np.testing.assert_allclose(path.joint, way.joint, atol=1e-8)
    assert len({path.name for path in plan.paths}) == len(plan.paths)


def test_separate_is_a_plan_by_name(tmp_path):
    """The name alone, or with two causes; the same stops as those of --separate."""
    code, plain = run_plan(tmp_path, "--name", "separate", "--count", "6")
    assert (code, len(plain)) == (0, 6)
    causes = ("joint_compliance", "joint_zero_offset")
    code, named = run_plan(tmp_path, "--name", f"separate:{','.join(causes)}", "--count", "6")
    within = ("--radius-mm", f"{1e3 * RADIUS}")
    code_too, asked = run_plan(tmp_path, "--separate", *causes, "--count", "6", *within)
    assert code == code_too == 0
    np.testing.assert_array_equal(named.target, asked.target)
    made = make_plan(f"separate:{','.join(causes)}", ROBOT, count=6)
    np.testing.assert_allclose(named.target, made.target, atol=1e-9)
    assert set(make_plan("separate", ROBOT, count=6).direction) == {-1.0, 1.0}
    near = make_plan("separate", ROBOT, count=6, radius=0.3).target
    assert np.linalg.norm(near[:, :2], axis=1).max() <= 0.3


def test_a_plan_whose_stops_need_hours_between_them_is_not_made_by_name():
    """A session of it would last seconds: growth with the warm-up could not be seen."""
    with pytest.raises(InputError, match="by stops at several times only"):
        make_plan("separate:thermal_growth_arm,backlash", ROBOT, count=6)


@pytest.mark.parametrize("name", ["separate:backlash", "separate:", "separate:a,b,c"])
def test_a_plan_that_separates_needs_two_causes(name):
    with pytest.raises(InputError, match="two causes are expected, as separate:CAUSE,CAUSE"):
        make_plan(name, ROBOT)


def test_a_written_plan_is_simulated(tmp_path, capsys):
    assert run_plan(tmp_path, "--name", "rich", "--count", "2")[0] == 0
    plan, session = str(tmp_path / "poses.csv"), str(tmp_path / "session")
    assert run(["simulate", "--robot", "srbd", "--plan", plan, "--out", session]) == 0
    assert "(14 stops and 9 paths: 27 poses at rest, " in capsys.readouterr().out


def test_a_file_may_leave_out_sides_and_loads(tmp_path):
    """Missing columns take the values of the caller; existing ones are kept."""
    bare, full = tmp_path / "bare.csv", tmp_path / "full.csv"
    bare.write_text(f"{HEAD}\n0,0,-711\n100,0,-711\n")
    full.write_text(f"{HEAD},payload_kg,direction\n0,0,-711,1.5,-1\n100,0,-711,0,+1\n")
    plan = make_plan(str(bare), ROBOT, payload=3.0)
    assert plan.direction.tolist() == [1, -1, 1, -1]
    assert plan.payload.tolist() == [3.0] * 4
    assert make_plan(str(bare), ROBOT, both_sides=False).direction.tolist() == [1, 1]
    plan = make_plan(str(full), ROBOT, payload=3.0)
    assert plan.direction.tolist() == [-1, 1]
    assert plan.payload.tolist() == [1.5, 0.0]


PATH = f"{HEAD},direction,payload_kg,path,duration_s\n0,0,-711,1,0,,\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{HEAD},direction\n0,0,-711,0\n", "line 2: direction: '0' is not allowed; allowed: 1, "),
        (f"{HEAD},direction\n0,0,-711,\n", "line 2: direction: '' is not a finite number"),
        (f"{HEAD},payload_kg\n0,0,-711,-2\n", "line 2: payload_kg: '-2' is not allowed"),
        (f"{HEAD},path\n0,0,-711,way\n", "line 2: path: 'way' is not preceded by a stop"),
        (PATH + "1,0,-711,,,way,2\n2,0,-711,1,0,,\n", "line 4: path: '' is empty after a path"),
        (PATH + "1,0,-711,,,way,2\n", "line 3: path: 'way' has only one point"),
        (PATH + "1,0,-711,,,way,0\n2,0,-711,,,way,0\n", "line 3: duration_s: '0' is not p"),
        (PATH + "1,0,-711,,,way,2\n2,0,-711,,,way,3\n", "line 4: duration_s: '3' differs from t"),
        (f"{HEAD},path\n0,0,-711,\n0,0,-711,way\n", "column duration_s missing"),
    ],
)
def test_a_wrong_plan_is_refused_by_line_and_column(tmp_path, text, message):
    path = tmp_path / "plan.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"plan\.csv: {message}"):
        make_plan(str(path), ROBOT)


def test_a_path_out_of_reach_is_named(tmp_path):
    path = tmp_path / "plan.csv"
    path.write_text(PATH + "0,0,-711,,,way,2\n900,0,-711,,,way,2\n")
    with pytest.raises(ReachError, match=r"plan\.csv: path way: point 2 \(0\.9"):
        make_plan(str(path), ROBOT)


def test_a_plan_that_cannot_be_written_is_said(tmp_path):
    with pytest.raises(InputError, match=r"gone/p\.csv: cannot be written: No such file"):
        write_plan(tmp_path / "gone" / "p.csv", make_plan("line", ROBOT, count=2), ROBOT)


# D-optimal poses


@pytest.mark.parametrize("asked", [4, 1])
def test_the_chosen_stops_are_the_best_of_all_sets(asked):
    """Compared with all sets of three out of nine, for all parameters and for one of them."""
    rows = np.random.default_rng(4).standard_normal((9, 3, 4))
    start = 0.1 * np.eye(4)

    def worth(chosen):
        whole = start + sum(rows[i].T @ rows[i] for i in chosen)
        rest = whole[: 4 - asked, : 4 - asked]
        return np.linalg.slogdet(whole)[1] - (np.linalg.slogdet(rest)[1] if asked < 4 else 0.0)

    best = max(combinations(range(9), 3), key=worth)
    assert worth(choose(rows, start, 3, asked)) == pytest.approx(worth(best))


@pytest.fixture(scope="module")
def best():
    return optimal_plan(ROBOT, 20, seed=1)


def test_optimal_poses_keep_to_the_limits(best):
    joint = best.plan.joint
    assert len(np.unique(joint, axis=0)) == 20
    assert (joint > ROBOT.joints.lower).all()
    assert (joint < ROBOT.joints.upper).all()
    model = ROBOT.model("rotary_delta")
    nominal = model.parameters.nominal
    x = model.forward(joint, nominal)
    assert (model.condition(joint, x, nominal) < ROBOT.limits.condition / 2).all()
    np.testing.assert_allclose(x, best.plan.target, atol=1e-12)
    near = optimal_plan(ROBOT, 20, radius=0.4, seed=1).plan.target
    assert np.hypot(near[:, 0], near[:, 1]).max() <= 0.4
    assert np.hypot(*best.plan.target[:, :2].T).max() > 0.5
    with pytest.raises(
        InputError, match=r"only \d+ of 2000 candidate poses .* choose a larger radius"
    ):
        optimal_plan(ROBOT, 20, radius=0.01)


def test_optimal_poses_tell_several_times_as_much_as_random_ones(best):
    assert best.log_det > best.random_log_det + 20
    assert best.worth > 3
    assert best.observability.rank == 38


def test_a_fit_to_optimal_poses_is_more_certain_and_nearer_the_truth(best):
    """One machine, measured at 20 optimal poses and at 20 random ones of the same candidates."""
    machine = draw_machine(ROBOT, 8)
    one_side = replace_rows(best.plan, slice(0, None, 2))
    rng = np.random.default_rng(0)
    joint = candidates(ROBOT, 2000, None, rng)
    uncertain, wrong = [], []
    drawn = [rng.choice(len(joint), 20, replace=False) for _ in range(2)]
    chance = [
        replace(one_side, joint=joint[rows], target=tool_points(ROBOT, joint[rows]))
        for rows in drawn
    ]
    for plan in (one_side, *chance):
        poses = collect(simulate_session(machine, plan, 3), ROBOT.joints.names)
        found = identify(poses, ROBOT)
        own = found.chain.layout.geometry
        scaled = np.diag(found.covariance)[own] / found.chain.parameters.prior[own] ** 2
        uncertain.append(float(np.log(scaled).mean()))
        at = make_plan("identify", ROBOT, count=60, both_sides=False, seed=9).joint
        wrong.append(error_of(found, machine, at))
    assert uncertain[0] < min(uncertain[1:])
    assert wrong[0] < np.mean(wrong[1:])


def replace_rows(plan, rows):
    names = ("target", "joint", "direction", "payload")
    return replace(plan, **{name: getattr(plan, name)[rows] for name in names})


def error_of(found, machine, joint):
    """RMS difference of the readings of fitted and true machine at unmeasured places [m]."""
    at = at_rest(joint)
    missed = found.chain.predict(at, found.theta) - machine.chain.predict(at, machine.theta)
    return float(np.sqrt(np.mean(np.sum(missed**2, axis=1))))


def test_the_verb_says_what_the_poses_are_worth(tmp_path, capsys):
    code, plan = run_plan(tmp_path, "--identify", "--count", "14", "--seed", "3")
    assert code == 0
    assert len(plan) == 28
    assert plan.direction.tolist() == [1, -1] * 14
    said = capsys.readouterr().out
    assert "14 poses of 2000, each approached from both sides: log det of the information" in said
    assert "rank 38 of 75 parameters, O1 " in said
    assert "poses stay within the joint limits, in the assembly mode of the home pose" in said
    assert "written: " in said


# Plans that separate two causes


def test_backlash_and_a_zero_offset_take_both_sides(tmp_path, capsys):
    code, plan = run_plan(tmp_path, "--separate", "backlash", "joint_zero_offset")
    assert code == 0
    assert len(plan) == 20
    assert 7 <= np.sum(plan.direction == 1) <= 13
    assert (plan.payload == 0).all()  # loads make no difference
    assert plan.paths == ()
    said = capsys.readouterr().out
    assert "approached from both sides" in said
    rows = {line[:15].strip(): line.split()[-2:] for line in said.splitlines()[2:4]}
    assert float(rows["20 plain stops"][0]) > 0.99
    assert float(rows["20 plain stops"][1]) < 1
    assert float(rows["this plan"][0]) < 0.5
    assert float(rows["this plan"][1]) > 1000


@pytest.mark.parametrize("second", ["arm_length", "joint_zero_offset", "geometry"])
def test_compliance_and_a_dimension_take_two_payloads_and_motion(second):
    """Springs also yield to inertia, and then the stops need to tell less."""
    found = part(ROBOT, ("joint_compliance", second))
    assert np.unique(found.plan.payload).tolist() == [0.0, 2.0]
    assert found.plan.paths
    assert (found.plan.direction == 1).all()  # sides make no difference
    assert np.count_nonzero(np.diff(found.plan.payload)) == 1  # it changes once
    assert found.after.parted
    assert found.after.signal > 10 * found.before.signal
    swapped = part(ROBOT, (second, "joint_compliance"), payload=1.0).plan
    assert np.unique(swapped.payload).tolist() == [0.0, 1.0]


def test_what_depends_on_acceleration_takes_circles(tmp_path, capsys):
    code, plan = run_plan(tmp_path, "--separate", "dynamic_deflection", "joint_lag")
    assert code == 0
    names = [path.name for path in plan.paths]
    assert any(name.startswith("circle") for name in names)
    assert f"paths: {', '.join(names)}" in capsys.readouterr().out


def test_what_depends_on_warmth_takes_its_time(tmp_path, capsys):
    code, _ = run_plan(tmp_path, "--separate", "thermal_growth_arm", "joint_zero_drift")
    assert code == 0
    said = capsys.readouterr().out
    assert "in this order, over an hour of warming up by 10 K and an hour of cooling:" in said
    assert "  stops 1 to " in said
    assert " to 20 after " in said


def test_what_no_motion_parts_is_said(tmp_path, capsys):
    code, _ = run_plan(tmp_path, "--separate", "geometry", "tracker_scale", "--count", "5")
    assert code == 0
    said = capsys.readouterr().out
    assert "not enough to distinguish them: measure a scale bar" in said


def test_the_plan_shows_a_hidden_backlash_beside_zero_offsets():
    """With this plan a hidden backlash is found; with plain stops it cannot be determined."""
    gap = 0.3e-3
    plan = part(ROBOT, ("backlash", "joint_zero_offset"), count=30, seed=2).plan
    plain = make_plan("identify", ROBOT, count=30, both_sides=False)
    machine = draw_machine(ROBOT, 4, hidden=[("backlash", {"value": str(gap)})])
    spread = []
    for measured in (plan, plain):
        recorded = survey(simulate_session(machine, measured, 6), ROBOT.joints.names)
        evidence = calibrated(recorded, ROBOT).evidence
        effect = EFFECTS["backlash"](ROBOT, evidence.chain.mechanism)
        columns = columns_of(Candidate("backlash", "drive", None, effect, (0, 1, 2)), evidence)
        normal = evidence.information(columns) + 1e-2 * np.eye(3)
        value = np.linalg.solve(normal, columns.T @ evidence.weigh(evidence.column))[:, 0]
        spread.append(effect.parameters.prior * np.sqrt(np.diag(np.linalg.inv(normal))))
        if measured is plan:
            found = effect.parameters.prior * value
    assert (spread[0] < 0.05 * gap).all()
    assert (np.abs(found - gap) < 4 * spread[0]).all()
    assert (spread[1] > 0.5 * gap).all()


def test_a_plan_adds_to_a_session_or_goes_by_a_calibration(tmp_path, capsys):
    session, calibration = str(tmp_path / "session"), str(tmp_path / "calibration.yaml")
    simulated = ["simulate", "--robot", "srbd", "--plan", "identify", "--count", "20"]
    assert run([*simulated, "--out", session]) == 0
    assert run(["fit", session, "--robot", "srbd", "--out", calibration]) == 0
    capsys.readouterr()
    asked = ("--separate", "joint_compliance", "geometry", "--count", "8")
    code, added = run_plan(tmp_path, *asked, "--from", session)
    said = capsys.readouterr().out
    assert code == 0
    assert said.splitlines()[2].startswith("session ")
    assert said.splitlines()[3].startswith("with this plan ")
    # The session has poses without load, so poses with load are added.
    assert np.sum(added.payload == 2.0) >= 6
    code, by_fit = run_plan(tmp_path, *asked, "--calibration", calibration)
    assert code == 0
    assert set(by_fit.payload) == {0.0, 2.0}


# Refusals


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give one of --name, --identify, --update and"),
        (["--name", "line", "--identify"], "give one of --name, --identify, --update and"),
        (["--name", "spiral"], "no plan 'spiral'; there are: line, "),
        (["--separate", "rust", "geometry"], "no cause 'rust'; there are: tracker_scale, "),
        (["--separate", "backlash", "play"], "no cause 'play'; there are: "),
        (["--separate", "cable_sag", "backlash"], "no cause 'cable_sag'; there are: "),
        (["--separate", "encoder_interpolation", "backlash"], "no cause 'encoder_interpolation'"),
        (["--separate", "backlash", "slider_pitch"], "no cause 'slider_pitch'; there are: "),
        (["--name", "line", "--payload-kg", "9"], "--payload-kg is for --name rich and --separat"),
        (["--separate", "backlash", "backlash"], "'backlash' cannot be distinguished from itself"),
        (["--identify", "--from", "x"], "--from and --calibration are for --separate"),
        (
            ["--separate", "backlash", "geometry", "--from", "x", "--calibration", "y"],
            "--from and --calibration exclude each other",
        ),
        (["--name", "line", "--radius-mm", "100"], "--radius-mm is for --identify, --update and"),
        (["--separate", "backlash", "geometry", "--from", "none"], "none"),
        (["--separate", "backlash", "geometry", "--calibration", "none"], "none"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(tmp_path, capsys, arguments, message):
    code, _ = run_plan(tmp_path, *arguments)
    said = capsys.readouterr()
    assert code == 2
    assert message in said.err
    assert "Traceback" not in said.err
    assert not list(Path(tmp_path).iterdir())
