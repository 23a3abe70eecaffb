"""Tutorials as programs: their files are written and their commands run as published.

A page is Markdown. A code block after the comment `<!-- file: NAME -->` is a file to be saved
under that name. A ```console block contains commands, with `$ ` before the first line of each and
`> ` before the others, and their output; `...` stands for anything. All commands of a page run in
one shell, one after the other, in an empty folder.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from delta_calibration.processes import child_environment

ROOT = Path(__file__).parents[1]
MARK = "=== done with"
_BLOCK = re.compile(r"(?:<!-- file: (\S+) -->\n+)?^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class File:
    """A file that the reader of a page saves."""

    name: str
    text: str


@dataclass(frozen=True)
class Command:
    """A command that the reader of a page types, and its published output."""

    text: str
    expected: str
    line: int


def steps(page: str) -> Iterator[File | Command]:
    """Files and commands of a page, in order."""
    for block in _BLOCK.finditer(page):
        name, language, text = block.groups()
        if name:
            yield File(name, text)
        elif language == "console":
            yield from _commands(text, page.count("\n", 0, block.start(3)) + 1)


def _commands(text: str, first: int) -> Iterator[Command]:
    parts = re.split(r"^\$ ", text, flags=re.MULTILINE)
    line = first + parts[0].count("\n")
    for part in parts[1:]:
        typed = re.match(r"[^\n]*\n(?:> [^\n]*\n)*", part)
        assert typed is not None, f"line {line}: a command without an end"
        yield Command(
            typed.group().replace("\n> ", "\n").strip(), part[typed.end() :].strip(), line
        )
        line += part.count("\n")


def matches(printed: str, expected: str) -> bool:
    """Whether the output agrees with the published one; `...` is anything, also several lines."""
    if not expected:
        return True  # a page need not show the output of a command
    # A line of dots is any number of lines, including none.
    lines = re.sub(r"^\.\.\.\n|\n\.\.\.$", "...", _tidy(expected), flags=re.MULTILINE)
    parts = [re.escape(part) for part in lines.split("...")]
    return re.fullmatch(".*".join(parts), _tidy(printed), re.DOTALL) is not None


def _tidy(text: str) -> str:
    """Text without blanks at line ends, and without blank lines around it."""
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


def shell_environment(folder: Path) -> dict[str, str]:
    """Environment as after `make install` and `activate`; pip installs into a temporary folder."""
    own = folder / "installed"
    variables = child_environment()
    sources = [str(own), str(ROOT), *variables.get("PYTHONPATH", "").split(os.pathsep)]
    return variables | {
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), variables["PATH"]]),
        "PYTHONPATH": os.pathsep.join(filter(None, sources)),
        "PIP_TARGET": str(own),
        "PIP_NO_BUILD_ISOLATION": "0",  # pip's spelling of yes
        "PIP_NO_INDEX": "1",
        "PIP_NO_DEPS": "1",
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        "PIP_ROOT_USER_ACTION": "ignore",
    }


def run_page(path: Path, folder: Path, seconds: float) -> None:
    """Execute a page in this folder.

    Raises:
        AssertionError: a command failed or printed something else; names its line.
    """
    folder.mkdir(exist_ok=True)
    for name in ("bags", "docs", "config"):
        (folder / name).symlink_to(ROOT / name)
    script, asked = ["exec 2>&1"], []
    for step in steps(path.read_text(encoding="utf-8")):
        if isinstance(step, File):
            place = folder / step.name
            script.append(f"mkdir -p '{place.parent}'")
            script.append(f"cat > '{place}' <<'END OF FILE'\n{step.text}END OF FILE")
        else:
            script.append(f'{step.text}\necho "{MARK} {len(asked)}: $?"')
            asked.append(step)
    assert asked, f"{path.name}: holds no command"
    done = subprocess.run(
        ["bash"],
        input="\n".join(script),
        cwd=folder,
        env=shell_environment(folder),
        capture_output=True,
        text=True,
        check=False,
        timeout=seconds,
    )
    parts = re.split(rf"^{MARK} \d+: (\d+)\n", done.stdout, flags=re.MULTILINE)
    for command, printed, code in zip(asked, parts[::2], parts[1::2], strict=False):
        where = f"{path.name}, line {command.line}: $ {command.text}"
        assert code == "0", f"{where}\nended with {code}:\n{printed}"
        assert matches(printed, command.expected), (
            f"{where}\nprinted:\n{printed}\npublished:\n{command.expected}"
        )
    assert len(parts) // 2 == len(asked), f"{path.name}: the shell ended early:\n{done.stdout}"
