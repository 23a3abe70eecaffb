"""An effect is one file: a made-up one is drawn, hidden and described; no other file names it."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

pytest.importorskip("jinja2", reason="needs the extra [report]")

from delta_calibration.cli.machine_demo import _shown
from delta_calibration.cli.second_cell import _shown as shown_live
from delta_calibration.data import at_rest
from delta_calibration.description.look import Look
from delta_calibration.description.looks import LOOKS
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.effects import EFFECTS, called, catalogue, effect_named
from delta_calibration.effects.base import Effect, Stage
from delta_calibration.effects.demo import Demo
from delta_calibration.effects.regressor import (
    ANGLE,
    Regressor,
    all_together,
    by_direction,
    by_payload,
)
from delta_calibration.effects.signals import JOINT
from delta_calibration.errors import InputError
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.model.symbols import sin
from delta_calibration.report.effect_plots import _figure
from delta_calibration.report.judged import Judged
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, hideable_causes
from delta_calibration.wording import spoken
from report_bench import found

PACKAGE = Path(__file__).parents[1] / "delta_calibration"
ROBOT = load_robot("srbd")


@dataclass(frozen=True)
class Draught(Effect):
    """Wind that bends the arms, made up for this test: dq = -a sin(pace q), as the part warms."""

    cause: ClassVar[str] = "draught"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    limits: ClassVar = {"pace": (0.1, 10.0)}
    called: ClassVar[str] = "wind in the hall"
    part: ClassVar[str] = "arm"
    one_of: ClassVar[tuple[str, ...]] = ("pace", "sensor")
    either_sign: ClassVar[bool] = False
    demo: ClassVar[Demo | None] = Demo("line", 5, 2.0)
    live_strength: ClassVar[float] = 0.5

    pace: float = 1.0
    sensor: str = ""
    mood: str = "calm"

    @property
    def parameters(self):
        return self.each_joint("bend", "rad", 1e-3, -0.1, 0.1)

    def regressor(self, at):
        return Regressor("strength of the wind [m/s]", lambda at, j: 3.0 * at.joint[:, j])

    def groups(self, at, joint):
        return (("lee", at.joint[:, joint] < 0), ("luff", at.joint[:, joint] >= 0))

    def usual(self, thermometers):
        return {"pace": 2.0, "sensor": sorted(thermometers)[0]}

    takes: ClassVar[tuple[str, ...]] = (JOINT,)

    @staticmethod
    def law(s, v, c):
        return -v[0] * sin(c[0] * s[0])

    def constants(self, joint):
        return (self.pace,)


@dataclass(frozen=True)
class Plain(Effect):
    """Joints that move too far, with the minimum content of a user's effect."""

    cause: ClassVar[str] = "plain_effect"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE

    @property
    def parameters(self):
        return self.each_joint("far", "1", 1e-3)

    takes: ClassVar[tuple[str, ...]] = (JOINT,)

    @staticmethod
    def law(s, v, c):
        return v[0] * s[0]


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Add both to the catalogue, like effects of installed packages."""
    for kind in (Draught, Plain):
        monkeypatch.setitem(EFFECTS._own, kind.cause, kind)


def hidden(text: dict[str, str], cause: str = "draught") -> Effect:
    """The effect as hidden in a machine."""
    return draw_machine(ROBOT, 3, 1.0, [(cause, text)]).chain.effects[0]


# --- hidden


@pytest.mark.usefixtures("known")
def test_it_is_hidden_in_its_usual_shape() -> None:
    machine = draw_machine(ROBOT, 3, 1.0, [("draught", {})])
    assert "draught" in hideable_causes(ROBOT, machine.chain)
    assert machine.chain.effects[0].settings == {"pace": 2.0, "sensor": "arm", "mood": "calm"}
    assert machine.warms
    assert (machine.theta[machine.chain.layout.effects] > 0).all()


@pytest.mark.usefixtures("known")
def test_settings_are_held_to_what_its_file_says() -> None:
    assert hidden({"pace": "4"}).settings["pace"] == 4.0
    assert hidden({"mood": "stormy"}).settings["mood"] == "stormy"
    for text, said in (
        ({"pace": "0"}, "pace 0 is not allowed; more than 0"),
        ({"pace": "11"}, "pace: 11.0 is not allowed; 0.1 to 10"),
        ({"sensor": "ear"}, "no sensor 'ear'; allowed: arm, base"),
        ({"pace": "1", "sensor": "arm"}, "only one of pace, sensor can be given"),
    ):
        with pytest.raises(InputError, match=re.escape(said)):
            hidden(text)


@pytest.mark.usefixtures("known")
def test_an_effect_that_says_nothing_is_hidden_by_defaults() -> None:
    machine = draw_machine(ROBOT, 3, 1.0, [("plain_effect", {})])
    values = machine.theta[machine.chain.layout.effects]
    assert (values > 0).any()
    assert (values < 0).any()
    assert not machine.warms


@pytest.mark.usefixtures("known")
def test_the_demonstrations_take_what_its_file_offers() -> None:
    assert _shown(ROBOT) == ("draught", Draught.demo)
    assert "draught:strength=0.5" in shown_live(ROBOT)


def test_the_demonstrations_of_the_package_s_effects() -> None:
    """Effects hidden in the machines of this package, and those possible in the live one."""
    own = {name: _shown(load_robot(name))[0] for name in ("srbd", "five_axis", "cdpr8", "scara")}
    assert own == {
        "srbd": "encoder_eccentricity",
        "five_axis": "slider_pitch",
        "cdpr8": "cable_elasticity",
        "scara": "reducer_compliance",
    }
    assert shown_live(ROBOT) == (
        "backlash:strength=1.0",
        "transmission_error:strength=0.8",
        "encoder_eccentricity:strength=1.5",
    )


# --- described and drawn


@pytest.mark.usefixtures("known")
def test_it_is_called_what_its_file_says() -> None:
    assert called()["draught"] == "wind in the hall"
    assert spoken("draught at joint_2") == "wind in the hall at joint 2"
    assert spoken("draught_gauge") == "draught gauge"  # another word
    assert spoken("plain_effect") == "plain effect"
    assert spoken("unexplained (joint angle)") == "smooth map (joint angle)"


def drawn(effect: Effect):
    """Its picture in the report of a session, with the numbers of the model's first effect."""
    judged = Judged.of(found())
    term = judged.diagnosis.model.terms[0]

    class Swapped:
        """The evaluated session with another effect's name on its first term."""

        evidence, rows = judged.evidence, judged.rows
        beside_term = staticmethod(lambda _, rows: judged.beside_term(term, rows))
        moved_by = staticmethod(lambda _, rows: judged.moved_by(term, rows))

    other = Candidate(effect.cause, effect.kind, None, effect, term.rows)
    return _figure(Swapped, ROBOT, other, effect, 1)


