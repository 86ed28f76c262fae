"""Reports of imports and exports, and the list of formats."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from suta_calib.assessment import Assessment
from suta_calib.exchange.aligned_rows import AlignedRows
from suta_calib.exchange.imported import Imported, ImportedRows
from suta_calib.exchange.option import Described
from suta_calib.exchange.writer import Exported
from suta_calib.report.document import Document, Part, Text
from suta_calib.report.listing import Column, Listing
from suta_calib.words import enumerated


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
        value=lambda row: [
            {"name": o.switch, "help": o.help, "choices": list(o.choices)} for o in row.options
        ],
    ),
    Column("extra", "needs", cell=lambda row: row.extra and f"suta_calib[{row.extra}]"),
    key="formats",
)


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def imported_document(imported: Imported, written: Path | None = None) -> Document:
    """Report of an import: its columns, and the file that was written."""
    parts: list[Part] = []
    data: dict[str, Any] = {
        "source": str(imported.source),
        "format": imported.form,
        "file": None if written is None else str(written),
    }
    if isinstance(imported, ImportedRows):
        data |= {"rows": len(imported), "dropped": imported.dropped}
        parts.append(COLUMNS.of(_Shown(*column) for column in imported.columns.items()))
    if isinstance(imported, AlignedRows):
        alignment = imported.alignment
        data["alignment"] = {
            "with": str(imported.other),
            "shift_s": alignment.shift,
            "shift_std_s": alignment.shift_std,
            "at_s": alignment.at,
            "drift_ppm": 1e6 * alignment.drift,
            "drift_std_ppm": 1e6 * alignment.drift_std,
            "worst_std_s": alignment.worst_std,
            "overlap_s": alignment.overlap,
            "agreement": alignment.agreement,
            "interpolated": str(imported.interpolated),
        }
    if written is not None:
        parts.append(Text(f"Written to {written}."))
        parts += _pictures(imported, written, data)
        parts += _after_alignment(imported, written)
    title = f"{imported.source.name} as {imported.form}"
    return Document("import", title, imported.assessment, parts, data, written="files")


def _after_alignment(imported: Imported, written: Path) -> list[Part]:
    """What takes the file that two recordings became."""
    if not isinstance(imported, AlignedRows):
        return []
    if "a_x" in imported.columns:
        ready = shlex.join(("suta-calib", "hand-eye", str(written)))
        return [Text(f"Next: {ready} (--setup eye-to-hand for a tracker or camera beside the arm)")]
    return [
        Text(
            f"Next: name {written} as samples in the calibration.yaml of this arm (suta-calib init "
            "starts one)."
        )
    ]


def _pictures(imported: Imported, written: Path, data: dict[str, Any]) -> list[Part]:
    """Where the pictures are, what took them, and what finds the board in them."""
    if not isinstance(imported, ImportedRows) or not imported.pictures:
        return []
    folder, camera = imported.beside(written)
    data |= {"images": str(folder), "camera": None if camera is None else str(camera)}
    sentence = f"{len(imported.pictures)} pictures in {folder}"
    sentence += "" if camera is None else f", the camera in {camera}"
    taken = ("--camera-out", "camera.yaml") if camera is None else ("--camera", str(camera))
    line = ("detect", str(folder), "--board", "board.yaml", "--out", "corners.csv", *taken)
    ready = shlex.join(("suta-calib", *line))
    return [Text(f"{sentence}. Next: {ready}")]


def exported_document(export: Exported, written: Sequence[Path]) -> Document:
    """Report of an export: its files, and the values that the format cannot hold."""
    count = 1 + len(export.more)
    parts = [Text(f"Written to {enumerated([str(path) for path in written[:count]])}.")]
    if written[count:]:
        parts.append(Text(f"What {export.form} cannot hold is in {written[count]}."))
    data: dict[str, Any] = {
        "result": str(export.result.path),
        "format": export.form,
        "files": [str(path) for path in written],
        "left_out": export.left_out,
    }
    title = f"{export.result.path.name} as {export.form}"
    return Document("export", title, export.assessment, parts, data, written="files")


def formats_document(formats: Mapping[str, Described], title: str) -> Document:
    """The formats there are, each as it describes itself."""
    rows: Sequence[Described] = tuple(formats.values())
    sentence = f"{len(rows)} formats"
    answer = Assessment("good", sentence)
    return Document("formats", title, answer, [FORMATS.of(rows)], whole=True)
