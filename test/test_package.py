"""The package installs in two ways: pip (wheel, sdist, editable) and colcon (ament_python).

`ros2cli` is not on PyPI, so `ros2 run` itself cannot be called here. `executables_of` finds
executables as it does: it takes the prefix on AMENT_PREFIX_PATH whose resource index names the
package, and the executable files below its lib/<package>.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import zipfile
from configparser import ConfigParser
from importlib.resources import files
from pathlib import Path

import pytest
from catkin_pkg.package import parse_package

import delta_calibration

ROOT = Path(__file__).parents[1]
PACKAGE = "delta_calibration"
NODES = {
    "calibration_node",
    "simulated_tracker",
    "measurement_plan",
    "grid_positioner",
    "robot_description",
    "session_recorder",
    "session_player",
}
CONFIG = ROOT / "config" / "srbd.yaml"
# Python packages without a rosdep key, installed by pip
WITHOUT_ROSDEP_KEY = {
    "charset-normalizer",
    "lz4",
    "mcap",
    "numba",
    "openpyxl",
    "rosbags",
    "threadpoolctl",
    "zstandard",
}


def run(*command: str | Path, cwd: Path, **environment: str) -> str:
    """Output of a command that has to succeed; if it fails, all its output is shown."""
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A copy of the repository without ignored files, so nothing is built in the repository."""
    ignored = (ROOT / ".gitignore").read_text(encoding="utf-8").replace("/", "").split()
    copy = tmp_path / "src" / PACKAGE
    shutil.copytree(ROOT, copy, symlinks=True, ignore=shutil.ignore_patterns(".git", *ignored))
    return copy


def setup_cfg() -> ConfigParser:
    parser = ConfigParser()
    parser.read(ROOT / "setup.cfg", encoding="utf-8")
    return parser


def entry_points() -> dict[str, str]:
    lines = setup_cfg()["options.entry_points"]["console_scripts"].split("\n")
    return dict(line.split(" = ") for line in lines if line)


def test_manifest_and_code_agree_on_the_version() -> None:
    assert parse_package(str(ROOT)).version == delta_calibration.__version__


def test_manifest() -> None:
    warnings: list[str] = []
    manifest = parse_package(str(ROOT), warnings=warnings)  # raises if the e-mail is invalid
    assert warnings == []
    assert manifest.package_format == 3
    assert manifest.name == PACKAGE
    assert list(map(str, manifest.licenses)) == ["Apache-2.0"]
    assert manifest.get_build_type() == "ament_python"


def test_manifest_has_a_rosdep_key_for_every_python_dependency() -> None:
    requirements = setup_cfg()["options"]["install_requires"].split()
    names = {requirement.split(">=")[0] for requirement in requirements}
    keys = {depend.name for depend in parse_package(str(ROOT)).exec_depends}
    assert {f"python3-{name}" for name in names - WITHOUT_ROSDEP_KEY} <= keys


def test_executables_are_the_command_and_the_nodes() -> None:
    assert set(entry_points()) == {"delta-cal", *NODES}


def test_running_package_finds_its_configuration() -> None:
    packaged = files(PACKAGE) / "config" / CONFIG.name
    assert packaged.read_text(encoding="utf-8") == CONFIG.read_text(encoding="utf-8")


