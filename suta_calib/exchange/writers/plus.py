"""PLUS device-set XML with the poses as coordinate definitions."""

from __future__ import annotations

import numpy as np
from lxml import etree

from suta_calib.exchange.chosen_poses import POSE_OPTIONS, chosen_poses
from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer
from suta_calib.units import mm


class PlusWriter(Writer):
    """``CoordinateDefinitions`` that are merged into a device-set file."""

    name = "plus"
    summary = "PLUS device-set XML: CoordinateDefinitions with the poses, mm"
    example = "results --format plus --out PlusDeviceSet_Tool.xml"
    options = POSE_OPTIONS
    file = "exported_plus.xml"

    def content(self, result: Result, given: Given) -> bytes:
        """A ``PlusConfiguration`` with one ``Transform From To Matrix`` for each pose."""
        root = etree.Element("PlusConfiguration", version="2.1")
        definitions = etree.SubElement(root, "CoordinateDefinitions")
        for transform in chosen_poses(result, self.name, given):
            matrix = np.array(transform.matrix)
            matrix[:3, 3] = mm(matrix[:3, 3])
            # PLUS's XToY maps coordinates in X to those in Y: T_Y_X.
            etree.SubElement(
                definitions,
                "Transform",
                From=_letters(transform.child),
                To=_letters(transform.parent),
                Matrix=" ".join(map(repr, matrix.ravel().tolist())),
            )
        return bytes(
            etree.tostring(root, pretty_print=True, xml_declaration=True, encoding="utf-8")
        )


def _letters(name: str) -> str:
    """A frame's name as PLUS takes it: letters and digits, the first one a capital."""
    words = "".join(c if c.isalnum() else " " for c in name).split()
    return "".join(word[:1].upper() + word[1:] for word in words) or "Frame"
