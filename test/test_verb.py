"""What a verb writes is never what it reads."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from delta_calibration.cli.main import group, run
from delta_calibration.cli.replacing import require_same_kind
from delta_calibration.cli.verb import Output, Verb
from delta_calibration.errors import InputError

ROOT = Path(__file__).parents[1]
WRITES = {
    "--json",
    "--out",
    "--report",
    "--law",
    "--mapping-out",
    "--figures",
    "--numbers",
    "--fix",
}
CSV = "x_mm,y_mm,z_mm\n0,0,-750\n"


@pytest.fixture(name="here")
def here_fixture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a session, a robot file, a table and targets."""
    shutil.copytree(ROOT / "bags" / "srbd_plain", tmp_path / "session")
    shutil.copy(ROOT / "config" / "srbd.yaml", tmp_path / "r.yaml")
    shutil.copy(ROOT / "bags" / "srbd_plain.csv", tmp_path / "t.csv")
    (tmp_path / "points.csv").write_text(CSV)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def content(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("fit session --robot r.yaml --out r.yaml", "--out r.yaml: would write over what --robot"),
        ("fit session --robot r.yaml --out ./session/../r.yaml", "what --robot reads"),
        ("fit session --robot srbd --out session/metadata.yaml", "over session, which is read"),
        ("fit session --robot srbd --out session", "over session, which is read"),
        ("import t.csv --robot srbd --guess --mapping-out t.csv", "over t.csv, which is read"),
        (
            "import t.csv --robot srbd --guess --mapping-out g --json g",
            "--json writes to the same",
        ),
        ("compensate points.csv --robot srbd --calibration t.csv --out t.csv", "what --calibrat"),
        (
            "compensate points.csv --robot srbd --calibration t.csv --out points.csv",
            "over points.csv, which is read",
        ),
        ("circle t.csv --robot srbd --json t.csv", "over t.csv, which is read; give another name"),
        ("history report --machine M --store t.csv --out t.csv", "what --store reads"),
        ("history changes --machine M --store t.csv --json t.csv", "what --store reads"),
        ("compare t.csv points.csv --out t.csv", "over t.csv, which is read"),
        ("plan --robot r.yaml --identify --out r.yaml", "what --robot reads"),
        ("simulate --robot srbd --plan points.csv --out points.csv", "what --plan reads"),
    ],
)
def test_a_file_that_is_read_is_not_written(
    here: Path, typed: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = content(here)
    assert run(typed.split()) == 2
    assert said in capsys.readouterr().err
    assert content(here) == before


def test_the_result_of_the_last_run_is_written_anew(here: Path) -> None:
    """Only inputs are kept: an old result in the session's folder is replaced."""
    for _ in range(2):
        assert (
            run(["fit", "session", "--robot", "r.yaml", "--out", "session/calibration.yaml"]) == 0
        )
    assert (here / "session" / "calibration.yaml").is_file()


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("fit session --robot srbd --out r.yaml", "r.yaml: exists and is a robot file, not a cal"),
        ("diagnose session --robot srbd --json r.yaml", "a robot file, not a JSON file"),
        ("diagnose session --robot srbd --json bag.mcap", "is a recording, not a JSON file"),
        ("diagnose session --robot srbd --report t.csv", "a file of another kind, not a page"),
        ("report session --robot srbd --out old.json", "is a JSON file, not a page"),
        ("check session --robot srbd --json t.csv", "a file of another kind, not a JSON file"),
        ("plan --robot srbd --name line --out r.yaml", "is a robot file; name another"),
        ("plan --robot srbd --name line --out bag.mcap", "is a recording; name another"),
        ("robot new --mechanism serial_arm --yes --out r.yaml", "replace it with --force"),
    ],
)
def test_a_file_of_another_kind_is_not_replaced(
    here: Path, typed: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(next((here / "session").glob("*.mcap")), here / "bag.mcap")
    (here / "old.json").write_text('{"schema": 1}')
    before = content(here)
    assert run(typed.split()) == 2
    assert said in capsys.readouterr().err
    assert content(here) == before


def test_what_a_fleet_has_in_common_is_no_calibration(here: Path) -> None:
    (here / "priors.yaml").write_text("schema: 1\nrobot: {name: a}\nmodel: b\nmachines: 3\n")
    require_same_kind("priors", "--out", here / "priors.yaml")
    with pytest.raises(InputError, match="of another kind, not a calibration"):
        require_same_kind("fit", "--out", here / "priors.yaml")


def test_by_force_a_file_of_another_kind_is_replaced(here: Path) -> None:
    assert run(["plan", "--robot", "srbd", "--name", "line", "--out", "r.yaml", "--force"]) == 0
    assert (here / "r.yaml").read_text().startswith("x_mm")
    assert run(["fit", "session", "--robot", "srbd", "--out", "t.csv", "--force"]) == 0
    assert "model: " in (here / "t.csv").read_text()


@pytest.mark.parametrize(
    "typed",
    [
        "plan --robot srbd --name line --out a/b/poses.csv",
        "fit session --robot srbd --out a/b/calibration.yaml",
        "check session --robot srbd --json a/b/check.json",
        "urdf --robot srbd --out a/b/srbd.urdf",
    ],
)
def test_missing_folders_are_made(here: Path, typed: str) -> None:
    assert run(typed.split()) == 0
    assert len(list((here / "a" / "b").iterdir())) == 1


def test_of_a_verb_that_failed_no_folder_is_left(here: Path) -> None:
    assert run(["fit", "nothing", "--robot", "srbd", "--out", "a/b/calibration.yaml"]) == 2
    assert not (here / "a").exists()


def test_several_results_may_fill_one_folder(here: Path) -> None:
    typed = "report session --robot r.yaml --out page.html --numbers made --figures made"
    assert run(typed.split()) == 0
    assert {p.suffix for p in (here / "made").iterdir()} >= {".png", ".csv", ".json"}


def verbs(group: click.Group) -> Iterator[click.Command]:
    ctx = click.Context(group)
    for name in group.list_commands(ctx):
        command = group.get_command(ctx, name)
        assert command is not None
        yield from verbs(command) if isinstance(command, click.Group) else [command]


def test_every_verb_that_writes_knows_its_outputs() -> None:
    """An option that names an output has its type, and its verb compares it with the inputs."""
    for command in verbs(group):
        if command.name == "demo":  # its folder holds nothing that it reads
            continue
        for parameter in command.params:
            written = isinstance(parameter.type, Output)
            assert written or not WRITES & {*parameter.opts}, (command.name, parameter.opts)
            assert isinstance(command, Verb) or not written, command.name
