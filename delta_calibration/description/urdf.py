"""Write a tree as URDF text, the XML that RViz, Foxglove and robot_state_publisher read.

Shapes are visual only; there are no masses and no collision shapes.
"""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description.tree import (
    FIXED,
    PRISMATIC,
    REVOLUTE,
    Colour,
    Cylinder,
    Joint,
    Link,
    Tree,
    frame_prefix,
    toward,
)
from delta_calibration.geometry import Frame, rotations

Array = NDArray[np.float64]


def urdf(tree: Tree, prefix: str = "") -> str:
    """Write the URDF document; numbers have all the digits of a double.

    Args:
        tree: tree of the robot.
        prefix: prefix of the link names, which become the frame names; joint names have none.

    Raises:
        InputError: the prefix is not allowed in frame names.
    """
    frame_prefix(prefix)
    robot = Element("robot", name=tree.name)
    for link in tree.links:
        _add_link(robot, replace(link, name=prefix + link.name))
    for joint in tree.joints:
        parent, child = prefix + joint.parent, prefix + joint.child
        _add_joint(robot, replace(joint, parent=parent, child=child))
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _add_link(robot: Element, link: Link) -> None:
    element = SubElement(robot, "link", name=link.name)
    for shape in link.shapes:
        visual = SubElement(element, "visual")
        along = shape.end - shape.start
        _add_origin(visual, Frame(toward(along), (shape.start + shape.end) / 2))
        size = {"radius": _number(shape.radius), "length": _number(float(np.linalg.norm(along)))}
        SubElement(SubElement(visual, "geometry"), "cylinder", size)
        _add_material(visual, shape)


def _add_material(visual: Element, shape: Cylinder) -> None:
    material = SubElement(visual, "material", name=_name(shape.colour))
    SubElement(material, "color", rgba=_numbers(np.array([*shape.colour, 1.0])))


def _name(colour: Colour) -> str:
    """Name of a material: the same colour must have the same name throughout the document."""
    return "colour_" + "_".join(f"{100 * part:.0f}" for part in colour)


def _add_joint(robot: Element, joint: Joint) -> None:
    element = SubElement(robot, "joint", name=joint.name, type=joint.kind)
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    _add_origin(element, joint.origin)
    if joint.kind != FIXED:
        SubElement(element, "axis", xyz=_numbers(joint.axis))
    if joint.kind in (REVOLUTE, PRISMATIC):
        limits = {"lower": joint.lower, "upper": joint.upper, "velocity": joint.speed}
        texts = {name: _number(value) for name, value in limits.items()}
        SubElement(element, "limit", texts, effort="0")


def _add_origin(element: Element, frame: Frame) -> None:
    turn = rotations.roll_pitch_yaw(frame.rotation)
    SubElement(element, "origin", xyz=_numbers(frame.translation), rpy=_numbers(turn))


def _numbers(values: Array) -> str:
    return " ".join(_number(float(value)) for value in values)


def _number(value: float) -> str:
    return repr(float(value) + 0.0)  # no -0.0
