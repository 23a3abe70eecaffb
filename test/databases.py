"""Empty databases for tests: SQLite, and a real PostgreSQL server started for them."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest


def _programs() -> Path | None:
    """Folder of PostgreSQL's programs, in Debian's layout or on the path."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), reverse=True)
    if found:
        return found[0].parent
    initdb = shutil.which("initdb")
    return None if initdb is None else Path(initdb).parent


@pytest.fixture(scope="module")
def server() -> Iterator[Path]:
    """Start a separate PostgreSQL server; yield the folder of its socket."""
    pytest.importorskip("psycopg")
    programs = _programs()
    if programs is None:
        pytest.skip("no PostgreSQL: apt install postgresql")
    who = {"user": "postgres"} if os.geteuid() == 0 else {}  # the server refuses to run as root
    folder = Path(tempfile.mkdtemp(prefix="pg", dir="/tmp"))  # socket names must be short
    try:
        if who:
            shutil.chown(folder, "postgres")
        data = folder / "data"
        options = f"-k {folder} -c fsync=off -c listen_addresses='' -c shared_buffers=8MB"
        commands = (
            [
                "initdb",
                "-D",
                str(data),
                "-A",
                "trust",
                "-U",
                "postgres",
                "--no-sync",
                "-E",
                "UTF8",
            ],
            ["pg_ctl", "-D", str(data), "-w", "-l", str(folder / "log"), "-o", options, "start"],
        )
        for command in commands:
            done = subprocess.run(
                [str(programs / command[0]), *command[1:]],
                stdout=subprocess.DEVNULL,  # the server keeps inherited files open
                stderr=subprocess.DEVNULL,
                check=False,
                cwd=folder,
                **who,
            )
            if done.returncode:
                pytest.skip(f"PostgreSQL is there, but {command[0]} does not run here")
        yield folder
        subprocess.run(
            [str(programs / "pg_ctl"), "-D", str(data), "-m", "immediate", "stop"],
            stdout=subprocess.DEVNULL,
            check=True,
            cwd=folder,
            **who,
        )
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """URL of an empty database."""
    if request.param == "sqlite":
        yield str(tmp_path / "h.sqlite")
        return
    folder = request.getfixturevalue("server")
    sqlalchemy = pytest.importorskip("sqlalchemy")
    admin = sqlalchemy.create_engine(
        f"postgresql+psycopg://postgres@/postgres?host={folder}", isolation_level="AUTOCOMMIT"
    )
    with admin.connect() as connection:
        connection.execute(sqlalchemy.text("DROP DATABASE IF EXISTS history"))
        connection.execute(sqlalchemy.text("CREATE DATABASE history"))
    admin.dispose()
    yield f"postgresql://postgres@/history?host={folder}"
