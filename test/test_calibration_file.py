"""A calibration is read as it was written, or is refused with a reason."""

from __future__ import annotations

import errno
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from delta_calibration.calibration_file import (
    from_identification,
    load_calibration,
    save_calibration,
)
from delta_calibration.data import collect
from delta_calibration.documents import content_hash
from delta_calibration.effects import effect_named
from delta_calibration.errors import ConfigError
from delta_calibration.estimation import Effort, identify
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("srbd")


@pytest.fixture(scope="module")
def fitted():
    """A fit of the faster model, and the poses from which it was made."""
    plan = make_plan("identify", ROBOT, count=14, dwell=0.4, both_sides=False)
    session = simulate_session(draw_machine(ROBOT, 1), plan, 1, source="out/cell/monday")
    poses = collect(session, ROBOT.joints.names)
    return identify(poses, ROBOT, model="rotary_delta", seed=4), poses


@pytest.fixture
def written(fitted, tmp_path):
    path = tmp_path / "calibration.yaml"
    save_calibration(path, fitted[0], ROBOT, fitted[1])
    return path


def content_of(path):
    return YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))


def sealed(path, change):
    """The file with changed content and a new seal: only the meaning can be wrong."""
    data = content_of(path)
    change(data)
    del data["sha256"]
    data["sha256"] = content_hash(data)
    with path.open("w", encoding="utf-8") as file:
        YAML(typ="safe", pure=True).dump(data, file)
    return path


def refusal(path, robot=ROBOT):
    with pytest.raises(ConfigError) as caught:
        load_calibration(path, robot)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def test_what_is_read_is_what_was_found(fitted, written):
    found, poses = fitted
    read = load_calibration(written, ROBOT)
    np.testing.assert_array_equal(read.theta, found.theta)
    assert read.chain.parameters.names == found.parameters.names
    assert read.chain.mechanism.name == "rotary_delta"
    np.testing.assert_array_equal(read.region.vertices, found.region.vertices)
    np.testing.assert_array_equal(read.joints_lower, poses.joint.min(axis=0))
    np.testing.assert_array_equal(read.joints_upper, poses.joint.max(axis=0))
    assert read.noise_floor == pytest.approx(found.noise.floor, rel=1e-15)
    assert read.source == "monday"  # name of the recording, without its folder
    assert read.robot is ROBOT
    made = from_identification(found, ROBOT, poses)
    assert made.seal == read.seal == content_of(written)["sha256"]
    np.testing.assert_array_equal(made.theta, read.theta)
    tool = [calibration.tool_points(poses.point, poses.joint) for calibration in (made, read)]
    np.testing.assert_array_equal(*tool)


def test_where_it_came_from_is_written(fitted, written):
    found, poses = fitted
    data = content_of(written)
    assert data["robot"] == {"name": "srbd", "sha256": ROBOT.machine_hash}
    origin = data["provenance"]
    assert (origin["seed"], origin["poses"], origin["readings"]) == (4, 14, poses.readings)
    assert origin["session_start"] == "2023-11-14T22:13:20+00:00"
    assert origin["rejected"] == poses.rejected.counts()
    entry = next(e for e in data["parameters"] if e["name"] == "arm_2")
    row = found.parameters.row("arm_2")
    assert (entry["unit"], entry["nominal"]) == ("m", pytest.approx(0.32))
    assert entry["value"] == found.theta[row]
    assert entry["std"] == pytest.approx(np.sqrt(found.covariance[row, row]))
    assert data["residuals"]["full"]["in_sample_rms_mm"] == found.full.in_sample * 1e3


@pytest.mark.parametrize("value", [1e-5, -1e-16, 1e22, 5e-324, 0.1 + 0.2, -0.0, 3.0])
def test_every_number_survives_the_text(fitted, tmp_path, value):
    found, poses = fitted
    theta = found.theta.copy()
    theta[-1] = value  # position of the tracker: any number is valid
    path = tmp_path / "calibration.yaml"
    save_calibration(path, replace(found, theta=theta), ROBOT, poses)
    assert load_calibration(path, ROBOT).theta[-1] == value


