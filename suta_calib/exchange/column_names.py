"""Names of the columns in tables of other programs, and their meaning."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Final

from suta_calib.errors import ForeignFileError, did_you_mean
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.sheet import Sheet
from suta_calib.exchange.table_roles import plain_name
from suta_calib.words import listed

COLUMNS: Final = Option(
    "columns",
    "Names for columns, given by name or number, that have other names in the file.",
    "q1=joint_1,7=x,…",
    several=True,
)
JOINT_NAMES: Final = ("*joint*", "*axis*", "q[0-9]", "q[0-9][0-9]", "j[0-9]", "j[0-9][0-9]")
# What a column with the time of its row is called.
CLOCKS: Final = ("time", "timestamp", "frame")
# A time with its unit behind it, and how many of it make a second.
_TIME: Final = re.compile(r"(?:time|timestamp|t)\s*[\[(](s|ms|us|µs|ns)[\])]", re.IGNORECASE)
# As EuRoC calls them: the position of S from R in the axes of R, and the quaternion of S in R.
_WITH_FRAMES: Final = re.compile(r"(p_([A-Z]+)_[A-Z]+|q_([A-Z]+))_([wxyz])(\s*[\[(].*)?")
# TUM's trajectories: seconds, metres, scalar last.
TUM: Final = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
# Numbers of a pose that figaroh and others write with the marker's number behind.
_NUMBERED: Final = (
    *("x", "y", "z", "phix", "phiy", "phiz", "roll", "pitch", "yaw", "rx", "ry", "rz"),
    *("qx", "qy", "qz", "qw"),
)


def is_joint(name: str) -> bool:
    """Whether a column is called as joints are."""
    return any(fnmatchcase(plain_name(name)[0], pattern) for pattern in JOINT_NAMES)


def seconds_in(name: str) -> float:
    """How many of a time's unit make a second, by a column's name; 0 where it names no such."""
    match = _TIME.fullmatch(name)
    per_second = {"s": 1.0, "ms": 1e3, "us": 1e6, "µs": 1e6, "ns": 1e9}
    return 0.0 if match is None else per_second[match[1].lower()]


def usual_names(names: Sequence[str]) -> list[str]:
    """Names without the frames in them: ``p_RS_R_x [m]`` is x [m], and ``q_RS_w []`` is qw.

    Only where there is one such pose. The clock of TUM's trajectories is in s: a time.
    """
    if tuple(names) == TUM:
        return ["time", *names[1:]]
    matches = {name: _WITH_FRAMES.fullmatch(name) for name in names}
    if len({match[2] or match[3] for match in matches.values() if match}) != 1:
        return list(names)
    plain = [
        name if match is None else match[4] + (match[5] or "") if match[2] else "q" + match[4]
        for name, match in matches.items()
    ]
    return plain if len(set(plain)) == len(plain) else list(names)


def of_markers(names: Sequence[str]) -> list[str]:
    """Names with the marker's number in front, as of any body: ``x2`` is the x of ``2_``."""
    markers = [name[1:] for name in names if name[:1] == "x" and name[1:].isdigit()]
    complete = [n for n in markers if {f"{axis}{n}" for axis in "xyz"} <= {*names}]
    spelt = {f"{number}{n}": f"{n}_{number}" for number in _NUMBERED for n in complete}
    return [spelt.get(name, name) for name in names]


def renamed(sheet: Sheet, given: Given) -> list[str]:
    """Names of the columns as ``--columns`` has them."""
    names, asked = usual_names(sheet.names), given.pairs(COLUMNS)
    marked = of_markers(names)
    # Where somebody says what such a column is, the others are columns like any.
    if not any(old != new and old in asked for old, new in zip(names, marked, strict=True)):
        names = marked
    for source, target in asked.items():
        if source in sheet.names:
            k = sheet.names.index(source)
        elif source in map(str, range(1, len(names) + 1)):
            k = int(source) - 1
        else:
            problem = f"no column {source!r}"
            expected = f"one of {listed(list(sheet.names), 16)}, or a number from 1 to {len(names)}"
            hint = did_you_mean(source, sheet.names)
            raise ForeignFileError(
                problem, expected, file=sheet.path, where=COLUMNS.switch, hint=hint
            )
        # A new name without a unit leaves the column in the unit that its own name says.
        unit = plain_name(names[k])[1]
        names[k] = f"{target} [{unit}]" if unit and not plain_name(target)[1] else target
    for name, times in Counter(names).items():
        if name and times > 1:
            raise ForeignFileError(
                f"{name!r} for several columns",
                "each name only once",
                file=sheet.path,
                where=COLUMNS.switch,
            )
    return names
