"""Isolates a test run: its own ROS domain, loopback only, logs in a temporary folder.

This is set here, before any test imports rclpy, once in every pytest-xdist worker; the nodes that
tests start inherit it.
"""

from __future__ import annotations

import fcntl
import gc
import os
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import settings

LAST_SAFE_DOMAIN = 101  # above it, DDS ports overlap with Linux's ephemeral ones
FOREIGN_ROS = (
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "RMW_IMPLEMENTATION",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
)


def _claim_domain() -> int:
    """The first domain that no other test process here holds, locked until this process ends."""
    for domain in range(1, LAST_SAFE_DOMAIN + 1):
        path = Path(tempfile.gettempdir()) / f"delta_calibration_ros_domain_{domain}.lock"
        with suppress(OSError):  # file of another user
            lock = os.open(path, os.O_CREAT | os.O_RDWR)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(lock)
            else:
                return domain
    raise RuntimeError("all ROS domains are taken by other test runs")


for _name in FOREIGN_ROS:
    os.environ.pop(_name, None)
# The workers already use all cores; threads of the linear algebra would slow them down.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["ROS_DOMAIN_ID"] = str(_claim_domain())
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
# A test process has many participants, one per context; a process of a real cell has one.
os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(Path(__file__).with_name("fastdds.xml"))

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


@pytest.hookimpl(hookwrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect without garbage collection: a million objects are made, and nearly all stay.

    They are frozen afterwards, so the collector does not examine them while tests run.
    """
    gc.disable()
    yield
    gc.enable()
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Run files with slow tests first, so that no worker ends with one; mark tests for a rerun."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path])
    _try_again(config, items)


def _try_again(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Rerun a failed test of real nodes once: readings are best effort, a busy machine loses some.

    A real defect fails twice; a rerun is listed in the summary.
    """
    if config.pluginmanager.hasplugin("rerunfailures"):
        for item in items:
            if item.get_closest_marker("ros"):
                item.add_marker(pytest.mark.flaky(reruns=1, reruns_delay=2))


@pytest.fixture(scope="session", autouse=True)
def _ros_log_folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Make nodes write their logs beside the other temporary files, not into the home folder."""
    os.environ["ROS_LOG_DIR"] = str(tmp_path_factory.mktemp("ros_log"))