def test_comments_order_and_spelling_may_change(written):
    seal = load_calibration(written, ROBOT).seal
    text = written.read_text(encoding="utf-8")
    sections = re.split(r"\n(?=\w)", text.strip())
    assert len(sections) == 11
    turned = "# moved\n" + "\n".join(reversed(sections))
    turned = turned.replace("nominal: 0.32,", "nominal: 32e-2,")
    assert turned.count("32e-2") == 3
    written.write_text(turned, encoding="utf-8")
    assert load_calibration(written, ROBOT).seal == seal


def test_cut_off_anywhere_it_is_refused(written):
    """Like after a crash of a program that writes in place."""
    text = written.read_text(encoding="utf-8").rstrip("\n")
    cuts = np.linspace(0, len(text) - 1, 20).astype(int)
    for cut in [*cuts, len(text) - 64, len(text) - 72, len(text) - 2]:
        written.write_text(text[:cut], encoding="utf-8")
        assert refusal(written)
    lines = text.splitlines()
    for gone in range(0, len(lines), 3):  # or an editor that loses a line
        written.write_text("\n".join(lines[:gone] + lines[gone + 1 :]), encoding="utf-8")
        assert refusal(written)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (r"(name: arm_2, .*value: 0\.3[12]\d\d\d\d)\d", r"\g<1>"),
        (r"seed: 4", "seed: 5"),
        (r"model: rotary_delta", "model: six_rod_delta"),
        (r"floor_mm: 0", "floor_mm: 1"),
        (r"name: arm_1,", "name: arm_2,"),
        (r"unit: rad", "unit: m"),
        (r"measured: false", "measured: true"),
    ],
)
def test_an_edited_entry_is_refused(written, old, new):
    text = written.read_text(encoding="utf-8")
    changed = re.sub(old, new, text, count=1)
    assert changed != text
    written.write_text(changed, encoding="utf-8")
    message = refusal(written)
    assert message == "sha256: the file was changed or cut off after it was written; fit again"


def test_an_edited_number_that_is_none_is_named_by_its_path(written):
    text = written.read_text(encoding="utf-8")
    written.write_text(re.sub(r"(name: arm_1, .*value: 0\.3)", r"\1x", text), encoding="utf-8")
    message = refusal(written)
    assert re.match(r"parameters\[6\]\.value: '0\.3x\d+' is not allowed; a number is", message)


def test_another_robots_calibration_is_refused_with_both_hashes(written, tmp_path):
    text = Path(ROBOT.source).read_text(encoding="utf-8")
    other = tmp_path / "other.yaml"
    other.write_text(text.replace("rod_mm: 850.0", "rod_mm: 850.1"), encoding="utf-8")
    robot = load_robot(other)
    message = refusal(written, robot)
    assert f"made for 'srbd' with hash {ROBOT.machine_hash[:12]}" in message
    assert f"{other} is 'srbd' with hash {robot.machine_hash[:12]}" in message


def edited_robot(folder: Path, old: str, new: str) -> Robot:
    text = Path(ROBOT.source).read_text(encoding="utf-8")
    assert old in text
    (folder / "edited.yaml").write_text(text.replace(old, new), encoding="utf-8")
    return load_robot(folder / "edited.yaml")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("correction_deg: 1.0", "correction_deg: 2.0"),
        ("condition: 20.0", "condition: 30.0"),
        ("encoder_urad: ", "encoder_urad: 1"),
        ("speed_deg_per_s: ", "speed_deg_per_s: 1"),
        ("transverse_um: ", "transverse_um: 1"),
        ("lower_deg: [-35.0, ", "lower_deg: [-34.0, "),
    ],
)
def test_what_a_calibration_does_not_depend_on_may_change(written, tmp_path, old, new):
    robot = edited_robot(tmp_path, old, new)
    assert load_calibration(written, robot).seal == load_calibration(written, ROBOT).seal


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("gear_ratio: ", "gear_ratio: 1"),
        ("arm_mm: 0.15", "arm_mm: 0.2"),
        ("names: [joint_1, joint_2, joint_3]", "names: [joint_2, joint_1, joint_3]"),
        ("offset_mm: [0.0, 0.0, ", "offset_mm: [0.0, 1.0, "),
    ],
)
def test_what_it_depends_on_may_not(written, tmp_path, old, new):
    robot = edited_robot(tmp_path, old, new)
    assert "made for 'srbd' with hash" in refusal(written, robot)


