"""Each tutorial is run as published: commands in a shell, outputs compared."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

import pytest

from tutorial import ROOT, Command, File, matches, run_page, steps

FOLDER = ROOT / "docs" / "tutorials"
LIVE = {"calibrate_a_simulated_cell.md", "replay_a_bag.md"}  # these start nodes
ELSEWHERE = {"README.md", "install_in_a_cell.md"}  # no commands, or in test_cell_pages.py
PAGES = sorted(path for path in FOLDER.glob("*.md") if path.name not in ELSEWHERE)
SECONDS = 240.0
CASES = [
    pytest.param(path, id=path.stem, marks=[pytest.mark.ros] if path.name in LIVE else [])
    for path in PAGES
]


@pytest.mark.slow
@pytest.mark.parametrize("path", CASES)
def test_a_tutorial_does_what_it_says(path: Path, tmp_path: Path) -> None:
    if shutil.which("bash") is None:
        pytest.skip("no bash to run the commands of a tutorial")
    if path.name in LIVE and importlib.util.find_spec("rclpy") is None:
        pytest.skip("needs ROS 2 (rclpy), which this Python does not have")
    run_page(path, tmp_path / "work", SECONDS)


def test_there_is_one_for_each_purpose() -> None:
    index = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert len(PAGES) >= 6
    assert all(f"({path.name})" in index for path in FOLDER.glob("[a-z]*.md"))


PAGE = """
Save:

<!-- file: a/greeting.txt -->
```text
hello
```

```console
$ cat a/greeting.txt
hello
$ printf 'one\\ntwo\\n' |
>     sort -r
two
...
```
"""


def test_files_commands_and_outputs_are_told_apart() -> None:
    assert list(steps(PAGE)) == [
        File("a/greeting.txt", "hello\n"),
        Command("cat a/greeting.txt", "hello", 10),
        Command("printf 'one\\ntwo\\n' |\n    sort -r", "two\n...", 12),
    ]


def test_a_page_is_held_to_its_word(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    run_page(page, tmp_path / "good", 20.0)
    for wrong, said in (
        (PAGE.replace("hello\n$", "goodbye\n$"), "line 10: .*greeting.txt\nprinted:\nhello"),
        (PAGE.replace("sort -r", "sort -r; false"), "line 12: (?s:.*)ended with 1"),
        (PAGE.replace("cat a/", "exit; cat a/"), "the shell ended early"),
    ):
        page.write_text(wrong)
        with pytest.raises(AssertionError, match=said):
            run_page(page, tmp_path / str(len(said)), 20.0)


@pytest.mark.parametrize(
    ("printed", "expected", "same"),
    [
        ("a 1.234 b", "a 1.2... b", True),
        ("a\nb\nc\nd", "a\n...\nd", True),
        ("a\nd", "...\na\n...\nd\n...", True),
        ("a\nd", "...\nb\n...\nd\n...", False),
        ("a 1.334 b", "a 1.2... b", False),
        ("a\nb", "a", False),
        ("a.c", "abc", False),
    ],
)
def test_dots_stand_for_anything(printed: str, expected: str, same: bool) -> None:
    assert matches(printed, expected) is same
