"""A patch for the xacro files of a robot's description: its origins, calibrated."""

from __future__ import annotations

import difflib
import os
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.errors import InputError
from suta_calib.exchange.cells import read_bounded
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import CalibratedArm, Result
from suta_calib.exchange.writer import Writer
from suta_calib.model.urdf import Origin, xacro_bytes
from suta_calib.model.xacro_file import is_xacro
from suta_calib.words import listed

SOURCE: Final = Option(
    "source",
    "A .xacro file that contains joints of the arm; default: the job's.",
    "FILE.xacro",
    several=True,
    file=True,
)
_NO_END: Final = b"\\ No newline at end of file\n"


class XacroPatchWriter(Writer):
    """A unified diff, as ``patch`` and ``git apply`` take it, of the origins that changed."""

    name = "xacro-patch"
    summary = "a patch (unified diff) for the <origin>s in your .xacro files"
    example = "results --format xacro-patch --source urdf/arm_macro.xacro"
    options = (SOURCE,)
    file = "exported_origins.patch"
    notes = (
        "Apply it in the folder that contains all these files: patch -p1 < FILE, or git apply "
        "FILE.",
        "Every robot made from these files gets these origins. For only one of several robots, "
        "include the format xacro, or load xacro-yaml.",
    )

    def content(self, result: Result, given: Given) -> bytes:
        """The diff; every joint whose origin changed must be in one of the files."""
        arm = result.need_arm(self.name)
        paths = [Path(source) for source in given.texts(SOURCE)]
        if not paths and is_xacro(arm.model.urdf[0]):
            paths = [arm.model.urdf[0]]
        if not paths:
            problem = "no .xacro file to patch"
            raise given.refuse(SOURCE, problem, "the file that contains the arm's joints")
        origins, parts, placed = _changed(arm), list[bytes](), dict[str, Path]()
        folder = Path(os.path.commonpath([path.resolve().parent for path in paths]))
        for path in paths:
            before = read_bounded(path)
            after, here = xacro_bytes(path, before, origins)
            for name in here:
                if name in placed:
                    problem = f"the joint {name!r}, which is also in {placed[name]}"
                    raise InputError(problem, "each joint in only one of the files", file=path)
                placed[name] = path
            parts.append(_difference(path.resolve().relative_to(folder), before, after))
        if missing := [name for name in origins if name not in placed]:
            problem = f"no joint {listed(missing)} in {listed(list(map(str, paths)))}"
            expected = "every joint whose origin changed"
            hint = f"name the file that contains it with another {SOURCE.switch} FILE.xacro"
            raise InputError(problem, expected, where=SOURCE.switch, hint=hint)
        return b"".join(parts)


def _changed(arm: CalibratedArm) -> dict[str, Origin]:
    """Origins that are not the nominal ones any more."""
    nominal = arm.model.origins({})
    return {
        name: origin
        for name, origin in arm.model.origins(arm.values).items()
        if not all(map(np.array_equal, origin, nominal[name]))
    }


def _difference(name: Path, before: bytes, after: bytes) -> bytes:
    """Unified diff of a file; empty where nothing changed."""
    lines = difflib.diff_bytes(
        difflib.unified_diff,
        before.splitlines(keepends=True),
        after.splitlines(keepends=True),
        b"a/" + name.as_posix().encode(),
        b"b/" + name.as_posix().encode(),
    )
    return b"".join(line if line.endswith(b"\n") else line + b"\n" + _NO_END for line in lines)
