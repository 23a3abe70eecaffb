"""Tests of help and completion: every verb under its purpose, with a valid example."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from delta_calibration.cli.main import VERBS, group, run
from delta_calibration.cli.options import robots
from delta_calibration.cli.overview import TOLD
from delta_calibration.effects import EFFECTS
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import draw_machine, hideable_causes

ROOT = Path(__file__).parents[1]
EXAMPLES = {verb: told.example for verb, told in TOLD.items()}


def test_help_shows_every_verb_with_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    said = capsys.readouterr().out
    for verb in VERBS:
        assert f"{verb:<12}{TOLD[verb].about}\n" in said
        assert f"$ delta-cal {verb} {EXAMPLES[verb]}" in said
    assert max(map(len, said.splitlines())) < 100


@pytest.mark.parametrize(
    ("call", "told"),
    [
        ("run(['--help'])", "identify the real geometry"),
        ("print([c.value for c in group.shell_complete(click.Context(group), 'fi')])", "['fit']"),
    ],
)
def test_help_and_completion_load_no_verb(call: str, told: str) -> None:
    """Loading everything that the verbs need would take seconds."""
    code = (
        "import click, sys; from delta_calibration.cli.main import group, run;"
        f"{call}; sys.exit('numpy' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert told in done.stdout


@pytest.mark.parametrize("verb", VERBS)
def test_an_example_is_taken(verb: str) -> None:
    """Its options and values are valid; the files it names need not exist."""
    command = group.get_command(click.Context(group), verb)
    assert command is not None
    command.make_context(verb, EXAMPLES[verb].split())


def test_an_example_that_is_wrong_is_found() -> None:
    command = group.get_command(click.Context(group), "fit")
    assert command is not None
    with pytest.raises(click.UsageError, match="--robots"):
        command.make_context("fit", ["session", "--robots", "srbd"])


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_can_read_its_script(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert "_DELTA_CAL_COMPLETE" in script
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} to read its script")
    done = subprocess.run([shell, "-n"], input=script, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def completed(*words: str) -> set[str]:
    """Completions that bash is offered for the last word."""
    variables = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
        "_DELTA_CAL_COMPLETE": "bash_complete",
        "COMP_WORDS": " ".join(words),
        "COMP_CWORD": str(len(words) - 1),
    }
    command = [sys.executable, "-m", "delta_calibration.cli.main"]
    done = subprocess.run(command, env=variables, capture_output=True, text=True, check=False)
    return {line.partition(",")[2] for line in done.stdout.splitlines()}


def test_verbs_options_robots_and_causes_are_completed() -> None:
    assert completed("delta-cal", "di") == {"diagnose"}
    assert "--json" in completed("delta-cal", "diagnose", "--")
    assert {"srbd", "scara"} <= completed("delta-cal", "fit", "--robot", "s")
    causes = completed("delta-cal", "simulate", "--robot", "srbd", "--effect", "joint_")
    assert {"joint_lag", "joint_zero_offset"} <= causes
    cables = completed("delta-cal", "simulate", "--robot", "cdpr8", "--effect", "")
    assert "cable_sag" in cables
    assert "ball_joint_clearance" not in cables


@pytest.mark.parametrize(("begun", "kind"), [("s", "plain"), ("", "plain"), ("./my", "file")])
def test_robots_are_names_or_files_never_both(begun: str, kind: str) -> None:
    """The shell script drops all names if there is a file among them."""
    context = click.Context(click.Command("fit"))
    assert {item.type for item in robots(context, click.Option(["--robot"]), begun)} == {kind}


def test_paragraphs_that_are_laid_out_stay_so() -> None:
    text = CliRunner().invoke(group, ["--help"]).output
    assert "\\b" not in text
    assert "\n    delta-cal fit session --robot srbd --out calibration.yaml\n" in text


def test_the_readme_counts_the_causes_of_the_catalogue() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    counted = re.findall(r"catalogue of (\d+)|(\d+) named causes", text)
    assert [max(each) for each in counted] == [str(len(EFFECTS))] * 2


def test_an_effect_that_a_robot_cannot_have_is_refused_with_those_it_can(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["simulate", "--out", str(tmp_path / "session"), "--robot"]
    assert run([*words, "srbd", "--effect", "pulley_radius"]) == 2
    said = capsys.readouterr().err
    assert "robot srbd has no such part; effects that srbd can have: tracker_scale, " in said
    assert run([*words, "ur10", "--effect", "reducer_compliance"]) == 2
    assert "file of ur10 does not state the masses of the links" in capsys.readouterr().err


def test_simulate_says_the_causes_of_every_robot(capsys: pytest.CaptureFixture[str]) -> None:
    """Listed at the end of its help, in one line or more per robot."""
    assert run(["simulate", "--help"]) == 0
    _, _, below = capsys.readouterr().out.partition("By robot:")
    listed: dict[str, set[str]] = {}
    head = ""
    for line in below.splitlines():
        name, words = line[:26].strip(), line[26:].split()
        head = name or head
        if line.startswith("    "):
            listed.setdefault(head, set()).update(words)
    common = listed.pop("every robot")
    assert set(listed) == set(known_robots())
    for name in known_robots():
        robot = load_robot(name)
        causes = set(hideable_causes(robot, draw_machine(robot, 0).chain))
        assert common | listed[name] == causes
    assert not listed["srbd"] & {"pulley_radius", "flange_compliance", "pretension_loss"}
