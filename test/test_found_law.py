"""Tests of found laws: products, files, and equations compared with the blind generator."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from blind import hide
from blind.cause import Cause
from delta_calibration.calibration import Calibration
from delta_calibration.cli.diagnose import describe
from delta_calibration.commands import warmth_by_part
from delta_calibration.compensation import CommandStatus, JointCompensator
from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.diagnosis import judge as judgement
from delta_calibration.diagnosis.constants import ALPHA, LACKING
from delta_calibration.diagnosis.diagnose import Diagnosis, diagnose
from delta_calibration.diagnosis.fitted import _vertex
from delta_calibration.diagnosis.geometry import scatter_of
from delta_calibration.diagnosis.judge import _loosened
from delta_calibration.diagnosis.law_grammar import Grammar, signals_of
from delta_calibration.diagnosis.law_screen import Reshaped, Screen
from delta_calibration.diagnosis.law_search import likely_laws
from delta_calibration.diagnosis.law_words import told
from delta_calibration.diagnosis.verdict import FoundEquation
from delta_calibration.effects import catalogue
from delta_calibration.effects.catalogue import effect_named
from delta_calibration.effects.found_law import (
    FOUND_LAW,
    TORQUE,
    FoundLaw,
    Quantity,
    Target,
)
from delta_calibration.effects.law_forms import FORMS, FUNCTIONS
from delta_calibration.errors import InputError
from delta_calibration.export.effect_file import effect_file, require_effect_name
from delta_calibration.plans import make_plan
from delta_calibration.region import Region
from delta_calibration.report.verdict_file import verdict_of
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from study.judge import judge
from study.trials import Task
from trial_bench import trial

ROBOT = load_robot("srbd")
MECHANISM = ROBOT.model()


@cache
def seen(kind: str, seed: int, strength: float) -> tuple[Diagnosis, Cause]:
    """Diagnosis of a session with a hidden structure, without the effect of that name."""
    trial = hide({kind: strength}, seed)
    every = tuple(e for e in catalogue(ROBOT, MECHANISM) if e.cause != kind)
    found = diagnose(survey(trial.session, ROBOT.joints.names), ROBOT, effects=every, seed=seed)
    return found, trial.causes[0]


@pytest.fixture(scope="module", name="start")
def start_fixture():
    trial = hide({"unknown:rub": 1.0}, 771)
    return calibrated(survey(trial.session, ROBOT.joints.names), ROBOT)


@pytest.mark.parametrize("kind", FORMS)
def test_a_function_is_what_its_texts_say(kind):
    """As told in an equation, and as written into an effect file."""
    u, form = np.array([-1.7, -0.4, 0.0, 0.3, 2.6]), FORMS[kind]
    words = {name: getattr(np, name) for name in ("sin", "cos", "sign", "tanh", "exp", "abs")}
    words.update(max=np.maximum, min=np.minimum)
    said = eval(form.text("(u)").replace("^", "**"), {**words, "u": u})
    coded = eval(form.coded, {**vars(np), "u": u})
    np.testing.assert_allclose(np.broadcast_to(said, u.shape), form.of(u, np), atol=1e-15)
    np.testing.assert_allclose(np.broadcast_to(coded, u.shape), form.of(u, np), atol=1e-15)


def test_products_are_those_of_the_evidence(start) -> None:
    """Computed shape by shape, and by the columns of each compiled law."""
    evidence = start.evidence
    signals = signals_of(evidence, ROBOT)
    every = list(Grammar(ROBOT, evidence, signals).laws())
    of_each = {law.function: law for law in every}.values()
    laws = [*(every[i] for i in np.linspace(0, len(every) - 1, 25).astype(int)), *of_each]
    assert {law.function for law in laws} == set(FUNCTIONS)
    screen = Screen(evidence, signals)
    cases = screen.cases(every)
    for law, case in zip(laws, (cases[every.index(law)] for law in laws), strict=True):
        sized = replace(law, typical=tuple(case.size.tolist()))
        columns = evidence.columns(sized)
        information = evidence.information(columns)
        assert case.information == pytest.approx(information, abs=1e-9 * np.abs(information).max())
        signal = columns @ case.value
        assert screen.signal([law], case) == pytest.approx(signal, abs=1e-9 * np.abs(signal).max())


@pytest.mark.parametrize("number", range(3))
def test_a_law_in_another_shape_is_what_all_together_are(start, number: int) -> None:
    """Unchanged parts are kept; the result equals that of new columns."""
    evidence = start.evidence
    screen = Screen(evidence, signals_of(evidence, ROBOT))
    targets = [Target(f"joint_{j + 1}", f"dq_{j + 1}", ((j, 1.0),), "rad", j) for j in range(3)]
    wave = FoundLaw(ROBOT, MECHANISM, targets=tuple(targets[:2]), function="wave", scale=3.0)
    ramp = replace(wave, targets=tuple(targets[2:]), function="ramp", scale=2.0, middle=0.1)
    laws = (wave, ramp, replace(ramp, by=Quantity("direction")))
    every = Reshaped(screen, laws, number)
    for scale in (1.0, 4.5):
        other = replace(laws[number], scale=scale)
        found = every.case(other)
        expected = screen.case((*laws[:number], other, *laws[number + 1 :]))
        assert found.log_bayes == pytest.approx(expected.log_bayes, rel=1e-8)
        assert found.gain == pytest.approx(expected.gain, rel=1e-8)
        np.testing.assert_allclose(found.size, expected.size)
        np.testing.assert_allclose(found.value, expected.value, rtol=1e-6)
        largest = np.abs(expected.information).max()
        np.testing.assert_allclose(found.information, expected.information, atol=1e-9 * largest)


def test_a_law_that_leaves_much_more_than_noise_is_none(start) -> None:
    """It may be likely and foretell what it explains: it is not what happened."""
    evidence, rng = start.evidence, np.random.default_rng(8)
    wave = FoundLaw(
        ROBOT,
        MECHANISM,
        targets=(Target("joint_2", "dq_2", ((1, 1.0),), "rad", 1),),
        function="wave",
        scale=3.0,
    )
    size = np.array([1.2e-4, 6e-5]) / wave.parameters.prior
    signal = (evidence.columns(wave) @ size).reshape(evidence.residual.shape)
    noise = rng.standard_normal(signal.shape) * evidence.believed[:, None]
    for scatter, found in ((1.0, True), (1.8, False)):
        residual = signal + scatter * noise
        laws = likely_laws(
            replace(evidence, residual=residual), ROBOT, catalogue(ROBOT, MECHANISM)[0], rng
        )
        assert bool(laws) == found
        assert all(law.guess.parts[0].targets[0].part == "joint_2" for law in laws)


def test_a_platform_shifted_by_its_position_may_be_errors_of_the_tracker(start) -> None:
    """Both move the readings alike, so the tracker is a rival, and another station tells."""
    evidence, rng = start.evidence, np.random.default_rng(9)
    laws = [*Grammar.of(evidence, ROBOT).laws()]
    shift = next(
        law
        for law in laws
        if (law.targets[0].moved, law.of.name, law.function, law.by) == ("dz", "x", "cubic", None)
    )
    turn = next(law for law in laws if law.targets[0].part == "joint_2" and law.of.name == "q")
    for law, tracker in ((shift, True), (replace(turn, function="wave", scale=3.0), False)):
        columns = evidence.columns(law)
        signal = columns @ (150.0 / np.linalg.norm(columns, axis=0))
        signal = signal.reshape(evidence.residual.shape)
        noise = rng.standard_normal(signal.shape) * evidence.believed[:, None]
        any_effect = catalogue(ROBOT, MECHANISM)[0]
        found = likely_laws(replace(evidence, residual=signal + noise), ROBOT, any_effect, rng)
        entry = told(found, start)[0]
        assert found[0].guess.parts[0].targets[0].part == law.targets[0].part
        assert ("tracker" in (entry.rival or "")) == tracker
        assert ("tracker somewhere else" in (entry.separated_by or "")) == tracker


def test_dimensions_do_not_exceed_their_tolerances_if_a_law_is_likelier(start) -> None:
    """Wrong dimensions can imitate a product of two angles almost within the noise."""
    evidence, rng = start.evidence, np.random.default_rng(10)
    product = FoundLaw(
        ROBOT,
        MECHANISM,
        targets=(Target("joint_2", "dq_2", ((1, 1.0),), "rad", 1),),
        of=Quantity("q", 1),
        by=Quantity("q", 2),
    )
    a = 5e-4 / product.parameters.prior
    tolerances = 4.0 * rng.standard_normal(evidence.geometry.shape[1])
    for signal, loosened in (
        (evidence.columns(product) @ a, False),
        (evidence.geometry @ tolerances, True),
    ):
        noise = rng.standard_normal(evidence.residual.shape) * evidence.believed[:, None]
        off = replace(evidence, residual=signal.reshape(noise.shape) + noise)
        found = replace(start, seen=off)
        scatter = scatter_of(found.beside)
        assert found.misfit < LACKING
        assert scatter.log_p < np.log(ALPHA)
        loose = _loosened(start, found, catalogue(ROBOT, MECHANISM))
        assert (loose is not start) == loosened


def test_a_line_of_a_joint_that_works_far_from_zero_counts_from_its_middle() -> None:
    """A leaning column: through a distant zero only a curve of another slope fits."""
    robot = load_robot("five_axis")
    session = simulate_session(draw_machine(robot, 5), make_plan("identify", robot, seed=5), 5)
    evidence = calibrated(survey(session, robot.joints.names, 0.3), robot).evidence
    row = evidence.chain.mechanism.parameters.names.index("slider_y_2")
    height = evidence.at.joint[:, 1]
    lean = 4e-4 * (height - height.mean())
    off = evidence.residual + evidence.by_geometry[:, :, row] * lean[:, None]
    any_effect = catalogue(robot, evidence.chain.mechanism)[0]
    rng = np.random.default_rng(5)
    found = likely_laws(replace(evidence, residual=off), robot, any_effect, rng)
    law, case = found[0].guess.parts[0], found[0].guess.case
    assert (law.targets[0].part, law.of.name, law.function) == ("slider_y_2", "q", "line")
    assert law.middle == pytest.approx((height.min() + height.max()) / 2, abs=1e-3)
    assert case.value * case.size == pytest.approx([4e-4], rel=0.1)


def test_a_law_goes_into_a_file_and_comes_back(start) -> None:
    of = Quantity("temperature", part="arm")
    targets = (
        Target("joint_2", "dq_2", ((1, 1.0),), "rad", 1),
        Target("joint_3", "dq_3", ((2, 0.5), (0, -0.25)), "rad", 2),
    )
    law = FoundLaw(
        ROBOT, MECHANISM, targets=targets, of=Quantity("torque", 1), by=of, function="saturation"
    )
    law = replace(law, middle=0.3, scale=2.0, typical=(1e-4, 2e-4))
    back = effect_named(FOUND_LAW, ROBOT, MECHANISM, law.settings)
    assert back == replace(law, searched=())
    evidence = start.evidence
    np.testing.assert_array_equal(evidence.columns(back), evidence.columns(law))


@pytest.mark.parametrize(
    ("setting", "value", "said"),
    [
        ("on", "somewhere", "on: 'somewhere'"),
        ("of", "wind", "of: 'wind'"),
        ("by", "q+x", "by: 'q+x'"),
        ("of", "temperature", "'temperature' is not allowed"),
        ("by", "torque", "by: 'torque' is not allowed"),
        ("function", "gamma", "function: 'gamma'"),
        ("targets", "joint_1", "targets: 'joint_1'"),
        ("targets", "joint_1 dq_1 rad 0 3:1.0", "targets: [3]"),
        ("targets", "joint_1 dq_1 rad 3 0:1.0", "targets: joint 3"),
        ("targets", "joint_1 dq_1 rad 0 0:x", "targets:"),
        ("typical", (1.0, 2.0), "typical: 2 numbers"),
        ("typical", (-1.0,), "typical"),
        ("scale", float("nan"), "finite"),
    ],
)
def test_settings_that_are_no_law_are_refused(setting, value, said) -> None:
    good = {"on": "drive", "targets": "joint_1 dq_1 rad 0 0:1.0", "of": "q", "typical": (1e-4,)}
    effect_named(FOUND_LAW, ROBOT, MECHANISM, good)
    with pytest.raises(InputError, match="found_law: settings") as refused:
        effect_named(FOUND_LAW, ROBOT, MECHANISM, {**good, setting: value})
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("function", "of", "by", "units"),
    [
        ("line", "q", "", ["1"]),
        ("quadratic", "q", "", ["1", "1/rad"]),
        ("bilinear", "q", "q+1", ["1/rad", "1", "1"]),
        ("square", "torque", "", ["rad/(N m)^2"]),
        ("line", "payload", "q", ["1/kg"]),
        ("cube", "rate", "payload", ["rad/((rad/s)^3 kg)"]),
    ],
)
def test_units_of_values_make_the_unit_of_what_is_moved(function, of, by, units) -> None:
    moved = {"on": "drive", "targets": "joint_1 dq_1 rad 0 0:1.0", "typical": (1e-4,) * len(units)}
    law = effect_named(
        FOUND_LAW, ROBOT, MECHANISM, {**moved, "function": function, "of": of, "by": by}
    )
    assert [p.unit for p in law.parameters] == units


def test_a_law_of_a_temperature_needs_its_thermometer(start) -> None:
    at = start.evidence.at
    law = FoundLaw(
        ROBOT,
        MECHANISM,
        targets=(Target("joint_1", "dq_1", ((0, 1.0),), "rad", 0),),
        of=Quantity("temperature", part=at.temperature_parts[0]),
    )
    assert law.sensors == at.temperature_parts[:1]
    assert law.missing(at) == ""
    unheard = replace(at, temperature_parts=(), temperature=at.temperature[:, :0])
    unknown = replace(at, temperature=np.full_like(at.temperature, np.nan))
    assert law.sensors[0] in law.missing(unheard)
    assert law.sensors[0] in law.missing(unknown)


def test_a_command_is_not_corrected_by_a_law_without_its_thermometer(start) -> None:
    """It was, as if the part were at 0 deg C."""
    bare = start.problem.chain
    law = FoundLaw(
        ROBOT,
        MECHANISM,
        targets=(Target("joint_1", "dq_1", ((0, 1.0),), "rad", 0),),
        of=Quantity("temperature", part="arm"),
        typical=(1e-5,),
    )
    chain = bare.with_effects((law,))
    theta = np.append(start.theta, 1e-4)
    disc = make_plan("disc", ROBOT, count=4, both_sides=False)
    region = Region.of(np.concatenate([disc.target - 0.01, disc.target + 0.01]))
    limits = ROBOT.joints.lower, ROBOT.joints.upper
    calibration = Calibration(ROBOT, chain, theta, region, *limits, 0.0, "", "")
    told = JointCompensator(calibration).compensate(disc.joint[:1])
    assert told.verdicts == (CommandStatus.MISSING_CONDITION,)
    np.testing.assert_array_equal(told.joint, disc.joint[:1])
    said: list[str] = []
    assert warmth_by_part((("arm", 30.0),), calibration, said.append) == {"arm": 30.0}
    assert not said  # not: "the calibration has no growth of arm"


@pytest.mark.parametrize("name", ["My Law.py", "law.txt", "backlash.py", "class.py", "1st.py"])
def test_a_name_that_is_none_of_an_effect_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="name"):
        require_effect_name(Path(name))


def value_of(law: FoundEquation, **inputs: float | np.ndarray) -> np.ndarray:
    """Right side of the equation, by Python's own arithmetic."""
    names = {"sin": np.sin, "cos": np.cos, "tanh": np.tanh, "exp": np.exp, "sign": np.sign}
    names |= {"max": np.maximum, "min": np.minimum, "abs": np.abs}
    letters = {name: estimate.value for name, estimate in law.values.items()}
    text = law.equation.split(";")[0].split("=")[1].replace("^", "**")
    return np.asarray(eval(text, {"__builtins__": {}}, {**names, **letters, **inputs}))