def test_it_is_drawn_against_its_own_quantity_in_its_own_groups() -> None:
    figure = drawn(Draught(ROBOT, ROBOT.detailed))
    assert figure.title.endswith("residual against strength of the wind")
    panel = figure.panels[0]
    assert panel.x.title == "strength of the wind [m/s]"
    names = [mark.name for mark in panel.marks]
    assert "lee" in names
    assert "luff" in names


def test_an_effect_that_says_nothing_is_drawn_against_its_joint() -> None:
    figure = drawn(Plain(ROBOT, ROBOT.detailed))
    assert figure.title.endswith("residual against angle of the joint")
    assert [mark.name for mark in figure.panels[0].marks] == ["", "measured", "predicted"]


@pytest.mark.parametrize("name", ["srbd", "linear_delta", "cdpr8", "five_axis", "ur10", "scara"])
def test_every_effect_s_picture_has_values_and_groups_of_all_samples(name: str) -> None:
    robot = load_robot(name)
    mechanism = robot.detailed
    n = 6
    q = mechanism.home + 0.01 * mechanism.joint_size * np.arange(n)[:, None]
    at = replace(
        at_rest(q),
        payload=np.arange(n) % 2.0,
        payload_centre=np.zeros((n, 3)),
        direction=np.where(np.arange(n)[:, None] % 2, 1.0, -1.0) * np.ones_like(q),
    )
    for effect in catalogue(robot, mechanism):
        values = effect.regressor(at).of(at, 1)
        assert values.shape == (n,), effect.cause
        groups = effect.groups(at, 1)
        assert len({title for title, _ in groups}) == len(groups)
        assert sum(rows.sum() for _, rows in groups) == n, effect.cause
        assert effect.moves_with is None


