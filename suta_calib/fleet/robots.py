"""Which robots are checked: a list of their results and of their new rows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from glob import glob, has_magic
from pathlib import Path
from typing import Final

from suta_calib.errors import InputError
from suta_calib.fleet.jobs import FleetJob
from suta_calib.measurements.csv_table import CsvTable, read_csv_table

_EXPECTED: Final = "a list with the columns robot, result, samples and, where needed, like"


@dataclass(frozen=True)
class FleetRobot(FleetJob):
    """One robot of many; its path is that of its result.

    Attributes:
        samples: files of new rows.
        like: kind or label of the job's row that they are like.
    """

    samples: tuple[Path, ...] = ()
    like: str = ""

    def absolute(self) -> FleetRobot:
        """The same with paths that hold in any folder."""
        samples = tuple(path.absolute() for path in self.samples)
        path, folder = self.path.absolute(), self.folder.absolute()
        return replace(self, path=path, folder=folder, samples=samples)


def read_robots(
    path: str | Path, out: Path | None = None, *, follow: bool = False
) -> list[FleetRobot]:
    """A list of robots: a CSV file with the columns ``robot, result, samples[, like]``.

    Paths that are not absolute are relative to the list's folder. ``samples`` may name several
    files, with ``;`` between them, and patterns.

    Args:
        path: of the list.
        out: folder below which every robot has a folder of its name; by default nothing is written
            of a robot but the history beside its result.
        follow: whether the samples of each are one file, which may be yet to come.

    Raises:
        InputError: it is no such list, a cell is empty, or a robot or a file of rows stands in two
            of its rows: named by its line.
    """
    path = Path(path)
    table = read_csv_table(path)
    known = {"robot", "result", "samples", "like"}
    for name in table.columns:
        if name not in known:
            raise InputError(f"a column {name!r}", _EXPECTED, file=path, line=table.header_line)
    names = table.labels("robot", _EXPECTED).tolist()
    results = table.labels("result", _EXPECTED).tolist()
    samples = table.labels("samples", _EXPECTED).tolist()
    likes = table.cells("like") if "like" in table.columns else [""] * len(table)
    if not names:
        raise InputError("a list without robots", "a row for each", file=path)
    robots, first = list[FleetRobot](), dict[str, int]()
    for row, (name, like) in enumerate(zip(names, likes, strict=True)):
        if Path(name).name != name or name in (".", ".."):
            raise table.refuse(row, "robot", repr(name), "a name that a folder may have")
        if name in first:
            there = f"robot {name!r} a second time"
            raise table.refuse(row, "robot", there, f"each once: it stands in line {first[name]}")
        first[name] = table.lines[row]
        result = path.parent / results[row]
        files = _files(table, row, samples[row], follow=follow)
        place = result if out is None else out / name
        robots.append(FleetRobot(name, result, place, files, like))
    return robots


def _files(table: CsvTable, row: int, cell: str, *, follow: bool) -> tuple[Path, ...]:
    """The files of rows that a cell names."""
    found = list[Path]()
    for part in filter(None, (part.strip() for part in cell.split(";"))):
        path = table.path.parent / part
        # Not `Path.glob`, which takes no absolute pattern.
        matches = sorted(glob(str(path))) if has_magic(part) and not path.exists() else []  # noqa: PTH207
        # What matches nothing is a file that is not there, and is named as such.
        found += map(Path, matches) if matches else [path]
    if not found or (follow and len(found) > 1):
        expected = "one file, which grows" if follow else "files of new rows"
        raise table.refuse(row, "samples", repr(cell), expected)
    return tuple(found)
