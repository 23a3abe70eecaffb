"""Build script shared by colcon (ament_python) and pip.

Metadata stands in setup.cfg and not in pyproject.toml's [project] table, because
`colcon build --symlink-install` runs this file in a folder that holds setup.py, setup.cfg and the
packages alone. `python_requires` stands here: colcon cannot read back what older setuptools
make of it in setup.cfg.
"""

from glob import glob

from setuptools import setup

PACKAGE = "delta_calibration"

setup(
    python_requires=">=3.10",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", sorted(glob("config/*.*"))),
        (f"share/{PACKAGE}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{PACKAGE}/msg_docs", sorted(glob("msg_docs/*.md"))),
    ],
)