def test_groups() -> None:
    at = replace(
        at_rest(np.zeros((4, 3))),
        payload=np.array([0.0, 2.0, 2.0, np.nan]),
        direction=np.array([[1.0, 1, 1], [1, -1, 1], [0, 0, 0], [1, 1, 1]]),
    )
    assert [(name, rows.tolist()) for name, rows in by_payload(at)] == [
        ("0 kg", [True, False, False, False]),
        ("2 kg", [False, True, True, False]),
    ]
    one = replace(at, payload=np.ones(4))
    assert [name for name, _ in by_payload(one)] == [name for name, _ in all_together(one)]
    up, down = (rows for _, rows in by_direction(at, 1))
    assert up.tolist() == [True, False, False, True]
    assert down.tolist() == [False, True, False, False]
    np.testing.assert_allclose(ANGLE.of(replace(at, joint=np.eye(4, 3)), 0), [57.29578, 0, 0, 0])


def test_a_map_is_labelled_by_what_it_moves_with() -> None:
    plain = Plain(ROBOT, ROBOT.detailed)
    assert Candidate("plain_effect", "drive", None, plain, (0,)).label == "plain_effect"
    speed = effect_named("unexplained", ROBOT, ROBOT.detailed, {"family": "speed", "size": 1e-4})
    assert Candidate("unexplained", "unknown", None, speed, (0,)).label == "unexplained (speed)"


# --- drawings of mechanisms


def test_every_mechanism_has_a_look_under_its_name() -> None:
    assert set(LOOKS) == set(MECHANISMS)
    for name, look in LOOKS.items():
        assert issubclass(look, Look)
        assert look.__module__ == f"delta_calibration.description.{name}"


# --- sources

# Files that may name causes, with the reason; all other names are in the effect's own file.
ALLOWED = {
    "cli/simulate.py": "help text: what can be hidden, by robot",
    "cli/overview.py": "help text: an example",
    "mechanisms/cable_robot.py": "drum_scale is a cause of its geometry as well",
}
CAUSES = tuple(EFFECTS._own)
KINDS = {kind.__name__ for kind in EFFECTS._own.values()} | {"ThermalGrowth", "Unexplained"}


def texts(tree: ast.Module) -> Iterator[str]:
    """All strings of a source except docstrings."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docs = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            yield node.value


def named(source: str) -> set[str]:
    """Causes named in the strings of a source."""
    said = " ".join(texts(ast.parse(source)))
    return {cause for cause in CAUSES if re.search(rf"\b{cause}\b", said)}


def told_apart(source: str) -> set[str]:
    """Effect classes that a source tests with `isinstance`."""
    calls = (
        node
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "isinstance"
    )
    names = (node.id for call in calls for node in ast.walk(call) if isinstance(node, ast.Name))
    return KINDS & set(names)


OUTSIDE = sorted(path for path in PACKAGE.rglob("*.py") if path.parent.name != "effects")


@pytest.mark.parametrize("path", OUTSIDE, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_file_outside_effects_knows_a_cause(path: Path) -> None:
    source = path.read_text(encoding="utf-8")
    assert told_apart(source) == set()
    if path.relative_to(PACKAGE).as_posix() not in ALLOWED:
        assert named(source) == set()


@pytest.mark.parametrize("place", ALLOWED)
def test_what_is_allowed_is_needed(place: str) -> None:
    assert named((PACKAGE / place).read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", sorted((PACKAGE / "effects").glob("*.py")), ids=lambda p: p.stem)
def test_an_effect_s_file_names_no_other(path: Path) -> None:
    assert len(named(path.read_text(encoding="utf-8"))) <= 1


def test_a_name_is_found() -> None:
    assert named('x = {"backlash": 1}') == {"backlash"}
    assert named('x = f"joint_lag:strength={y}"') == {"joint_lag"}
    assert named('"""Like backlash."""\nx = "backlash_width"') == set()
    assert told_apart("isinstance(x, (int, ThermalGrowth))") == {"ThermalGrowth"}


@pytest.mark.parametrize("folder", ["cli", "description"])
def test_no_mechanism_is_known_by_name(folder: str) -> None:
    """A mechanism's name is in its own file only; its drawing takes it from the class."""
    for path in (PACKAGE / folder).glob("*.py"):
        said = set(texts(ast.parse(path.read_text(encoding="utf-8"))))
        assert said.isdisjoint(MECHANISMS), path
