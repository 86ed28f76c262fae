"""A row declared once: key, heading, value, unit and sign of each column.

JSON, console table, HTML and CSV follow from the declaration. Values are SI inside; what is shown
and written is in the reader's unit, and then the key and the CSV column say so (``rms_mm``).
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from dataclasses import KW_ONLY, dataclass, replace
from itertools import repeat
from typing import Any, Generic, Literal, TypeVar, cast

import numpy as np

from suta_calib import units
from suta_calib.units import NOTHING, Unit

Row = TypeVar("Row")
Outer = TypeVar("Outer")
Json = dict[str, Any]
# What a cell means at a glance: as an assessment's levels, or of note, or of little weight.
Tone = Literal["good", "note", "care", "bad", "soft"]
# Where a part is shown. With --verbose a console has more: ``detail`` is there and on a page,
# ``verbose`` there alone.
Place = Literal["everywhere", "console", "page", "detail", "verbose"]


@dataclass(frozen=True, eq=False)
class Column(Generic[Row]):
    """One quantity of a row.

    Attributes:
        key: in JSON and CSV, without the unit's suffix; empty for what is only shown.
        heading: above the column; None for what is only written.
        value: of a row, in SI: a number, a text, None, or an array (written only); the attribute
            of the key's name by default.
        unit: of the value, or of each row's; None for counts, texts and ratios.
        si: whether it is written in SI, without suffix, beside a column that says in which unit.
        sign: whether a plus is shown.
        form: format of a number that has no unit, or decimals that differ from the unit's usual
            ones, as ``.2f``.
        cell: what is shown of a row where it is not the value alone.
        numeric: whether it stands flush right; by default where ``unit``, ``sign`` or ``form`` is
            given.
        optional: whether it is left out of JSON where a row has nothing, and of a table in which
            no row has anything.
        tone: of a row's cell.
    """

    key: str
    heading: str | None = None
    value: Callable[[Row], Any] | None = None
    unit: Unit | Callable[[Row], Unit] | None = None
    _: KW_ONLY
    si: bool = False
    sign: bool = False
    form: str = ""
    cell: Callable[[Row], str] | None = None
    numeric: bool | None = None
    optional: bool = False
    tone: Callable[[Row], Tone | None] | None = None

    def over(self, part: Callable[[Outer], Row]) -> Column[Outer]:
        """The column of rows of which ``part`` is the one it is declared for."""

        def through(of: Any) -> Any:
            return (lambda row: of(part(row))) if callable(of) else of

        functions = {name: through(getattr(self, name)) for name in ("unit", "cell", "tone")}
        column: Any = replace(self, value=through(self.of), **functions)
        return cast("Column[Outer]", column)

    @property
    def written_key(self) -> str:
        """The key with its unit: ``rms_mm``; without it where rows differ in it."""
        return self.key if self.si or callable(self.unit) else units.key(self.key, self.unit)

    @property
    def flush_right(self) -> bool:
        """Whether it is a column of numbers."""
        if self.numeric is not None:
            return self.numeric
        return self.unit is not None or self.sign or bool(self.form)

    def has(self, row: Row) -> bool:
        """Whether there is anything to tell of a row."""
        return not self.optional or bool(self.of(row))

    def of(self, row: Row) -> Any:
        """The value of a row, in SI."""
        return getattr(row, self.key) if self.value is None else self.value(row)

    def unit_of(self, row: Row) -> Unit | None:
        """The unit of a row's value."""
        return self.unit(row) if callable(self.unit) else self.unit

    def entry(self, row: Row) -> tuple[str, Any]:
        """Key and value as JSON has them: the reader's unit, lists for arrays, null for none."""
        unit = None if self.si else self.unit_of(row)
        return units.key(self.key, unit), plain(self.of(row), unit)

    def text(self, row: Row) -> str:
        """The value as it is shown."""
        if self.cell is not None:
            return self.cell(row)
        value, unit = self.of(row), self.unit_of(row)
        if value is None or (isinstance(value, float) and not math.isfinite(value)):
            return NOTHING
        if isinstance(value, (str, bool)):
            return str(value)
        if unit is not None and not self.form:
            return units.text(float(value), unit, sign=self.sign)
        number = value if unit is None else units.shown(float(value), unit)
        return format(number, ("+" if self.sign else "") + self.form)


@dataclass(frozen=True, eq=False)
class Table:
    """A listing with its rows: what a sink shows or writes.

    Attributes:
        title: above it.
        key: under which JSON holds it; empty for what is only shown.
        heads: of the columns that are shown.
        numeric: columns that stand flush right.
        cells: texts, row by row.
        tones: of the cells.
        json: makes it as JSON has it.
        strong: rows that are the outcome of those above them.
        place: where it is shown; JSON has it all the same.
        folded: whether a page shows its title alone until it is opened; a console does without.
    """

    title: str
    key: str
    heads: Sequence[str]
    numeric: frozenset[int]
    cells: Sequence[Sequence[str]]
    tones: Sequence[Sequence[Tone | None]]
    json: Callable[[], Any]
    strong: frozenset[int] = frozenset()
    place: Place = "everywhere"
    folded: bool = False