def test_a_file_by_the_hash_of_the_whole_robot_file_is_read(written):
    """Like files of version 0.1.0."""
    sealed(written, lambda data: data["robot"].update(sha256=ROBOT.hash))
    assert load_calibration(written, ROBOT).robot is ROBOT


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "found nothing"),
        ("[1, 2", "not valid YAML: line 1, column "),
        ("\0\0\0\0", "a zero byte; the file is in UTF-16"),
        ("words", "found text"),
        ("schema: 1\n", "missing key robot, model, "),
        ("schema: 2\n", "schema: 2 is not allowed; it must be 1"),
    ],
)
def test_what_is_no_calibration_is_refused(tmp_path, text, message):
    path = tmp_path / "calibration.yaml"
    path.write_text(text, encoding="utf-8")
    assert message in refusal(path)


def test_a_robot_file_given_for_a_calibration_is_refused():
    path = Path(ROBOT.source)
    assert "is a robot file; a calibration file is expected" in refusal(path)


def test_a_missing_calibration_is_named(tmp_path):
    assert refusal(tmp_path / "none.yaml") == "cannot be read: No such file or directory"


def test_parameters_of_another_model_are_refused_though_the_seal_fits(written):
    def renamed(data):
        data["parameters"][6]["name"] = "gap_1"

    def swapped(data):
        data["parameters"][0], data["parameters"][1] = data["parameters"][1::-1]

    assert "model 'rotary_delta' has no gap_1; fit again" in refusal(sealed(written, renamed))
    sealed(written, lambda data: data["parameters"][6].update(name="arm_1"))
    said = refusal(sealed(written, swapped))
    assert "model 'rotary_delta' has its parameters in another order" in said
    sealed(written, swapped)
    said = refusal(sealed(written, lambda data: data["parameters"].pop(6)))
    assert "model 'rotary_delta' has arm_1, which the file lacks; fit again" in said
    assert "model: no mechanism 'scara'; there are: " in refusal(
        sealed(written, lambda data: data.update(model="scara"))
    )


def test_a_file_older_than_a_models_newest_errors_of_parts_has_none_of_them(fitted, tmp_path):
    """Before the lines at the elbows turned with the arms, six rods had 60 parameters."""
    path, poses = tmp_path / "old.yaml", fitted[1]
    found = identify(poses, ROBOT, seed=4)
    save_calibration(path, found, ROBOT, poses)
    new = np.array(["on_arm" in name for name in found.parameters.names])

    def older(data):
        data["parameters"] = [p for p in data["parameters"] if "on_arm" not in p["name"]]
        lines = [line.split() for line in data["uncertainty"]["factor_lower"]]
        data["uncertainty"]["factor_lower"] = [
            " ".join(np.array(line)[~new[: len(line)]])
            for line, gone in zip(lines, new, strict=True)
            if not gone
        ]

    whole, old = load_calibration(path, ROBOT), load_calibration(sealed(path, older), ROBOT)
    assert new.sum() == 6
    assert not old.theta[new].any()
    np.testing.assert_array_equal(old.theta[~new], whole.theta[~new])
    known = old.uncertainty.covariance
    np.testing.assert_allclose(np.diag(known)[new], found.parameters.prior[new] ** 2)
    assert not known[np.ix_(new, ~new)].any()
    lines = [line.split() for line in content_of(path)["uncertainty"]["factor_lower"]]
    assert known[0, 0] == pytest.approx(float(lines[0][0]) ** 2)
    last = np.array(lines[-1], dtype=float)
    assert known[-1, -1] == pytest.approx(last @ last)


def flat(data):
    data["region"]["vertices_m"] = data["region"]["vertices_m"][:3]


def infinite(data):
    data["parameters"][0]["value"] = float("inf")


def two_joints(data):
    data["region"]["joints_upper_rad"].pop()


