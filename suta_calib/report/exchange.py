"""What came in from other programs and what went out to them, told; and the formats there are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from suta_calib.assessment import Assessment
from suta_calib.exchange.description import Described
from suta_calib.exchange.imported import Imported, ImportedRows
from suta_calib.exchange.writer import Exported
from suta_calib.report.document import Document, Part, Text
from suta_calib.report.listing import Column, Listing


class _Shown(NamedTuple):
    """A column of what was read: its name and what stands in it."""

    name: str
    values: NDArray[Any]

    @property
    def ends(self) -> tuple[Any, Any]:
        """The least and the largest number, or the first label and the last in their order."""
        ordered = np.sort(self.values)
        return ordered[0].item(), ordered[-1].item()


COLUMNS: Final = Listing[_Shown](
    "Columns",
    Column("name", "column"),
    Column("least", "from", lambda row: row.ends[0], cell=lambda row: _short(row.ends[0])),
    Column("most", "to", lambda row: row.ends[1], cell=lambda row: _short(row.ends[1])),
    Column("different", "different", lambda row: len(np.unique(row.values)), form="d"),
    key="columns",
)
FORMATS: Final = Listing[Described](
    "Formats",
    Column("name", "format"),
    Column("summary", "what it is"),
    Column("example", "example"),
    Column(
        "options",
        value=lambda each: [
            {"name": o.switch, "help": o.help, "choices": list(o.choices)} for o in each.options
        ],
    ),
    Column("extra", "needs", cell=lambda each: each.extra and f"suta_calib[{each.extra}]"),
    key="formats",
)


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def imported_document(found: Imported, written: Path | None = None) -> Document:
    """What a foreign file became, column by column.

    Args:
        found: as it was read.
        written: where it was written, if it was.
    """
    parts: list[Part] = []
    data: dict[str, Any] = {
        "source": str(found.source),
        "format": found.form,
        "file": None if written is None else str(written),
    }
    if isinstance(found, ImportedRows):
        data |= {"rows": len(found), "dropped": found.dropped}
        parts.append(COLUMNS.of(_Shown(*each) for each in found.columns.items()))
    if written is not None:
        parts.append(Text(f"Written to {written}."))
        parts += _pictures(found, written, data)
    title = f"{found.source.name} as {found.form}"
    return Document("import", title, found.assessment, parts, data, written="files")


def _pictures(found: Imported, written: Path, data: dict[str, Any]) -> list[Part]:
    """Where the pictures are, what took them, and what finds the board in them."""
    if not isinstance(found, ImportedRows) or not found.pictures:
        return []
    folder, camera = found.beside(written)
    data |= {"images": str(folder), "camera": None if camera is None else str(camera)}
    told = f"{len(found.pictures)} pictures in {folder}"
    told += "" if camera is None else f", the camera in {camera}"
    with_camera = "--camera-out camera.yaml" if camera is None else f"--camera {camera}"
    ready = f"suta-calib detect {folder} --board board.yaml --out corners.csv {with_camera}"
    return [Text(f"{told}. Next: {ready}")]


def exported_document(found: Exported, written: Sequence[Path]) -> Document:
    """What went out, and what the format could not hold.

    Args:
        found: the result in its format.
        written: the file, and beside it what the format cannot hold.
    """
    parts = [Text(f"Written to {written[0]}.")]
    if written[1:]:
        parts.append(Text(f"What {found.form} cannot hold is in {written[1]}."))
    data: dict[str, Any] = {
        "result": str(found.result.path),
        "format": found.form,
        "files": [str(path) for path in written],
        "left_out": found.left_out,
    }
    title = f"{found.result.path.name} as {found.form}"
    return Document("export", title, found.assessment, parts, data, written="files")


def formats_document(formats: Mapping[str, Described], title: str) -> Document:
    """The formats there are, each as it describes itself."""
    rows: Sequence[Described] = tuple(formats.values())
    sentence = f"{len(rows)} formats"
    return Document("formats", title, Assessment("good", sentence), [FORMATS.of(rows)])
