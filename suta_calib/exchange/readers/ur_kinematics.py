"""Universal Robots: the factory's calibration of one robot, as a URDF."""

from __future__ import annotations

import configparser
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import read_foreign_text
from suta_calib.exchange.imported import ImportedFile
from suta_calib.exchange.option import Given
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.readers.dh import ROBOT
from suta_calib.exchange.truncated import COMPLETE, check_last_line
from suta_calib.measurements.csv_table import number_in
from suta_calib.measurements.yaml_nodes import plain_data
from suta_calib.model.dh import DhRow, DhTable
from suta_calib.model.urdf import number_text

# Links of the description, and the joints in front of them.
_JOINTS: Final = {
    "shoulder": "shoulder_pan_joint",
    "upper_arm": "shoulder_lift_joint",
    "forearm": "elbow_joint",
    "wrist_1": "wrist_1_joint",
    "wrist_2": "wrist_2_joint",
    "wrist_3": "wrist_3_joint",
}
_ORIGIN: Final = ("x", "y", "z", "roll", "pitch", "yaw")
# From the last link to the flange and to tool0, as in every description of these robots.
_FLANGES: Final = (
    ("wrist_3-flange", "wrist_3_link", "flange", (0.0, -math.pi / 2, -math.pi / 2)),
    ("flange-tool0", "flange", "tool0", (math.pi / 2, 0.0, math.pi / 2)),
)
# d of the joints 1, 4, 5, 6 and a of 2, 3, m: the maker's table of classic DH parameters.
_NOMINAL: Final = {
    "ur3": ((0.1519, 0.11235, 0.08535, 0.0819), (-0.24365, -0.21325)),
    "ur3e": ((0.15185, 0.13105, 0.08535, 0.0921), (-0.24355, -0.2132)),
    "ur5": ((0.089159, 0.10915, 0.09465, 0.0823), (-0.425, -0.39225)),
    "ur5e": ((0.1625, 0.1333, 0.0997, 0.0996), (-0.425, -0.3922)),
    "ur10": ((0.1273, 0.163941, 0.1157, 0.0922), (-0.612, -0.5723)),
    "ur10e": ((0.1807, 0.17415, 0.11985, 0.11655), (-0.6127, -0.57155)),
    "ur16e": ((0.1807, 0.17415, 0.11985, 0.11655), (-0.4784, -0.36)),
}
_TWISTS: Final = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)
_DELTAS: Final = ("delta_theta", "delta_a", "delta_d", "delta_alpha")


class UrKinematicsReader(Reader):
    """``kinematics: {shoulder: …}`` by link, or the controller's ``calibration.conf`` of deltas."""

    name = "ur-kinematics"
    summary = "Universal Robots kinematics YAML, or calibration.conf (--robot ur5e), to a URDF"
    example = "my_robot_calibration.yaml --format ur-kinematics --out arm.urdf"
    options = (ROBOT, COMPLETE)
    suffixes = (".yaml", ".yml", ".conf")
    signature = re.compile(r"^kinematics:\s*(#.*)?$\s+shoulder:|^\s*delta_theta\s*=", re.M)

    def read(self, path: Path, given: Given) -> ImportedFile:
        """A URDF of the six joints, to ``tool0`` (of the deltas: to ``tip``)."""
        text = read_foreign_text(path)
        check_last_line(path, text, given)
        if re.search(r"^\s*delta_theta\s*=", text, re.M):
            content = _of_deltas(path, text, given)
        else:
            data, lines = plain_data(path, text, ForeignFileError)
            content = _of_origins(path, data, lines, given.text(ROBOT, "ur"))
        what = "a URDF of six joints, as the factory calibrated them"
        return ImportedFile(source=path, form=self.name, content=content, what=what, kind=".urdf")


def _of_origins(path: Path, data: Mapping[str, Any], lines: Mapping[Any, int], robot: str) -> str:
    """Joints whose origins stand by link."""
    kinematics = data.get("kinematics")
    links = kinematics if isinstance(kinematics, dict) else {}
    elements, parent = [], "base_link"
    for link, joint in _JOINTS.items():
        values = links.get(link)
        numbers = [values.get(key) if isinstance(values, dict) else None for key in _ORIGIN]
        if not all(isinstance(n, int | float) and math.isfinite(n) for n in numbers):
            line = lines.get(("kinematics", link), lines.get(("kinematics",), 1))
            expected = f"finite numbers {', '.join(_ORIGIN)}"
            problem = "a different origin" if link in links else "none"
            raise ForeignFileError(problem, expected, file=path, line=line, where=link)
        child = f"{link}_link"
        motion = (
            '<axis xyz="0 0 1"/><limit lower="-6.2832" upper="6.2832" effort="0" velocity="3"/>'
        )
        elements += _joint(joint, "revolute", parent, child, np.array(numbers, float), motion)
        parent = child
    for name, parent, child, rpy in _FLANGES:
        elements += _joint(name, "fixed", parent, child, np.array([0.0, 0.0, 0.0, *rpy]), "")
    inside = "\n".join(['  <link name="base_link"/>', *elements])
    return f'<?xml version="1.0"?>\n<robot name="{robot}">\n{inside}\n</robot>\n'


def _joint(
    name: str, kind: str, parent: str, child: str, origin: np.ndarray, inside: str
) -> list[str]:
    xyz, rpy = (" ".join(map(number_text, three)) for three in (origin[:3], origin[3:]))
    return [
        f'  <link name="{child}"/>',
        f'  <joint name="{name}" type="{kind}">',
        f'    <parent link="{parent}"/><child link="{child}"/>',
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>{inside}',
        "  </joint>",
    ]


def _of_deltas(path: Path, text: str, given: Given) -> str:
    """The maker's table of a robot, and what the controller adds to it."""
    robot = given.text(ROBOT).lower()
    if robot not in _NOMINAL:
        raise given.refuse(
            ROBOT,
            repr(robot) if robot else "none",
            f"one of {', '.join(_NOMINAL)}",
            "the file contains only differences from the manufacturer's table",
        )
    parser = configparser.ConfigParser(strict=False)
    try:
        parser.read_string(text)
    except configparser.Error as error:
        problem = f"text that is not a configuration file ({type(error).__name__})"
        raise ForeignFileError(problem, "sections and keys", file=path) from None
    keys = {key: value for section in parser.sections() for key, value in parser[section].items()}
    deltas = []
    for key in _DELTAS:
        cells = re.split(r"[\s,]+", keys.get(key, "").strip(" []"))
        numbers = [number_in(cell) for cell in cells]
        if len(numbers) != len(_TWISTS) or not np.isfinite(numbers).all():
            raise ForeignFileError("other values", "six numbers", file=path, where=key)
        deltas.append(numbers)
    (d1, d4, d5, d6), (a2, a3) = _NOMINAL[robot]
    nominal = zip(
        (0.0,) * 6, (0.0, a2, a3, 0.0, 0.0, 0.0), (d1, 0.0, 0.0, d4, d5, d6), _TWISTS, strict=True
    )
    rows = [
        DhRow(joint, "revolute", theta + more[0], d + more[2], a + more[1], alpha + more[3])
        for joint, (theta, a, d, alpha), more in zip(
            _JOINTS.values(), nominal, zip(*deltas, strict=True), strict=True
        )
    ]
    return DhTable("classic", tuple(rows)).urdf(robot)
