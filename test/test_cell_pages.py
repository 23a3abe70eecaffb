"""Tests of commands for a cell, which cannot run here: their syntax, and every name in them.

`ros2` itself is not on PyPI. The tests check that the shell can read each block; that executables
are those that the package installs; and that parameters, remapped topics and services are those of
the real nodes.
"""

from __future__ import annotations

import re
import shlex
import subprocess
from configparser import ConfigParser
from pathlib import Path

import click
import pytest

pytest.importorskip("rclpy")

from delta_calibration.cli.main import group
from launch_stand_in import load
from node_inventory import End, ends, every_node, page_of
from ros_helpers import Bench

pytestmark = pytest.mark.ros

ROOT = Path(__file__).parents[1]
PACKAGE = "delta_calibration"
LAUNCH = ROOT / "launch"
GUIDE = ROOT / "docs" / "tutorials" / "install_in_a_cell.md"
BLOCK = re.compile(r"^```bash\n(.*?)^```$|((?:^    \S[^\n]*\n)+)", re.MULTILINE | re.DOTALL)


def blocks(page: str) -> list[str]:
    """Shell commands of a page: fenced, or indented by four blanks."""
    return [
        fenced or re.sub("^    ", "", plain, flags=re.MULTILINE)
        for fenced, plain in BLOCK.findall(page)
    ]


def commands(page: str) -> list[list[str]]:
    """Each command line of a page, as words."""
    lines = (line for block in blocks(page) for line in block.splitlines() if line.strip())
    return [words for words in (shlex.split(line, comments=True) for line in lines) if words]


class Cell:
    """Names that exist in a cell."""

    def __init__(self, folder: Path) -> None:
        setup = ConfigParser()
        setup.read(ROOT / "setup.cfg")
        scripts = setup["options.entry_points"]["console_scripts"].split("\n")
        self.executables = {line.partition("=")[0].strip() for line in scripts if line}
        bench = Bench()
        nodes = every_node(bench, folder)
        self.ends: set[End] = {end for node in nodes.values() for end in ends(node)}
        self.parameters = {
            name: set(node._parameters) for name, node in nodes.items()
        }  # list_parameters is available through a service only
        nodes["session_recorder"].close()
        bench.take_down()

    def wrong(self, words: list[str]) -> str:
        """The name in a command that does not exist; empty if all exist."""
        match words:
            case ["ros2", "run", package, executable, *rest]:
                if package != PACKAGE or executable not in self.executables:
                    return f"no executable {package} {executable}"
                return self._wrong_arguments(executable, rest)
            case ["ros2", "launch", package, file, *rest]:
                if package != PACKAGE or not (LAUNCH / file).is_file():
                    return f"no launch file {package} {file}"
                known = {argument.name for argument in load(LAUNCH / file).arguments}
                odd = [text for text in rest if text.partition(":=")[0] not in known]
                return f"{file} has no {odd[0]}" if odd and odd != ["--show-args"] else ""
            case ["ros2", "service", "call", name, kind, *_]:
                served = {(e.page, e.type_name) for e in self.ends if e.direction == "serves"}
                return "" if (page_of(name), kind) in served else f"no service {name} of {kind}"
            case ["delta-cal" | ".venv/bin/delta-cal", verb, *rest]:
                return wrong_options(verb, rest)
        return ""

    def _wrong_arguments(self, executable: str, rest: list[str]) -> str:
        if rest == ["--help"]:
            return ""
        if rest and rest[0] != "--ros-args":
            return f"{rest[0]}: --ros-args is missing"
        for flag, text in zip(rest[1::2], rest[2::2], strict=True):
            name = text.partition(":=")[0]
            topics = {e.page for e in self.ends if e.node == executable}
            known = self.parameters[executable] if flag == "-p" else topics
            if (name if flag == "-p" else page_of(name)) not in known:
                return f"{executable} has no {name} ({flag})"
        return ""


def wrong_options(verb: str, rest: list[str]) -> str:
    context = click.Context(group)
    command = group.get_command(context, verb)
    if isinstance(command, click.Group):  # `robot draw`, `history add`
        verb = f"{verb} {rest[0]}"
        command = command.get_command(context, rest[0])
    if command is None:
        return f"no verb {verb}"
    known = {text for parameter in command.params for text in parameter.opts} | {"--help", "-h"}
    odd = [word for word in rest if word.startswith("--") and word not in known]
    return f"{verb} has no {odd[0]}" if odd else ""


@pytest.fixture(name="cell", scope="module")
def cell_fixture(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    return Cell(tmp_path_factory.mktemp("cell"))


@pytest.mark.parametrize("path", [GUIDE, ROOT / "README.md"], ids=lambda path: path.stem)
def test_every_name_in_a_page_is_there(path: Path, cell: Cell) -> None:
    page = path.read_text(encoding="utf-8")
    wrong = {" ".join(words): cell.wrong(words) for words in commands(page)}
    assert {line: why for line, why in wrong.items() if why} == {}
    assert sum(words[0] == "ros2" for words in commands(page)) >= 5


def test_the_shell_can_read_the_guide() -> None:
    for block in blocks(GUIDE.read_text(encoding="utf-8")):
        done = subprocess.run(["bash", "-n"], input=block, capture_output=True, text=True)
        assert done.returncode == 0, f"{block}\n{done.stderr}"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("ros2 launch delta_calibration cell.launch.py space:=left", "has no space:=left"),
        ("ros2 launch delta_calibration robot.launch.py", "no launch file"),
        ("ros2 run delta_calibration no_node", "no executable"),
        ("ros2 run delta_calibration session_recorder -p output:=a", "--ros-args is missing"),
        ("ros2 run delta_calibration session_recorder --ros-args -p file:=a", "no file"),
        ("ros2 run delta_calibration session_recorder --ros-args -r tracker/p:=a", "tracker/p"),
        ("ros2 service call /calibration_node/fit std_srvs/srv/SetBool", "no service"),
        ("delta-cal fit session --robots srbd", "no --robots"),
        ("delta-cal fits session", "no verb"),
    ],
)
def test_a_name_that_is_not_there_is_found(line: str, said: str, cell: Cell) -> None:
    assert said in cell.wrong(line.split())
