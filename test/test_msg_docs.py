"""msg_docs/ compared with the nodes: a page for each topic and service, with correct contents."""

from __future__ import annotations

import re
from configparser import ConfigParser
from importlib import import_module
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from node_inventory import End, inventory, page_of
from ros_helpers import Bench, bench_fixture  # noqa: F401

pytestmark = pytest.mark.ros

FOLDER = Path(__file__).parents[1] / "msg_docs"
HEAD = ["| node | does | QoS |", "|---|---|---|"]


@pytest.fixture(name="every", scope="module")
def every_fixture(tmp_path_factory: pytest.TempPathFactory):
    bench = Bench()
    try:
        yield inventory(bench, tmp_path_factory.mktemp("nodes"))
    finally:
        bench.take_down()


def ends_of(every: set[End], page: str) -> list[End]:
    return sorted(end for end in every if end.page == page)


def table_of(ends: list[End]) -> str:
    """Table rows that a page has to contain."""
    rows = [f"| `{e.node}` | {e.direction} | {e.qos or '-'} |" for e in ends]
    return "\n".join([*HEAD, *rows])


def differences(page: str, text: str, ends: list[End]) -> list[str]:
    """Errors of a page."""
    wrong = []
    name = re.match(r"# `(\S+)`\n", text)
    # the page of `~/fit` is calibration_node_fit
    said = page_of(name[1].replace("~", ends[0].node)) if name else ""
    if said != page:
        wrong.append(f"its title has to be the name, such as `{page}`")
    kind = ends[0].type_name
    if f"Type: `{kind}`" not in text:
        wrong.append(f"has to say: Type: `{kind}`")
    if table_of(ends) not in text:
        wrong.append(f"has to hold:\n\n{table_of(ends)}\n")
    return wrong + field_differences(kind, text)


def field_differences(kind: str, text: str) -> list[str]:
    """Rows for fields that the message does not have, and fields without a row."""
    package, group, name = kind.split("/")
    message = getattr(import_module(f"{package}.{group}"), name)
    has = (
        set(fields_of(message))
        if group == "msg"
        else {
            f"{part}.{field}"
            for part, half in (("request", message.Request), ("response", message.Response))
            for field in fields_of(half)
        }
    )
    table = text.partition("| field |")[2]
    rows = re.findall(r"^\| `([a-z_.\[\]]+)` \| .+ \|$", table, re.MULTILINE)
    told = {
        row: next((f for f in has if re.match(rf"{re.escape(f)}($|\W)", row)), "") for row in rows
    }
    unknown = [f"{row}: {kind} has no such field" for row in rows if not told[row]]
    return unknown + [f"{f}: no row explains it" for f in sorted(has - set(told.values()))]


def fields_of(message: type) -> list[str]:
    return list(message.get_fields_and_field_types())


def test_every_node_is_asked(every: set[End]) -> None:
    setup = ConfigParser()
    setup.read(FOLDER.parent / "setup.cfg")
    scripts = setup["options.entry_points"]["console_scripts"].split("\n")
    executables = {line.partition("=")[0].strip() for line in scripts if line}
    assert {end.node for end in every} == executables - {"delta-cal"}


def test_each_topic_and_service_has_its_page(every: set[End]) -> None:
    pages = {path.stem for path in FOLDER.glob("*.md")} - {"README"}
    wanted = {end.page for end in every}
    missing = {p: table_of(ends_of(every, p)) for p in sorted(wanted - pages)}
    assert not missing, "\n\n".join(
        f"msg_docs/{p}.md is missing: {ends_of(every, p)[0].type_name}\n{t}"
        for p, t in missing.items()
    )
    assert pages <= wanted, f"pages of what no node has: {sorted(pages - wanted)}"


@pytest.mark.parametrize("path", sorted(FOLDER.glob("[a-z]*.md")), ids=lambda path: path.stem)
def test_a_page_says_what_the_nodes_do(path: Path, every: set[End]) -> None:
    ends = ends_of(every, path.stem)
    assert ends, f"{path.name}: no node has this"
    wrong = differences(path.stem, path.read_text(encoding="utf-8"), ends)
    assert not wrong, f"msg_docs/{path.name}: " + "\n".join(wrong)


def test_the_index_names_every_page() -> None:
    index = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert [p.name for p in FOLDER.glob("[a-z]*.md") if f"({p.name})" not in index] == []


def test_a_page_that_differs_is_found() -> None:
    end = End("clock", "session_player", "publishes", "rosgraph_msgs/msg/Clock", "reliable")
    good = (
        f"# `/clock`\n\nType: `rosgraph_msgs/msg/Clock`\n\n{table_of([end])}\n\n"
        "| field | meaning |\n|---|---|\n| `clock` | time |\n"
    )
    assert differences("clock", good, [end]) == []
    for old, new, said in (
        ("# `/clock`", "# `/time`", "title"),
        ("msg/Clock`", "msg/Time`", "Type: "),
        ("publishes", "subscribes", "has to hold"),
        ("| reliable |", "| best effort |", "has to hold"),
        ("| `clock` |", "| `time` |", "no such field"),
    ):
        assert any(said in text for text in differences("clock", good.replace(old, new), [end]))
