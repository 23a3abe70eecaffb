"""`delta-cal robot`: files are checked, drawn, written from answers, and converted from URDF."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from delta_calibration.cli.robot import command
from delta_calibration.drafting import (
    OFFERED,
    commented,
    draft_from_urdf,
    entries,
    model_for,
    reference,
    review,
    robot_from_urdf,
    value_at,
    with_value,
)
from delta_calibration.drafting.review import _by_tolerances
from delta_calibration.effects import effect_named
from delta_calibration.errors import CalibrationError, InputError
from delta_calibration.geometry import align
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.plans import make_plan
from delta_calibration.plans.box import largest_box, written
from delta_calibration.plans.points import joints_toward, tool_points, usable
from delta_calibration.report.sketch import Pose, _driven, _motion
from delta_calibration.robot import known_robots, load_robot, robot_document, robot_from
from other_drives import other_document
from urdf_reader import Urdf

ROOT = Path(__file__).resolve().parents[1]


def run(*arguments: object, typed: str | None = None):
    return CliRunner().invoke(
        command, [str(a) for a in arguments], input=typed, catch_exceptions=True
    )


# --- check


@pytest.mark.parametrize("name", known_robots())
def test_robots_that_come_are_in_no_doubt(name: str) -> None:
    seen = review(load_robot(name), robot_document(name)[1])
    assert seen.doubts == ()
    assert seen.figures[0][0] == "measured in"


SLIPS = [
    ("srbd", ("geometry", "half_width_mm"), 0.04, "geometry.half_width_mm: 0.04 mm"),
    ("srbd", ("tolerances", "arm_mm"), 0.00015, "tolerances.arm_mm: 0.00015 mm"),
    ("srbd", ("tolerances", "rod_mm"), 60.0, "tolerances.rod_mm: 60 mm"),
    ("srbd", ("tracker", "radial_um"), 3000.0, "tracker.radial_um: 3000 um"),
    ("srbd", ("limits", "correction_deg"), 0.01, "corrections up to 0.01 degrees"),
    (
        "srbd",
        ("limits", "condition"),
        3.0,
        "its workspace cannot be used for measuring: only 0 of",
    ),
    ("scara", ("geometry", "home_deg"), [np.pi / 3, np.pi / 6], "geometry.home_deg[0]: 1.0472"),
    ("five_axis", ("geometry", "hinged", "platform_z_mm"), 0.078, "hinged.platform_z_mm: 0.078"),
]


@pytest.mark.parametrize(("name", "path", "value", "said"), SLIPS)
def test_an_entry_in_another_unit_is_named(name, path, value, said) -> None:
    data = with_value(robot_document(name)[1], path, value)
    doubts = review(robot_from(data, "edited.yaml"), data).doubts
    assert [doubt for doubt in doubts if said in doubt], doubts


def test_a_small_delta_without_a_workspace_is_told_to_add_one() -> None:
    """Half the size of the paper's Delta; it reaches nothing of that robot's region."""
    data = robot_document("srbd")[1]
    sizes = {"base_radius_mm": 100.0, "platform_radius_mm": 30.0, "arm_mm": 160.0, "rod_mm": 425.0}
    small = {**data, "geometry": {**data["geometry"], **sizes}}
    (doubt,) = review(robot_from(small, "small.yaml"), small).doubts
    assert "small.yaml has no section `workspace`: add one (centre_mm and size_mm" in doubt
    box = {"centre_mm": [0.0, 0.0, -370.0], "size_mm": [300.0, 300.0, 100.0]}
    boxed = {**small, "workspace": box}
    assert review(robot_from(boxed, "small.yaml"), boxed).doubts == ()


def test_limits_in_radians_and_a_machine_in_metres_are_named() -> None:
    data = robot_document("srbd")[1]
    joints = {
        **data["joints"],
        **{k: np.radians(data["joints"][k]).tolist() for k in ("lower_deg", "upper_deg")},
    }
    turned = {**data, "joints": joints}
    assert "were they written in radians" in review(robot_from(turned, "x"), turned).doubts[0]
    geometry = {key: value / 1e3 for key, value in data["geometry"].items()}
    small = {**data, "geometry": geometry}
    assert "were they written in metres" in review(robot_from(small, "x"), small).doubts[0]


@pytest.mark.parametrize("name", ["srbd", "five_axis", "scara"])
def test_what_tolerances_make_of_a_machine_is_what_drawn_machines_show(name: str) -> None:
    """Compared with machines drawn at random, each in its best-fit frame."""
    robot = load_robot(name)
    model = robot.commanded
    joint = make_plan("identify", robot, count=40, both_sides=False).joint
    x = model.forward(joint, model.parameters.nominal)
    meant = tool_points(robot, joint)
    rng = np.random.default_rng(5)
    squares = []
    for _ in range(300):
        g = model.parameters.nominal + model.parameters.prior * rng.normal(
            size=len(model.parameters)
        )
        pose = model.forward(joint, g)
        tip = model.rotation(pose) @ robot.tool_offset
        got = model.position(pose) + tip
        squares.append(((align(got, meant).apply(got) - meant) ** 2).sum(axis=1).mean())
    drawn = float(np.sqrt(np.mean(squares)))
    assert _by_tolerances(robot, joint, x)[0] == pytest.approx(drawn, rel=0.12)


def test_check_says_it_in_words_and_by_its_exit_code(tmp_path: Path) -> None:
    good = run("check", "srbd")
    assert good.exit_code == 0
    assert "nothing in doubt" in good.output
    file = tmp_path / "own.yaml"
    data = with_value(robot_document("srbd")[1], ("geometry", "half_width_mm"), 0.04)
    file.write_text(commented(data), encoding="utf-8")
    bad = run("check", file)
    assert "in doubt: geometry.half_width_mm" in bad.output


def test_zeros_of_drives_in_radians_are_doubted(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    for zero, doubted in ([1.5708, 0.0, 0.0], True), ([90.0, 0.0, 0.0], False):
        data = robot_document("srbd")[1]
        low, high = data["joints"]["lower_deg"], data["joints"]["upper_deg"]
        for path, value in {
            ("joints", "zero_deg"): zero,
            ("joints", "lower_deg"): (np.array(low) + zero).tolist(),
            ("joints", "upper_deg"): (np.array(high) + zero).tolist(),
            ("geometry", "azimuths_deg"): [0.0, 2.0944 if doubted else 120.0, 240.0],
        }.items():
            data = with_value(data, path, value)
        file.write_text(commented(data), encoding="utf-8")
        said = run("check", file).output
        assert ("joints.zero_deg" in said) == doubted
        assert ("azimuths_deg" in said and "(120 degrees)" in said) == doubted


# --- draw


def test_an_arrow_points_the_way_a_joint_moves() -> None:
    """The arm of a Delta goes down; carriages of the linear Delta move as the platform does."""
    delta = Pose.home(load_robot("srbd"))
    for number, joint in enumerate(_driven(load_robot("srbd"), delta)):
        way = _motion(delta, joint)
        azimuth = np.radians(120 * number)
        elbow = 0.52 * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        np.testing.assert_allclose(way[0], elbow, atol=1e-9)
        assert way[-1][2] < way[0][2] - 0.05
    linear = load_robot("linear_delta")
    model, g = linear.commanded, linear.commanded.parameters.nominal
    low, high = (model.forward((model.home + step)[None], g)[0, 2] for step in (-0.01, 0.01))
    pose = Pose.home(linear)
    for joint in _driven(linear, pose):
        way = _motion(pose, joint)
        assert np.sign(way[-1][2] - way[0][2]) == np.sign(high - low)


def test_a_drawing_shows_how_drives_read(tmp_path: Path) -> None:
    """If a motor counts the other way, its arrow points up; its zero is where it reads 0."""
    robot = robot_from(other_document("srbd"), "srbd")
    plain, pose = Pose.home(load_robot("srbd")), Pose.home(robot)
    for known, joint, sign in zip(
        _driven(load_robot("srbd"), plain), _driven(robot, pose), robot.drives.sense, strict=True
    ):
        moved = _motion(plain, known)[-1][2] - _motion(plain, known)[0][2]
        way = _motion(pose, joint)
        assert np.sign(way[-1][2] - way[0][2]) == sign * np.sign(moved)
    file, out = tmp_path / "robot.yaml", tmp_path / "robot.svg"
    data = with_value(other_document("srbd"), ("joints", "passed_through"), ["joint_4"])
    file.write_text(commented(data), encoding="utf-8")
    assert run("draw", file, "--out", out).exit_code == 0
    text = out.read_text(encoding="utf-8")
    assert "joint_1 90 (" in text
    assert "[sign -1, zero 90]" in text
    assert "passed through: joint_4" in text


@pytest.mark.parametrize("name", known_robots())
def test_every_robot_is_drawn(name: str, tmp_path: Path) -> None:
    out = tmp_path / "robot.svg"
    assert run("draw", name, "--out", out).exit_code == 0
    text = out.read_text(encoding="utf-8")
    for joint in load_robot(name).joints.names:
        assert f"+{joint}" in text or name == "cdpr8"
    again = tmp_path / "again.svg"
    run("draw", name, "--out", again)
    assert "<dc:date>" not in text


def test_each_dimension_has_a_picture(tmp_path: Path) -> None:
    done = run("draw", "srbd", "--out", tmp_path / "r.svg", "--dimensions", tmp_path / "each")
    assert done.exit_code == 0
    names = {path.stem for path in (tmp_path / "each").glob("*.svg")}
    assert names == {
        "base_radius_mm",
        "platform_radius_mm",
        "arm_mm",
        "rod_mm",
        "half_width_mm",
    }
    assert "upper arm" in (tmp_path / "each" / "arm_mm.svg").read_text(encoding="utf-8")


# --- new


@pytest.mark.parametrize("name", known_robots())
def test_a_file_written_with_comments_is_the_same_robot(name: str, tmp_path: Path) -> None:
    data = robot_document(name)[1]
    file = tmp_path / "robot.yaml"
    file.write_text(commented(data), encoding="utf-8")
    assert load_robot(file).hash == load_robot(name).hash


def test_answers_are_what_the_file_says(tmp_path: Path) -> None:
    out = tmp_path / "mine.yaml"
    # name, base radius; zero length of the arm is refused and asked again; then the proposals
    typed = "mine\n210\n\n0\n330\n" + "\n" * 40
    done = run("new", "--like", "srbd", "--out", out, typed=typed)
    assert done.exit_code == 0, done.output
    assert "geometry.arm_mm: 0 is not allowed; a number, above 0 and at most 10000" in done.output
    robot = load_robot(out)
    assert (robot.name, robot.dimensions.base_radius, robot.dimensions.arm) == ("mine", 0.21, 0.33)
    assert robot.dimensions.rod == load_robot("srbd").dimensions.rod
    assert "# L: length of the upper arm, motor axis to elbow" in out.read_text(encoding="utf-8")
    assert isinstance(run("new", "--like", "srbd", "--out", out).exception, InputError)


@pytest.mark.parametrize(
    ("arguments", "typed", "said"),
    [
        (
            (),
            "\n" * 50,
            r"mechanism \(rotary_delta, .*5 answers were refused; the last one was ''",
        ),
        ((), "", "the input ended before all questions were answered"),
        (("--mechanism", "rotary_delta"), "", "the input ended before all questions"),
        (("--mechanism", "rotary_delta"), "r\n" + "-\n" * 50, "5 answers were refused"),
    ],
)
def test_questions_that_nobody_answers_end(
    tmp_path: Path, arguments: tuple[str, ...], typed: str, said: str
) -> None:
    """Without usable answers from a pipe the command ends with an error, not in a loop."""
    done = run("new", *arguments, "--out", tmp_path / "mine.yaml", typed=typed)
    assert isinstance(done.exception, InputError)
    assert done.exception.exit_code == 2
    assert re.search(said, str(done.exception))


def test_kinds_of_robots_are_told_apart_before_one_is_asked_for(tmp_path: Path) -> None:
    done = run("new", "--out", tmp_path / "mine.yaml", typed="six_rod_delta\n")
    for name in MECHANISMS:
        assert f"\n{name}: " in f"\n{done.output}"
    assert "six rods, each of its own length" in done.output


def test_how_drives_read_is_asked_for(tmp_path: Path) -> None:
    """Enter leaves an entry out; other answers are checked at once."""
    out = tmp_path / "mine.yaml"
    own = {
        "geometry.azimuths_deg": ["0, 120", "10, 250, 130"],
        "joints.sign": ["1, 0.5, 1", "1, -1, 1"],
        "joints.zero_deg": ["0, 5, 0"],
        "joints.passed_through": ["turn"],
        "joints.lower_deg": ["-35, -90", "-35, -90, -35"],
        "joints.upper_deg": ["100, 40, 100"],
    }
    typed = "mine\n"
    for entry in entries("rotary_delta"):
        given = value_at(robot_document("srbd")[1], entry.path) is not None
        if given or entry.required or entry.path in OFFERED:
            typed += "".join(f"{text}\n" for text in own.get(entry.name, [""]))
    done = run("new", "--like", "srbd", "--out", out, typed=typed)
    assert done.exit_code == 0, done.output
    assert "joints.sign: 1, 0.5, 1 is not allowed; a list of values, each 1 or -1" in done.output
    assert "geometry.azimuths_deg: 0, 120 is not allowed; 3 numbers, each at least" in done.output
    assert "joints.lower_deg: 2 values; give one for each of joint_1, joint_2" in done.output
    robot = load_robot(out)
    np.testing.assert_array_equal(robot.joints.sign, [1, -1, 1])
    np.testing.assert_allclose(robot.joints.zero, np.radians([0, 5, 0]))
    np.testing.assert_allclose(robot.dimensions.azimuths, np.radians([10, 250, 130]))
    assert robot.joints.passed_through == ("turn",)


def test_links_of_an_arm_are_asked_for_one_by_one(tmp_path: Path) -> None:
    """Three links with answers for all entries; the proposed joints follow from them."""
    out = tmp_path / "mine.yaml"
    first, second = ["0", "0", "300", "90", "", ""], ["90", "20", "", "", "true", "3"]
    third = ["0", "400", "0", "", "yes", "true", ""]  # `yes` is not a boolean
    typed = ["mine", "3", *first, *second, *third, *[""] * 40]
    done = run("new", "--like", "scara", "--out", out, typed="\n".join(typed) + "\n")
    assert "links[2].parallel: yes is not allowed; true or false" in done.output
    arm = load_robot(out).dimensions
    assert [round(1e3 * link.length) for link in arm.links] == [0, 20, 400]
    assert [link.parallel for link in arm.links] == [False, True, True]
    np.testing.assert_allclose([link.zero for link in arm.links], np.radians([90, 0, 0]))
    assert arm.links[1].mass == 3.0
    assert load_robot(out).joints.names == ("joint_1", "joint_2", "joint_3")
    refused = run("new", "--like", "scara", "--out", tmp_path / "x.yaml", typed="x\n0\n" * 6)
    assert "'0' is not allowed; a whole number above 0" in refused.output


def test_one_limit_stands_for_all_joints_and_an_interrupted_file_is_kept(tmp_path: Path) -> None:
    """The input ends after the first limit; the earlier answers are in the file."""
    out = tmp_path / "mine.yaml"
    names = [e.name for e in entries("rotary_delta")]
    asked = names[: names.index("joints.lower_deg")]
    typed = "mine\n210\n" + "\n" * (len(asked) - 1) + "-20\n"
    done = run("new", "--like", "srbd", "--out", out, typed=typed)
    assert f"the answers so far are in {out}" in done.output
    robot = load_robot(out)
    assert robot.dimensions.base_radius == 0.21
    np.testing.assert_allclose(robot.joints.lower, np.radians([-20, -20, -20]))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ("new", "--like", "srbd", "--yes", "--name", "Ä", "--out", "r.yaml"),
            "name: 'Ä' is not allowed; a lower-case letter",
        ),
        (("new", "--like", "srbd", "--yes", "--out", "/proc/r.yaml"), "/proc/r.yaml: cannot be"),
        (("reference", "--out", "/proc/r.md"), "/proc/r.md: cannot be"),
        (
            ("draw", "srbd", "--out", "r.gif"),
            "r.gif: the ending selects the format: .svg, .png, .pdf",
        ),
        (
            ("draw", "srbd", "--out", "r.svg", "--dimensions", "/proc/d"),
            "/proc/d: cannot be created",
        ),
    ],
)
def test_what_cannot_be_written_is_refused_in_words(
    arguments, said, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused = run(*arguments).exception
    assert isinstance(refused, CalibrationError)
    assert said in str(refused)
    assert not (tmp_path / "r.yaml").exists()


def test_a_file_without_questions_is_the_robot_it_is_like(tmp_path: Path) -> None:
    out = tmp_path / "r.yaml"
    made = run("new", "--mechanism", "rotary_delta", "--name", "r", "--out", out, "--yes")
    assert made.exit_code == 0, made.output
    assert load_robot(out).mechanism == "rotary_delta"
    assert model_for("rotary_delta")["geometry"] == robot_document("srbd")[1]["geometry"]


def test_the_reference_page_is_current() -> None:
    assert (ROOT / "docs" / "robot_file.md").read_text(encoding="utf-8") == reference()


def _keys(section: object, path: str = "") -> Iterator[str]:
    """Paths of all entries in a file; `[]` stands for a list of sections."""
    if isinstance(section, dict):
        for key, value in section.items():
            yield from _keys(value, f"{path}.{key}" if path else key)
    elif isinstance(section, list) and section and isinstance(section[0], dict):
        for value in section:
            yield from _keys(value, f"{path}[]")
    else:
        yield path


@pytest.mark.parametrize("name", known_robots())
def test_the_reference_page_has_every_entry_of_a_file(name: str) -> None:
    """Including entries in lists of sections, such as the links of an arm."""
    page = reference()
    own = set(_keys(robot_document(name)[1])) - {"schema", "name", "mechanism"}
    assert {key for key in own if f"| `{key}` |" not in page} == set()


# --- from a URDF

JOINT = """
  <joint name="{name}" type="{kind}">
    <parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>
    <limit lower="-2.5" upper="2.0" velocity="1.5" effort="1"/>
  </joint>"""


INERTIAL = '<inertial><origin xyz="{centre}"/><mass value="{kg}"/></inertial>'
Masses = dict[str, tuple[float, str]]  # [kg] and centre of mass, by link


def urdf(path: Path, joints: list[dict[str, str]], masses: Masses | None = None) -> Path:
    links = [joints[0]["parent"], *(joint["child"] for joint in joints)]
    mass = {
        link: dict(zip(("kg", "centre"), m, strict=True)) for link, m in (masses or {}).items()
    }
    text = "".join(
        f'<link name="{link}">{INERTIAL.format(**mass[link]) if link in mass else ""}</link>'
        for link in links
    )
    text += "".join(JOINT.format(**joint) for joint in joints)
    path.write_text(f'<robot name="Arm 7">{text}\n</robot>\n', encoding="utf-8")
    return path


def crooked(count: int = 6) -> list[dict[str, str]]:
    """An arm with arbitrary frames and axes; only its first joint is vertical."""
    rng = np.random.default_rng(11)
    rows = []
    for k in range(count):
        first = k == 0
        axis = rng.uniform(-1, 1, 3)
        rows.append(
            {
                "name": f"axis_{k + 1}",
                "kind": "revolute",
                "parent": "base" if first else f"l{k}",
                "child": f"l{k + 1}",
                "xyz": "0 0 0.1" if first else " ".join(map(str, rng.uniform(-0.3, 0.3, 3))),
                "rpy": "0 0 0.4" if first else " ".join(map(str, rng.uniform(-2, 2, 3))),
                "axis": "0 0 -1" if first else " ".join(map(str, axis / np.linalg.norm(axis))),
            }
        )
    flange = {"name": "flange", "kind": "fixed", "parent": f"l{count}", "child": "tool"}
    return [*rows, {**flange, "xyz": "0.01 0.02 0.2", "rpy": "0.3 0.2 0.1", "axis": "1 0 0"}]


def test_an_arm_of_a_urdf_is_the_same_arm(tmp_path: Path) -> None:
    """Compared with the independent URDF reader of the tests."""
    file = urdf(tmp_path / "arm.urdf", crooked())
    data = robot_from_urdf(file)
    robot = robot_from(data, "arm.yaml")
    assert robot.name == "arm_7"
    assert robot.joints.names == tuple(f"axis_{k}" for k in range(1, 7))
    np.testing.assert_allclose(robot.joints.lower, -2.5)
    tree, model = Urdf(file.read_text(encoding="utf-8")), robot.commanded
    for q in np.random.default_rng(2).uniform(-2.0, 2.0, (5, 6)):
        at = tree.place("tool", dict(zip(robot.joints.names, q, strict=True)))
        x = model.forward(q[None], model.parameters.nominal)
        np.testing.assert_allclose(model.position(x)[0], at[:3, 3], atol=1e-8)
        turn = Rotation.from_matrix(model.rotation(x)[0].T @ at[:3, :3])
        assert turn.magnitude() < 1e-7


def test_a_planar_arm_of_three_joints_is_drafted_and_calibrated(tmp_path: Path) -> None:
    """Three vertical axes, 0.4 m, 0.3 m and 0.2 m: it is simulated, fitted and compensated."""
    from delta_calibration.cli.main import run as cli

    rows = [
        {
            "name": f"axis_{k + 1}",
            "kind": "revolute",
            "parent": f"l{k}",
            "child": f"l{k + 1}",
            "xyz": xyz,
            "rpy": "0 0 0",
            "axis": "0 0 1",
        }
        for k, xyz in enumerate(("0 0 0", "0.4 0 0", "0.3 0 0"))
    ]
    tool = {**rows[-1], "name": "flange", "kind": "fixed", "parent": "l3", "child": "tool"}
    file = urdf(tmp_path / "arm.urdf", [*rows, {**tool, "xyz": "0.2 0 0"}])
    robot, session, out = (str(tmp_path / name) for name in ("arm.yaml", "session", "c.yaml"))
    done = run("from-urdf", file, "--out", robot)
    assert done.exit_code == 0, done.output
    assert load_robot(robot).commanded.task_size == 2
    how = ["--effect", "backlash", "--plan", "identify", "--seed", "3", "--out", session]
    assert cli(["simulate", "--robot", robot, *how]) == 0
    assert cli(["fit", session, "--robot", robot, "--out", out]) == 0
    targets, commands = tmp_path / "targets.csv", tmp_path / "commands.csv"
    middle = load_robot(robot).workspace.centre * 1e3
    targets.write_text("x_mm,y_mm,z_mm\n" + ",".join(map(str, middle)), encoding="utf-8")
    asked = ["--robot", robot, "--calibration", out, str(targets), "--out", str(commands)]
    assert cli(["compensate", *asked]) == 0


def upright_arm() -> list[dict[str, str]]:
    """An arm that stands up straight: one vertical axis and two horizontal ones."""
    rows = [("0 0 0.2", "0 0 1"), ("0 0 0.2", "0 1 0"), ("0 0 0.4", "0 1 0")]
    joints = [
        {"name": f"axis_{k}", "kind": "revolute", "parent": f"l{k - 1}", "child": f"l{k}"}
        | {"xyz": xyz, "rpy": "0 0 0", "axis": axis}
        for k, (xyz, axis) in enumerate(rows, 1)
    ]
    tool = {"name": "flange", "kind": "fixed", "parent": "l3", "child": "tool"}
    return [*joints, {**tool, "xyz": "0 0 0.3", "rpy": "0 0 0", "axis": "1 0 0"}]


EVEN: Masses = {
    "l1": (5.0, "0 0 0.15"),  # its height loads no joint
    "l2": (3.0, "0 0 0.2"),
    "l3": (1.0, "0 0 0.1"),
    "tool": (0.5, "0 0 -0.05"),  # both together in the middle of the last link
}


def test_masses_in_the_middle_of_their_links_come_from_the_urdf(tmp_path: Path) -> None:
    """Those of links that hold on to each other are added, as are their moments."""
    file, out = urdf(tmp_path / "arm.urdf", upright_arm(), EVEN), tmp_path / "arm.yaml"
    done = run("from-urdf", file, "--out", out)
    assert "note" not in done.output
    links = load_robot(out).dimensions.links
    assert [link.mass for link in links] == [5.0, 3.0, 1.5]
    nearly = {**EVEN, "l2": (3.0, "0.02 0 0.2")}  # 0.06 of 2.45 kg m
    draft = draft_from_urdf(urdf(tmp_path / "nearly.urdf", upright_arm(), nearly))
    assert not draft.notes
    assert [link["mass_kg"] for link in draft.document["geometry"]["links"]] == [5.0, 3.0, 1.5]


def test_masses_elsewhere_are_left_out_with_a_note(tmp_path: Path) -> None:
    """Evenly spread, they would give wrong compliances; without them moments are fitted."""
    masses = {**EVEN, "l2": (3.0, "0 0.01 0.06"), "l3": (1.0, "0 0 0.13")}
    file, out = urdf(tmp_path / "arm.urdf", upright_arm(), masses), tmp_path / "arm.yaml"
    done = run("from-urdf", file, "--out", out)
    assert done.exit_code == 0, done.output
    told = "differ from that (l2 by 140 mm, l3 by 20 mm)"
    assert told in done.output
    assert "gravity_sag" in done.output
    head, _, _ = out.read_text(encoding="utf-8").partition("schema:")
    assert told in " ".join(line.removeprefix("# ") for line in head.splitlines())
    robot = load_robot(out)
    assert not any(link.mass for link in robot.dimensions.links)
    assert "mass_kg" not in out.read_text(encoding="utf-8")
    assert effect_named("gravity_sag", robot, robot.model(), {}).suits


def test_links_that_hold_each_other_in_a_circle_end_the_search_for_masses(tmp_path: Path) -> None:
    file = urdf(tmp_path / "arm.urdf", upright_arm(), EVEN)
    loop = "".join(
        JOINT.format(
            name=a, kind="fixed", parent=a, child=b, xyz="0 0 0", rpy="0 0 0", axis="1 0 0"
        )
        for a, b in ("xy", "yx")
    )
    text = file.read_text(encoding="utf-8").replace("</robot>", f'{loop}<link name="x"/>')
    file.write_text(f'{text}<link name="y"/></robot>', encoding="utf-8")
    links = robot_from_urdf(file)["geometry"]["links"]
    assert [link["mass_kg"] for link in links] == [5.0, 3.0, 1.5]


@pytest.mark.parametrize("name", ["ur10", "scara"])
def test_there_and_back(name: str, tmp_path: Path) -> None:
    from delta_calibration.description import describe
    from delta_calibration.description import urdf as written

    file, out = tmp_path / "arm.urdf", tmp_path / "arm.yaml"
    file.write_text(written(describe(load_robot(name)).tree), encoding="utf-8")
    done = run("from-urdf", file, "--out", out)
    assert done.exit_code == 0, done.output
    old, new = load_robot(name).commanded, load_robot(out).commanded
    q = np.random.default_rng(3).uniform(-2, 2, (4, old.joints))
    places = [m.position(m.forward(q, m.parameters.nominal)) for m in (old, new)]
    np.testing.assert_allclose(*places, atol=1e-8)
    parallel = [link.parallel for link in load_robot(out).dimensions.links]
    assert parallel == [link.parallel for link in load_robot(name).dimensions.links]


def with_fingers() -> list[dict[str, str]]:
    """The arm with a gripper of two sliding fingers."""
    finger = {"kind": "prismatic", "parent": "tool", "xyz": "0 0 0.1", "rpy": "0 0 0"}
    sides = [("left", "0 1 0"), ("right", "0 -1 0")]
    return [*crooked(), *({**finger, "name": s, "child": s, "axis": a} for s, a in sides)]


def test_a_hand_with_sliding_fingers_is_no_part_of_the_arm(tmp_path: Path) -> None:
    file = urdf(tmp_path / "arm.urdf", with_fingers())
    with pytest.raises(InputError, match="give --tip: left, right \\(or a link before them"):
        robot_from_urdf(file)
    plain = robot_from_urdf(urdf(tmp_path / "plain.urdf", crooked()))
    assert robot_from_urdf(file, tip="tool")["geometry"] == plain["geometry"]
    with pytest.raises(InputError, match="joint 'left': type 'prismatic'"):
        robot_from_urdf(file, tip="left")


def test_a_delta_drawn_as_a_tree_is_no_arm(tmp_path: Path) -> None:
    from delta_calibration.description import describe
    from delta_calibration.description import urdf as written

    file = tmp_path / "delta.urdf"
    file.write_text(written(describe(load_robot("srbd")).tree), encoding="utf-8")
    with pytest.raises(
        InputError, match=r"6 arms are attached to link 'base_link'.*closed chains"
    ):
        robot_from_urdf(file)


def changed(row: int, **values: str) -> list[dict[str, str]]:
    joints = crooked()
    joints[row] = {**joints[row], **values}
    return joints


def on_a_pedestal() -> list[dict[str, str]]:
    """The arm stands away from the origin of the world, and is rotated."""
    foot = {"name": "foot", "kind": "fixed", "parent": "world", "child": "base"}
    return [{**foot, "xyz": "0.5 -0.3 0.8", "rpy": "0 0 0.3", "axis": "1 0 0"}, *crooked()]


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        (changed(2, kind="prismatic"), "joint 'axis_3': type 'prismatic'; an arm of turning"),
        (changed(0, axis="1 0 0"), "the first axis has to intersect the base's x axis"),
        (changed(0, xyz="0 0.1 0"), "the first axis has to intersect the base's x axis"),
        (changed(1, xyz="0 zero 0"), "joint 'axis_2': xyz='0 zero 0'; 3 numbers are needed"),
        (changed(1, axis="0 0 0"), "joint 'axis_2': axis has no length"),
        (changed(5, parent="l4"), "several ends of the arm; give --tip: l5, tool"),
        (on_a_pedestal(), "the base's x axis at a right angle; give --base base\n"),
        (changed(0, xyz="0 0.1 0"), "at a right angle; add a suitable base link"),
        (changed(1, xyz="0 ${height} 0"), "is xacro; convert it first"),
    ],
)
def test_a_urdf_that_is_no_such_arm_is_refused(joints, said, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        robot_from_urdf(urdf(tmp_path / "arm.urdf", joints))
    assert said in f"{refused.value}\n"


def test_an_arm_on_a_pedestal_is_read_from_its_own_base(tmp_path: Path) -> None:
    file = urdf(tmp_path / "arm.urdf", on_a_pedestal())
    plain = robot_from_urdf(urdf(tmp_path / "plain.urdf", crooked()))
    assert robot_from_urdf(file, base="base")["geometry"] == plain["geometry"]


def test_a_joint_between_links_that_are_not_there_is_refused(tmp_path: Path) -> None:
    """Otherwise a mistyped name would end the chain, and give an arm of two joints."""
    file = urdf(tmp_path / "arm.urdf", crooked())
    text = file.read_text(encoding="utf-8").replace('child link="l2"', 'child link="l22"')
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="joint 'axis_2': there is no link 'l22'; there are"):
        robot_from_urdf(file)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot>", "not XML"),
        ("<model/>", "its root is <model>"),
        ('<!DOCTYPE r [<!ENTITY a "b">]><robot/>', "document type or entities"),
        ("<robot/>", "no revolute joint"),
    ],
)
def test_a_file_that_is_no_urdf_is_refused(text, said, tmp_path: Path) -> None:
    (tmp_path / "x.urdf").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said):
        robot_from_urdf(tmp_path / "x.urdf")


def test_a_workspace_is_asked_for_and_its_size_once_there_is_a_centre(tmp_path: Path) -> None:
    """Without a workspace no plan is possible for a Delta of another size than `srbd`."""
    out = tmp_path / "mine.yaml"
    typed = "mine\n"
    for entry in entries("six_rod_delta"):
        given = value_at(robot_document("srbd")[1], entry.path)
        if entry.path == ("workspace", "centre_mm"):
            typed += "0, 0, -700\n\n400, 400, 100\n"  # the size is required: Enter is refused
        elif given is not None or entry.path in OFFERED:
            typed += "\n"
    done = run("new", "--like", "srbd", "--out", out, typed=typed)
    assert done.exit_code == 0, done.output
    assert "workspace.centre_mm [mm] [none]" in done.output
    box = robot_document(str(out))[1]["workspace"]
    assert box == {"centre_mm": [0, 0, -700], "size_mm": [400, 400, 100]}


def small_delta() -> str:
    """Answers for a small Delta, a quarter of the size of the proposed values."""
    own = {"base_radius_mm": "50", "platform_radius_mm": "14", "arm_mm": "0.08\n80"}
    own |= {"rod_mm": "212", "half_width_mm": "10"}
    typed = "desk\n"
    for entry in entries("six_rod_delta"):
        given = value_at(robot_document("srbd")[1], entry.path)
        if given is not None or entry.path in OFFERED or entry.path[0] == "workspace":
            typed += own.get(entry.path[-1], "") + "\n"
    return typed


def test_a_workspace_is_proposed_for_a_machine_of_another_size(tmp_path: Path) -> None:
    """An answer that seems to be in another unit is asked for again."""
    out = tmp_path / "desk.yaml"
    done = run("new", "--like", "srbd", "--out", out, typed=small_delta())
    assert done.exit_code == 0, done.output
    assert "geometry.arm_mm: 0.08 is far from the proposed 320.0: is it in mm?" in done.output
    robot = load_robot(out)
    assert robot.dimensions.arm == pytest.approx(0.08)
    assert robot.workspace is not None
    assert np.all(robot.workspace.size > 0.03)
    assert len(make_plan("identify", robot)) > 0


def test_an_answer_that_is_given_twice_is_meant(tmp_path: Path) -> None:
    out = tmp_path / "mine.yaml"
    typed = "mine\n200\n55\n2\n2\n" + "\n" * 40
    done = run("new", "--like", "srbd", "--out", out, typed=typed)
    assert done.output.count("is it in mm?") == 1
    assert value_at(robot_document(str(out))[1], ("geometry", "arm_mm")) == 2


@pytest.mark.parametrize("name", ["srbd", "linear_delta", "scara", "five_axis", "cdpr8"])
def test_a_machine_can_be_measured_all_over_its_largest_box(name: str) -> None:
    """At random places in it; a box that is a third larger cannot be reached completely."""
    robot = load_robot(name)
    box, rng = largest_box(robot), np.random.default_rng(3)
    place = box.centre + rng.uniform(-0.5, 0.5, (300, 3)) * box.size
    joint = joints_toward(robot, place)
    inside = (joint > robot.joints.lower) & (joint < robot.joints.upper)
    assert inside.all(axis=1).mean() > 0.98
    corner = np.array(list(product((-0.5, 0.5), repeat=3))) * box.size
    assert not usable(robot, box.centre + 1.3 * corner).all()


def test_a_box_is_no_larger_than_a_robot_file_may_say() -> None:
    """A SCARA with arms of six metres reaches twelve metres."""
    data = robot_document("scara")[1]
    geometry = data["geometry"]
    geometry["links"] = [{**a, "length_mm": 12 * a["length_mm"]} for a in geometry["links"]]
    geometry["tool_mm"] = [6000.0, 0.0, 0.0]
    box = written(largest_box(robot_from(data, "large")))
    robot_from({**data, "workspace": box}, "large")
    assert max(box["size_mm"]) > 8000


def test_numbers_that_are_none_are_refused_at_once() -> None:
    """Including an integer beyond all floats, for which the schema has no upper bound."""
    for entry in entries("six_rod_delta"):
        for typed in (".nan", ".inf", "1" + "0" * 400):
            with pytest.raises(InputError):
                entry.read(typed)


def test_answers_are_kept_where_the_search_of_a_workspace_is_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("delta_calibration.cli.robot.largest_box", interrupted)
    out = tmp_path / "desk.yaml"
    run("new", "--like", "srbd", "--out", out, typed=small_delta())
    assert value_at(robot_document(str(out))[1], ("geometry", "arm_mm")) == 80


@pytest.mark.parametrize("size", [[0.0, 0.0, 0.0], [0.6, 0.6, 0.2]])
def test_a_workspace_that_is_a_point_is_in_doubt(tmp_path: Path, size: list[float]) -> None:
    file = tmp_path / "point.yaml"
    box = {"centre_mm": [0.0, 0.0, -711.0], "size_mm": size}
    file.write_text(commented({**robot_document("srbd")[1], "workspace": box}), encoding="utf-8")
    done = run("check", file)
    assert f"workspace.size_mm: {max(size):g} mm at its widest" in done.output
    assert "`workspace: {'centre_mm': [" in done.output


def test_a_check_proposes_the_workspace_that_is_wanting(tmp_path: Path) -> None:
    data = robot_document("srbd")[1]
    half = {key: value / 4 for key, value in data["geometry"].items()}
    file = tmp_path / "desk.yaml"
    file.write_text(commented({**data, "geometry": half}), encoding="utf-8")
    done = run("check", file)
    assert "its workspace cannot be used for measuring" in done.output
    assert re.search(
        r"`workspace: \{'centre_mm': \[.*\], 'size_mm': \[.*\]\}` can be", done.output
    )