def likeness(found: np.ndarray, true: np.ndarray, of: np.ndarray) -> float:
    """R^2 after subtracting a line of the variable from both: the geometry absorbs it."""
    line = np.stack([np.ones_like(of), of], axis=1)
    left = [y - line @ np.linalg.lstsq(line, y, rcond=None)[0] for y in (found, true)]
    return float(np.corrcoef(*left)[0, 1] ** 2)


@pytest.mark.slow
def test_a_cover_that_arms_rub_on_is_an_equation_of_each_joints_angle() -> None:
    found, _ = seen("unknown:rub", 515, 0.2)
    laws = found.verdict.unknown_structure.laws
    assert [law.part for law in laws] == ["joint_1", "joint_2", "joint_3"]
    rng = np.random.default_rng([515, 2])  # the generator's draw: begin and size
    begins = rng.uniform(0.05, 0.3, 3)
    for j, law in enumerate(laws):
        assert law.stage == "drive"
        assert law.variables == (f"q_{j + 1}",)
        q = np.linspace(*law.region[f"q_{j + 1}"], 200)
        true = -np.clip(q - begins[j], 0.0, 0.25)
        assert likeness(value_of(law, **{f"q_{j + 1}": q}), true, q) > 0.9
    assert verdict_of(found.verdict.as_dict()).unknown_structure.laws == laws
    text = describe(found.verdict)
    assert "law at joint_1 (drive)" in text
    assert laws[0].equation in text


