"""Environment of child processes, and removal of shared memory that killed ones leave behind.

The wheels of rclpy start every python of their environment twice, the second time with
LD_LIBRARY_PATH set and a variable that marks this second start. A child python of another
environment inherits both and loads the wrong libraries. On a machine with ROS from apt the
variable is absent, and nothing is removed.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

BOOTSTRAP_MARK = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
SHARED_MEMORY = Path("/dev/shm")
AGE_S = 10.0  # [s]


def child_environment(
    domain_id: int | None = None, base: Mapping[str, str] | None = None, local_only: bool = False
) -> dict[str, str]:
    """Environment for a child process that runs a node, or any other python.

    Args:
        domain_id: ROS domain of the child; None leaves it as it is.
        base: environment to start from; this process's own by default.
        local_only: keep discovery on this machine.
    """
    environment = dict(os.environ if base is None else base)
    if environment.pop(BOOTSTRAP_MARK, None) is not None:
        kept = [p for p in environment.pop("LD_LIBRARY_PATH", "").split(":") if not _of_wheel(p)]
        if kept:
            environment["LD_LIBRARY_PATH"] = ":".join(kept)
    if domain_id is not None:
        environment["ROS_DOMAIN_ID"] = str(domain_id)
    if local_only:
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    return environment


def _of_wheel(library_path: str) -> bool:
    """Whether the wheels put this entry into LD_LIBRARY_PATH: their folders, `prefix/lib`."""
    path = Path(library_path)
    wheel = path.name.startswith("ros_") and path.suffix == ".libs"
    return not library_path or wheel or (path.parent / "pyvenv.cfg").is_file()


def remove_dead_shared_memory(folder: Path = SHARED_MEMORY) -> list[str]:
    """Remove shared memory that Fast DDS processes of this user left behind when they were killed.

    Call it before the first node is started or after one was killed, not while others start:
    between creating a segment and locking it there is a moment in which it looks dead.

    A living owner holds the lock files of its segments (`_el`, `_sl`); a segment is dead if its
    locks can be taken, or if it has had none for AGE_S.

    Returns:
        Names of the segments removed.
    """
    names = {path.name.removesuffix("_el") for path in folder.glob("fastrtps_*")}
    removed = []
    for segment in sorted(name for name in names if not name.endswith("_sl")):
        with _locked(folder / f"{segment}_el", folder / f"{segment}_sl") as taken:
            if taken or (taken is None and _old(folder / segment)):
                for name in (segment, f"{segment}_sl", f"sem.{segment}_mutex", f"{segment}_el"):
                    (folder / name).unlink(missing_ok=True)
                removed.append(segment)
    return removed


def _old(path: Path) -> bool:
    """Whether a file is this user's and has not been touched for AGE_S."""
    try:
        facts = path.stat()
    except FileNotFoundError:
        return False
    return facts.st_uid == os.getuid() and time.time() - facts.st_mtime > AGE_S


@contextmanager
def _locked(*locks: Path) -> Iterator[bool | None]:
    """Hold the locks that exist: True if all were taken, False if not, None if there are none."""
    with ExitStack() as stack:
        taken = None
        for lock in locks:
            try:
                handle = stack.enter_context(lock.open("rb"))
                if os.fstat(handle.fileno()).st_uid != os.getuid():
                    taken = False
                    break
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                taken = True
            except FileNotFoundError:
                continue
            except OSError:  # held by its owner, or not ours to open
                taken = False
                break
        yield taken