class Listing(Generic[Row]):
    """Rows of one kind.

    Args:
        title: above the table.
        columns: in order.
        key: under which JSON holds the rows; empty for what is only shown.
        named: whether JSON has the rows by the value of the first column, instead of as a list.
        strong: whether a row is the outcome of those above it: shown in bold, closing them off.
    """

    def __init__(
        self,
        title: str,
        *columns: Column[Row],
        key: str = "",
        named: bool = False,
        strong: Callable[[Row], bool] = lambda _: False,
    ) -> None:
        self.title, self.columns = title, columns
        self._key, self._named, self._strong = key, named, strong

    def of(
        self,
        rows: Iterable[Row],
        title: str | None = None,
        *,
        place: Place = "everywhere",
        folded: bool = False,
    ) -> Table:
        """These rows as a part of a document: their `Table`."""
        rows = tuple(rows)
        headed = [c for c in self.columns if c.heading is not None]
        shown = [c for c in headed if not c.optional or any(map(c.has, rows))]
        return Table(
            self.title if title is None else title,
            self._key,
            [c.heading or "" for c in shown],
            frozenset(k for k, c in enumerate(shown) if c.flush_right),
            [[c.text(row) for c in shown] for row in rows],
            [[None if c.tone is None else c.tone(row) for c in shown] for row in rows],
            lambda: self.records(rows),
            frozenset(k for k, row in enumerate(rows) if self._strong(row)),
            "page" if folded else place,
            folded,
        )

    def facts(self, row: Row, heads: tuple[str, str, str] = ("", "", "")) -> Table:
        """One row, upright: what it is, its value, its unit."""
        shown = [(c, c.unit_of(row)) for c in self.columns if c.heading is not None]
        return Table(
            self.title,
            self._key,
            heads,
            frozenset({1}),
            [
                [c.heading or "", c.text(row), (unit and units.unit_name(unit)) or ""]
                for c, unit in shown
            ],
            [[None, None if c.tone is None else c.tone(row), None] for c, _ in shown],
            lambda: self.record(row),
        )

    def record(self, row: Row) -> Json:
        """One row as JSON has it."""
        return dict(c.entry(row) for c in self.columns if c.key and c.has(row))

    def records(self, rows: Iterable[Row]) -> Json | list[Json]:
        """Rows as JSON has them: a list, or by the first column's value."""
        if not self._named:
            return [self.record(row) for row in rows]
        first, rest = self.columns[0], Listing("", *self.columns[1:])
        return {str(first.of(row)): rest.record(row) for row in rows}


def written(
    *names: str, unit: Unit | Callable[[Any], Unit] | None = None
) -> tuple[Column[Any], ...]:
    """Columns that are only written: attributes of these names, all of one unit."""
    return tuple(Column(name, unit=unit) for name in names)


def shown_as(heading: str, cell: Callable[[Row], str]) -> Column[Row]:
    """A column of numbers that is only shown, as the text that ``cell`` makes."""
    return Column("", heading, cell=cell, numeric=True)


def components(
    headings: Sequence[str],
    vector: Callable[[Row], Any],
    unit: Unit,
    *,
    sign: bool = False,
    form: str = "",
) -> tuple[Column[Row], ...]:
    """Columns that only show the components of a row's vector, SI; a dash where it has none."""

    def component(k: int) -> Callable[[Row], float | None]:
        def of(row: Row) -> float | None:
            values = vector(row)
            return None if values is None else float(values[k]) + 0.0

        return of

    return tuple(
        Column("", heading, component(k), unit, sign=sign, form=form)
        for k, heading in enumerate(headings)
    )


def csv_text(listing: Listing[Row], rows: Iterable[Row], digits: int | None = None) -> str:
    """Rows as a CSV file, numbers with so many digits; columns that hold lists are left out."""
    columns = [c for c in listing.columns if c.key]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(c.written_key for c in columns)
    for row in rows:
        cells = (c.entry(row)[1] for c in columns)
        writer.writerow(f"{v:.{digits}g}" if digits and isinstance(v, float) else v for v in cells)
    return text.getvalue()


def csv_of_groups(listing: Listing[Row], groups: Iterable[Row]) -> str:
    """Many rows as a CSV file, given a group at a time.

    Args:
        listing: its columns that have a key; of a group a value is a text that all its rows share,
            or a sequence of texts, one each.
        groups: in order; each has as many rows as it has length.
    """
    columns = [c for c in listing.columns if c.key]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(c.written_key for c in columns)
    for group in groups:
        values = (c.of(group) for c in columns)
        count = len(cast("Sized", group))
        writer.writerows(
            zip(*(repeat(v, count) if isinstance(v, str) else v for v in values), strict=True)
        )
    return text.getvalue()


def plain(value: Any, unit: Unit | None = None) -> Any:
    """A value as JSON has it: the reader's unit, lists for arrays, null for what is no number."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(name): plain(part, unit) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(part, unit) for part in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return value
    if unit is not None:
        value = units.shown(float(value), unit)
    return value if math.isfinite(value) else None


def json_text(data: Mapping[str, Any], indent: int = 1, *, ascii_only: bool = False) -> str:
    """A JSON document as it is written; what is not a finite number becomes null."""
    finite = json.loads(json.dumps(data), parse_constant=lambda _: None)
    return json.dumps(finite, indent=indent, ensure_ascii=ascii_only, allow_nan=False) + "\n"