@pytest.mark.slow
def test_growth_that_is_not_in_the_catalogue_is_one_of_the_arms_temperature() -> None:
    found, cause = seen("thermal_growth_arm", 516, 0.6)
    laws = found.verdict.unknown_structure.laws
    assert [law.part for law in laws] == ["arm_1", "arm_2", "arm_3"]
    for law in laws:
        assert law.stage == "structure"
        assert law.variables == ("temperature_arm",)
        slope = law.values[f"a_{law.part[-1]}"]
        true = 0.32 * float(cause.values["expansion"])  # length of the arm [m]
        assert slope.unit == "m/K"
        assert abs(slope.value - true) < 3.5 * slope.std


@pytest.mark.slow
@pytest.mark.parametrize("doubt", [0.4, 0.6])
def test_a_cause_is_named_only_where_it_is_likelier_than_a_law(monkeypatch, doubt: float) -> None:
    """Otherwise a map stands in its place, so that its errors are corrected all the same."""
    monkeypatch.setattr(judgement, "doubts_of_names", lambda *_: doubt)
    session = survey(hide({"joint_compliance": 1.0}, 518).session, ROBOT.joints.names)
    verdict = diagnose(session, ROBOT, seed=518).verdict
    named = [finding for finding in verdict.findings if finding.cause == "joint_compliance"]
    assert verdict.unknown_structure.found == (doubt > 0.5)
    assert [f.confidence <= 1 - doubt for f in named] == [True] * (doubt < 0.5)
    assert verdict.extended.held_out_rms_mm < 0.8 * verdict.calibrated.held_out_rms_mm


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "cause", "strength"),
    [(100730, "thermal_growth_base", 3340.12), (872700, "thermal_growth_forearm", 3367.42)],
)
def test_two_causes_are_not_named_that_together_do_no_more_than_one_law(
    seed: int, cause: str, strength: float
) -> None:
    """A growing base is no growth of the rods beside a drift, nor growing rods two drifts.

    A law has 1.6 and 0.2 % more ln B than the two, but hardly more than the stronger of them.
    """
    said = trial(seed, (cause, strength), without=cause)
    assert said["unknown"]
    assert not said["findings"]


