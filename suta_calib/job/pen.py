"""A copy of a URDF with a pen in its hand."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Final
from xml.sax.saxutils import quoteattr

from suta_calib.errors import UrdfError
from suta_calib.inputs import UrdfFile
from suta_calib.model.urdf_tree import read_tree

PEN: Final = "pen_tip"
_MESH: Final = re.compile(r"""(<mesh\b[^>]*?\bfilename=)(["'])([^"']+)\2""")
_END: Final = "</robot>"


def with_pen(urdf: UrdfFile | str, hand: str, before: Path, after: Path) -> str:
    """The text of a URDF with a link `PEN` fixed to a link, its origin there.

    Args:
        urdf: the file, or its text.
        hand: the link, or the joint that carries it.
        before: folder from which the file names its meshes.
        after: folder in which the copy will be.

    Raises:
        UrdfError: there is such a link already, or the text has no end.
    """
    tree = read_tree(urdf)
    urdf_text = tree.data.decode()
    if PEN in tree.links:
        raise UrdfError(f"a link {PEN!r}", "no such link yet: give it as --tip")
    link = tree.joints[hand].child if hand in tree.joints else hand
    if link not in tree.links or _END not in urdf_text:
        raise UrdfError(repr(hand), "a link or joint of the URDF", where="--tip")

    def moved(match: re.Match[str]) -> str:
        start, sign, name = match.groups()
        if "://" not in name and not Path(name).is_absolute():
            name = Path(os.path.relpath(before / name, after)).as_posix()
        return f"{start}{sign}{name}{sign}"

    text, end, rest = _MESH.sub(moved, urdf_text).rpartition(_END)
    joint = (
        f'  <link name="{PEN}"/>\n'
        f'  <joint name="{PEN}_in_hand" type="fixed">\n'
        '    <origin xyz="0 0 0" rpy="0 0 0"/>\n'
        f"    <parent link={quoteattr(link)}/>\n"
        f'    <child link="{PEN}"/>\n'
        "  </joint>\n"
    )
    return f"{text}{joint}{end}{rest}"