def turned_round(data):
    region = data["region"]
    region["joints_lower_rad"], region["joints_upper_rad"] = (
        region["joints_upper_rad"],
        region["joints_lower_rad"],
    )


def set_arm(value):
    def change(data):
        next(e for e in data["parameters"] if e["name"] == "arm_2")["value"] = value

    return change


def unknown(data):
    data["region"]["shape"] = "ball"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (flat, "region.vertices_m: 3 values found, 4 are expected"),
        (infinite, "parameters[0].value: inf is not a finite number"),
        (two_joints, "region.joints_upper_rad: 2 values found, 3 are expected"),
        (turned_round, "region: joints_lower_rad is above joints_upper_rad"),
        (set_arm(-0.32), "parameters: arm_2 is -0.32 m; it has to be above 0"),
        (set_arm(3.2), "parameters: a rotary_delta of these dimensions has no pose at home"),
        (unknown, "region: unknown key shape; allowed: vertices_m, "),
    ],
)
def test_impossible_content_is_refused_though_the_seal_fits(written, change, message):
    assert message in refusal(sealed(written, change))


def test_a_disc_of_poses_keeps_its_region(fitted, tmp_path):
    """Poses in one plane have a thin region, which must be read unchanged."""
    found, poses = fitted
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    disc = np.stack([0.4 * np.cos(angle), 0.4 * np.sin(angle), 0 * angle - 0.711], axis=1)
    thin = replace(found, region=type(found.region).of(disc))
    path = tmp_path / "calibration.yaml"
    save_calibration(path, thin, ROBOT, poses)
    read = load_calibration(path, ROBOT)
    probe = np.random.default_rng(2).uniform([-0.5, -0.5, -0.8], [0.5, 0.5, -0.6], (50, 3))
    np.testing.assert_array_equal(read.region.outside(probe), thin.region.outside(probe))


def full_disk(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("fails", ["write", "replace"])
def test_a_failed_write_leaves_the_old_file_and_nothing_else(fitted, written, monkeypatch, fails):
    found, poses = fitted
    before = written.read_bytes()
    if fails == "write":
        whole = YAML.dump

        def half(self, data, stream, **options):
            whole(self, data, stream, **options)
            stream.flush()
            full_disk()

        monkeypatch.setattr(YAML, "dump", half)
    else:
        monkeypatch.setattr(Path, "replace", full_disk)
    with pytest.raises(ConfigError, match=r"yaml: cannot be written: No space left on device"):
        save_calibration(written, replace(found, theta=found.theta + 1.0), ROBOT, poses)
    monkeypatch.undo()
    assert written.read_bytes() == before
    assert os.listdir(written.parent) == [written.name]
    load_calibration(written, ROBOT)


def test_writing_again_replaces_the_whole_file(fitted, written):
    found, poses = fitted
    save_calibration(written, replace(found, seed=9), ROBOT, poses)
    assert content_of(written)["provenance"]["seed"] == 9
    assert os.listdir(written.parent) == [written.name]


# Effects


SHAPES = {
    "backlash": {"width": (1e-4, 2e-4, 3e-4)},
    "thermal_growth_arm": {"sensor": "arm"},
    "transmission_error": {"cycles": 66.5},
    "unexplained": {"family": "position", "width": 0.3, "centres": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)},
}


@pytest.fixture(scope="module")
def extended(fitted):
    """The fit with effects added, each parameter a different number."""
    found, poses = fitted
    mechanism = found.chain.mechanism
    effects = tuple(effect_named(c, ROBOT, mechanism, shape) for c, shape in SHAPES.items())
    chain = found.chain.with_effects(effects)
    more = sum(len(effect.parameters) for effect in effects)
    covariance = np.zeros((len(found.theta) + more,) * 2)
    covariance[: len(found.theta), : len(found.theta)] = found.covariance
    covariance[np.diag_indices_from(covariance)] += 1e-10 * np.arange(len(covariance))
    theta = np.concatenate([found.theta, 1e-5 * np.arange(1, more + 1)])
    more = {"covariance": covariance, "effort": Effort("diagnosis")}
    told = replace(found.uncertainty, covariance=covariance)
    return replace(found, chain=chain, theta=theta, uncertainty=told, **more), poses


