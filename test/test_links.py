"""Every relative link in a page leads to an existing file."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("docs", "msg_docs", "bags")
PAGES = sorted([*ROOT.glob("*.md"), *(p for f in FOLDERS for p in (ROOT / f).rglob("*.md"))])
LINK = re.compile(r"\]\(([^)\s#]+)(?:#[^)]*)?\)")


def dead(page: str, folder: Path) -> list[str]:
    links = (link for link in LINK.findall(page) if "://" not in link)
    return [link for link in links if not (folder / link).exists()]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(path: Path) -> None:
    assert dead(path.read_text(encoding="utf-8"), path.parent) == []


def test_a_dead_link_is_found() -> None:
    assert dead("[a](README.md), [b](no_such.md#part), [c](https://x.org/d.md)", ROOT) == [
        "no_such.md"
    ]