def test_wheel_from_sdist_carries_the_data(source: Path, tmp_path: Path) -> None:
    run(sys.executable, "setup.py", "-q", "sdist", "-d", tmp_path, cwd=source)
    (archive,) = tmp_path.glob("*.tar.gz")
    run("tar", "-xzf", archive, cwd=tmp_path)
    unpacked = tmp_path / archive.name.removesuffix(".tar.gz")
    pip = (sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation")
    run(*pip, "-w", tmp_path, unpacked, cwd=tmp_path, PIP_DISABLE_PIP_VERSION_CHECK="1")
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as content:
        names = set(content.namelist())
        packaged = content.read(f"{PACKAGE}/config/{CONFIG.name}")
    assert packaged == CONFIG.read_bytes()
    schemas = {f"{PACKAGE}/schemas/{path.name}" for path in (ROOT / PACKAGE / "schemas").glob("*")}
    templates = [*(ROOT / PACKAGE).glob("*/templates/*")]
    assert {path.suffix for path in templates} >= {".css", ".c", ".h"}
    pages = {path.relative_to(ROOT).as_posix() for path in templates}
    assert {f"{PACKAGE}/py.typed", *schemas, *pages} <= names
    generated = (ROOT / PACKAGE / "model" / "generated").glob("*.py")
    assert {f"{PACKAGE}/model/generated/{path.name}" for path in generated} <= names
    marker = f"share/ament_index/resource_index/packages/{PACKAGE}"
    assert f"{wheel.name.split('-py3')[0]}.data/data/{marker}" in names
    assert not {name for name in names if ".data/scripts" in name}  # pip writes them to bin


def executables_of(package: str, ament_prefix_path: str) -> dict[str, Path]:
    """Executables that `ros2 run <package>` offers."""
    for prefix in map(Path, ament_prefix_path.split(os.pathsep)):
        if (prefix / "share/ament_index/resource_index/packages" / package).is_file():
            found = [path for path in (prefix / "lib" / package).rglob("*") if path.is_file()]
            return {path.name: path for path in found if os.access(path, os.X_OK)}
    return {}


@pytest.mark.parametrize("options", [(), ("--symlink-install",)], ids=["install", "symlink"])
def test_colcon_build_gives_a_package_that_ros2_run_finds(
    options: tuple[str, ...], source: Path, tmp_path: Path
) -> None:
    colcon = (sys.executable, "-m", "colcon", "--log-base", tmp_path / "log", "build")
    run(*colcon, *options, cwd=tmp_path, COLCON_HOME=str(tmp_path / "colcon"))

    prefix = tmp_path / "install" / PACKAGE
    share = prefix / "share" / PACKAGE
    assert (share / "hook" / "ament_prefix_path.sh").is_file()
    assert (share / "package.xml").is_file()
    assert (share / "config" / CONFIG.name).read_bytes() == CONFIG.read_bytes()
    assert (share / "launch" / "cell.launch.py").is_file()
    assert {"cell.rviz", "cell.foxglove.json"} <= {f.name for f in (share / "config").iterdir()}

    setup = tmp_path / "install" / "setup.sh"
    script = f'. "{setup}" && printenv AMENT_PREFIX_PATH && printenv PYTHONPATH'
    ament_prefix_path, python_path = run("sh", "-c", script, cwd=tmp_path).split()
    executables = executables_of(PACKAGE, ament_prefix_path)
    assert set(executables) == {"delta-cal", *NODES}

    # use the built package, not the one under test: it has to be complete
    built = run(
        sys.executable,
        "-c",
        f"import {PACKAGE}, importlib.resources as r, pathlib;"
        f"print(pathlib.Path({PACKAGE}.__file__).resolve());"
        f"print(len((r.files('{PACKAGE}') / 'config' / '{CONFIG.name}').read_bytes()))",
        cwd=tmp_path,
        PYTHONPATH=python_path,
    ).split()
    assert Path(built[0]).is_relative_to(tmp_path.resolve())
    assert int(built[1]) == CONFIG.stat().st_size
    usage = run(executables["delta-cal"], "--help", cwd=tmp_path, PYTHONPATH=python_path)
    assert "Usage" in usage


@pytest.mark.ros
@pytest.mark.parametrize("name", sorted(NODES))
def test_node_executables_can_be_loaded(name: str) -> None:
    pytest.importorskip("rclpy")
    module, function = entry_points()[name].split(":")
    check = f"from {module} import {function}; assert callable({function})"
    run(sys.executable, "-c", check, cwd=ROOT)


def test_the_example_on_the_front_page_runs(tmp_path, monkeypatch, capsys):
    """The example in the docstring of the package, with a session that comes with it."""
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", delta_calibration.__doc__, re.DOTALL)
    exec(compile(code, "example", "exec"), {})
    left, before = map(float, re.findall(r"(\S+) (?:mm|before)", capsys.readouterr().out))
    assert left < 0.1 * before
    assert (tmp_path / "calibration.yaml").is_file()