@pytest.fixture
def with_effects(extended, tmp_path):
    path = tmp_path / "extended.yaml"
    save_calibration(path, extended[0], ROBOT, extended[1])
    return path


def test_effects_come_back_with_their_shapes_values_and_standard_errors(extended, with_effects):
    found, poses = extended
    read = load_calibration(with_effects, ROBOT)
    np.testing.assert_array_equal(read.theta, found.theta)
    assert [e.cause for e in read.chain.effects] == list(SHAPES)
    for effect in read.chain.effects:
        assert SHAPES[effect.cause].items() <= effect.settings.items()
    assert read.chain.parameters.names == found.parameters.names
    data = content_of(with_effects)
    assert data["provenance"]["method"] == "diagnosis"
    assert len(data["parameters"]) == found.chain.layout.base.stop
    gap = data["effects"][0]["parameters"][1]
    row = found.parameters.row("backlash.gap_2")
    assert gap == {
        "name": "gap_2",
        "unit": "rad",
        "value": found.theta[row],
        "std": pytest.approx(np.sqrt(found.covariance[row, row])),
    }
    made = from_identification(found, ROBOT, poses)
    assert made.seal == read.seal


def test_a_fit_writes_no_effects(written):
    assert "effects" not in content_of(written)
    assert content_of(written)["provenance"]["method"] == "least_squares"
    assert load_calibration(written, ROBOT).live == ()


def test_the_seal_covers_effects(with_effects):
    text = with_effects.read_text(encoding="utf-8")
    changed = text.replace("cycles: 66.5", "cycles: 33.5")
    assert changed != text
    with_effects.write_text(changed, encoding="utf-8")
    assert refusal(with_effects).startswith("sha256: the file was changed")


def of_cause(data, cause):
    return next(entry for entry in data["effects"] if entry["cause"] == cause)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["effects"][0].update(cause="gremlins"), "gremlins: no effect 'gremlins'; "),
        (lambda d: d["effects"][0]["settings"].update(depth=1.0), "unknown setting depth"),
        (
            lambda d: of_cause(d, "transmission_error")["settings"].update(cycles="many"),
            "transmission_error: settings.cycles: 'many' is not allowed; a number is expected",
        ),
        (
            lambda d: of_cause(d, "thermal_growth_arm")["settings"].update(sensor=3.0),
            "settings.sensor: 3.0 is not allowed; a text is expected",
        ),
        (
            lambda d: d["effects"][0]["settings"].update(width=[1e-4, 2e-4]),
            "settings.width: (0.0001, 0.0002) is not allowed; none, or 3 of 0 or more",
        ),
        (
            lambda d: of_cause(d, "unexplained")["settings"].update(width=0.0),
            "unexplained: settings.width: 0.0 is not allowed; more than 0",
        ),
        (
            lambda d: d["effects"][0]["parameters"].pop(),
            "names gap_1, gap_2; it has gap_1, gap_2,",
        ),
        (
            lambda d: d["effects"][0]["parameters"][0].update(name="gap_9"),
            "names gap_9, gap_2, gap_3; it has gap_1",
        ),
        (
            lambda d: d["effects"][0]["parameters"][0].update(unit="m"),
            "units m, rad, rad; it has rad, rad, rad",
        ),
        (
            lambda d: d["effects"][0]["parameters"][0].update(value=float("nan")),
            "effects[0].parameters[0].value: nan is not a finite number",
        ),
        (
            lambda d: d["effects"][0]["parameters"][0].update(std=-1.0),
            "effects[0].parameters[0].std: -1.0 is not allowed; at least 0",
        ),
        (
            lambda d: of_cause(d, "transmission_error")["settings"].update(cycles=float("inf")),
            "effects[2].settings.cycles: inf is not a finite number",
        ),
        (lambda d: d["effects"].append(d["effects"][0]), "effects: parameter names must differ"),
        (lambda d: d["effects"][0].pop("settings"), "effects[0]: missing key settings"),
    ],
)
def test_effects_that_cannot_be_are_refused_though_the_seal_fits(with_effects, change, message):
    assert message in refusal(sealed(with_effects, change))
