"""A reader of URDF files with the standard library alone, and the positions of their links.

It shares no code with the package: rotations by scipy, transforms as 4 x 4 matrices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class UrdfJoint:
    name: str
    kind: str
    parent: str
    child: str
    origin: np.ndarray  # (4, 4)
    axis: np.ndarray  # (3,)
    limit: dict[str, float] | None


class Urdf:
    """Content of the file; the checks are those of the URDF specification."""

    def __init__(self, text: str) -> None:
        robot = ElementTree.fromstring(text)
        assert robot.tag == "robot"
        self.name = robot.attrib["name"]
        self.links = [link.attrib["name"] for link in robot.findall("link")]
        self.joints = [_joint(element) for element in robot.findall("joint")]
        names = [joint.name for joint in self.joints]
        children = [joint.child for joint in self.joints]
        assert len(set(self.links)) == len(self.links)
        assert len(set(names)) == len(names)
        assert len(set(children)) == len(children), "a link has two parents"
        assert {j.parent for j in self.joints} | set(children) <= set(self.links)
        (self.root,) = set(self.links) - set(children)
        for joint in self.joints:
            if joint.kind in ("revolute", "prismatic"):
                assert joint.limit is not None
                assert {"lower", "upper", "effort", "velocity"} == set(joint.limit)
            if joint.kind != "fixed":
                np.testing.assert_allclose(np.linalg.norm(joint.axis), 1.0, atol=1e-12)

    def joint(self, name: str) -> UrdfJoint:
        return next(joint for joint in self.joints if joint.name == name)

    def place(self, link: str, values: Mapping[str, float]) -> np.ndarray:
        """`T_root_link`, (4, 4): composed from the link up to the root."""
        pose = np.eye(4)
        while link != self.root:
            joint = next(joint for joint in self.joints if joint.child == link)
            pose = joint.origin @ _motion(joint, values) @ pose
            link = joint.parent
        return pose


def _joint(element: ElementTree.Element) -> UrdfJoint:
    origin, axis, limit = (element.find(name) for name in ("origin", "axis", "limit"))
    pose = np.eye(4)
    if origin is not None:
        pose[:3, 3] = _numbers(origin.attrib["xyz"])
        pose[:3, :3] = Rotation.from_euler("xyz", _numbers(origin.attrib["rpy"])).as_matrix()
    parent, child = element.find("parent"), element.find("child")
    assert parent is not None
    assert child is not None
    return UrdfJoint(
        element.attrib["name"],
        element.attrib["type"],
        parent.attrib["link"],
        child.attrib["link"],
        pose,
        np.array([1.0, 0.0, 0.0]) if axis is None else _numbers(axis.attrib["xyz"]),
        None if limit is None else {k: float(v) for k, v in limit.attrib.items()},
    )


def _motion(joint: UrdfJoint, values: Mapping[str, float]) -> np.ndarray:
    pose = np.eye(4)
    if joint.kind in ("revolute", "continuous"):
        pose[:3, :3] = Rotation.from_rotvec(values[joint.name] * joint.axis).as_matrix()
    elif joint.kind == "prismatic":
        pose[:3, 3] = values[joint.name] * joint.axis
    else:
        assert joint.kind == "fixed"
    return pose


def _numbers(text: str) -> np.ndarray:
    return np.array([float(part) for part in text.split()])