@pytest.mark.slow
def test_structure_without_an_equation_is_given_none() -> None:
    found, _ = seen("unknown:bump", 517, 0.15)
    assert found.verdict.unknown_structure.found
    assert found.verdict.unknown_structure.laws == ()
    assert not found.laws


@pytest.mark.slow
def test_a_law_as_an_effect_of_ones_own_is_found_by_name(tmp_path: Path) -> None:
    """The file contains the law; with it the same session has a cause that a fit knows."""
    found, _ = seen("unknown:rub", 515, 0.2)
    module = loaded(effect_file(found.laws[0].guess, "rubbing_cover", "Seen."), tmp_path)
    own = module.RubbingCover(ROBOT, MECHANISM)
    evidence, parts = found.model.evidence, found.laws[0].guess.with_sizes()
    whole = [evidence.columns(part) / part.parameters.prior for part in parts]
    ours = evidence.columns(own) / own.parameters.prior
    np.testing.assert_allclose(ours, np.concatenate(whole, axis=1), rtol=1e-9, atol=1e-6)
    trial = hide({"unknown:rub": 0.2}, 515)
    session = survey(trial.session, ROBOT.joints.names)
    again = diagnose(session, ROBOT, effects=(*catalogue(ROBOT, MECHANISM), own), seed=515)
    assert [finding.cause for finding in again.verdict.findings] == ["rubbing_cover"]
    assert not again.verdict.unknown_structure.found


def loaded(text: str, folder: Path) -> ModuleType:
    path = folder / "rubbing_cover.py"
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location("rubbing_cover", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_a_clean_machine_has_no_law() -> None:
    assert judge(Task("none", 519).key)["laws"] == []


def test_no_law_is_of_a_joint_that_bears_no_weight() -> None:
    """An upright axis: rounding noise of its torque gave values of 1e8, which were shipped."""
    plain = load_robot("ur10")
    links = tuple(replace(link, mass=5.0) for link in plain.dimensions.links)
    arm = replace(plain, dimensions=replace(plain.dimensions, links=links))
    plan = replace(make_plan("identify", arm, count=30, seed=2), paths=())
    session = simulate_session(draw_machine(arm, 2), plan, 2)
    start = calibrated(survey(session, arm.joints.names), arm)
    signals = signals_of(start.evidence, arm)
    laws = [law for law in Grammar(arm, start.evidence, signals).laws() if law.of.name == TORQUE]
    bearing = {law.of.number(t.joint, len(arm.joints.names)) for law in laws for t in law.targets}
    assert bearing == {1, 2, 3, 4}  # the last joint turns evenly spread masses


def test_the_top_of_a_search_is_between_its_neighbours() -> None:
    """Of points that are alike the middle one is taken, which need not be the highest."""
    assert _vertex(1.0, 2.0, 1.5) == pytest.approx(1 / 6)
    assert _vertex(0.0, 1.0, 1.99) == 1.0


def test_laws_of_travel_are_tried_though_it_is_unknown_before_the_first_reversal(start) -> None:
    known = signals_of(start.evidence, ROBOT)
    rows = known.rows.copy()
    rows[:20, known.places.slices["travel"]] = np.inf
    signals = replace(known, rows=rows)
    laws = Grammar(ROBOT, start.evidence, signals).laws()
    assert {t.joint for law in laws if law.of.name == "travel" for t in law.targets} == {0, 1, 2}


def misread(causes: dict[str, float], seed: int, joint: int, error) -> Diagnosis:
    """Diagnosis of a SCARA whose recorded angle of a joint is `error(q)` [rad] less than true."""
    robot = load_robot("scara")
    session = hide(causes, seed, "no_sweeps", robot="scara").session

    def read(stream):
        position = stream.position.copy()
        position[:, joint] -= error(stream.position.T)
        return replace(stream, position=position)

    session = replace(session, command=read(session.command), states=read(session.states))
    return diagnose(survey(session, robot.joints.names), robot, seed=seed)


@pytest.mark.slow
def test_a_cause_much_weaker_than_a_law_is_told_beside_it() -> None:
    """A map would take its place: the law alone leaves several times the noise."""
    verdict = misread({"backlash": 0.12}, 906, 0, lambda q: 8e-4 * q[1] ** 2).verdict
    (finding,), (law,) = verdict.findings, verdict.unknown_structure.laws
    assert finding.cause == "backlash"
    true = hide({"backlash": 0.12}, 906, "no_sweeps", robot="scara").causes[0].values
    for name, gap in finding.parameters.items():
        assert abs(gap.value - float(true[name])) < 3.5 * gap.std
    assert law.variables == ("q_2",)
    square = law.values["b_1"]
    assert abs(square.value - 8e-4) < 3.5 * square.std


@pytest.mark.slow
def test_a_product_of_angles_about_other_values_than_zero_is_a_law() -> None:
    verdict = misread({}, 907, 1, lambda q: 2.5e-4 * (q[0] - 0.6) * q[1]).verdict
    (law,) = verdict.unknown_structure.laws
    assert (law.part, set(law.variables)) == ("joint_2", {"q_1", "q_2"})
    assert law.equation == "dq_2 = a_2*q_2*q_1 + b_2*q_2 + c_2*q_1"
    product = law.values["a_2"]
    assert abs(product.value - 2.5e-4) < 3.5 * product.std
