"""Errors before and after: by data and kind, one by one, by landmark and placement."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import methodcaller
from pathlib import PurePath
from typing import Final

import numpy as np
from numpy.typing import NDArray

from suta_calib import units
from suta_calib.arrays import FloatArray
from suta_calib.report.document import Text
from suta_calib.report.listing import Column, Json, Listing, Place, Table
from suta_calib.terms import every_grouping
from suta_calib.terms.block import grouped
from suta_calib.trust.accuracy import BlockErrors, Metrics, TermAccuracy
from suta_calib.units import NOTHING, Unit
from suta_calib.words import listed

# Unit of what was seen in pictures.
PIXELS: Final[Unit] = "px"


@dataclass(frozen=True)
class QuantityErrors:
    """Metrics of errors, m or rad; None where there are no such data."""

    metrics: Metrics | None
    unit: Unit


def _unit(of: QuantityErrors) -> Unit:
    return of.unit


def _metric(key: str, heading: str, name: str = "") -> Column[QuantityErrors]:
    return Column(key, heading, lambda of: of.metrics and getattr(of.metrics, name or key), _unit)


METRICS: Final = Listing[QuantityErrors](
    "",
    _metric("rms", "RMS"),
    _metric("mean", "mean"),
    _metric("std", "std"),
    _metric("max", "max", "maximum"),
    Column("count", "count", lambda of: of.metrics and of.metrics.count, form="d"),
)


@dataclass(frozen=True, eq=False)
class KindErrors:
    """Error norms of all terms of one kind, for one quantity.

    Attributes:
        kind: of observation.
        name: ``distance``, ``position`` or ``rotation``.
        unit: m or rad.
        before, after: (n,) with the nominal and with the calibrated arm.
        chain: of which chain of a robot, where they are told apart.
    """

    kind: str
    name: str
    unit: Unit
    before: FloatArray
    after: FloatArray
    chain: str = ""

    @property
    def metrics(self) -> tuple[Metrics, Metrics]:
        """Before and after."""
        return Metrics.of(self.before), Metrics.of(self.after)

    @property
    def quantity(self) -> str:
        """What was compared, in words: ``pairwise distance``, ``tracked point position``."""
        return in_words(self.kind, self.name, self.chain)


def in_words(kind: str, name: str, chain: str = "") -> str:
    """What of a kind of observation, and of which chain: ``left: tracked point position``."""
    kind = kind.replace("_", " ")
    what = kind if name in kind else f"{kind} {name}"
    return f"{chain}: {what}" if chain else what


def by_kind(terms: Sequence[TermAccuracy], *, by_chain: bool = False) -> list[KindErrors]:
    """Errors of all terms, one entry for each kind and quantity, in the order of the terms.

    Args:
        terms: whose errors.
        by_chain: whether there is an entry for each chain of a robot.
    """
    blocks_by_kind: dict[tuple[str, str, str, Unit], list[tuple[BlockErrors, float]]] = {}
    for term in terms:
        of = term.term.poses.chain if by_chain else "", term.term.kind
        for block in term.blocks:
            blocks_by_kind.setdefault((*of, block.name, block.unit), []).append((block, 1.0))
            if block.pixel is not None:
                # The same errors, as they were seen.
                blocks_by_kind.setdefault((*of, block.name, PIXELS), []).append(
                    (block, block.pixel)
                )
    return [
        KindErrors(
            kind,
            name,
            unit,
            np.concatenate([b.before / scale for b, scale in blocks]),
            np.concatenate([b.after / scale for b, scale in blocks]),
            chain,
        )
        for (chain, kind, name, unit), blocks in blocks_by_kind.items()
    ]


@dataclass(frozen=True)
class AccuracyRow:
    """One row of the table of errors.

    Attributes:
        data: what they are errors of, ``calibration`` or ``validation``; empty where it stands
            above already.
        what: quantity and unit; empty where it stands above already.
        state: ``before`` or ``after``.
        measured: the errors' metrics.
        improvement: of the RMS, as text.
    """

    data: str
    what: str
    state: str
    measured: QuantityErrors
    improvement: str = ""


ERRORS: Final = Listing[AccuracyRow](
    "Errors",
    Column("data", "data"),
    Column("", "of", lambda row: row.what),
    Column("state", "state"),
    *(column.over(lambda row: row.measured) for column in METRICS.columns),
    Column("improvement", "improvement", numeric=True),
    strong=lambda row: row.state == "after",
)


ERRORS_IN_SHORT: Final = Listing[tuple[str, KindErrors]](
    "Errors",
    Column("", "data", lambda row: row[0]),
    Column("", "of", lambda row: f"{row[1].quantity}, {units.unit_name(row[1].unit)}"),
    Column("", "RMS before", lambda row: row[1].metrics[0].rms, unit=lambda row: row[1].unit),
    Column("", "after", lambda row: row[1].metrics[1].rms, unit=lambda row: row[1].unit),
    Column("", "max after", lambda row: row[1].metrics[1].maximum, unit=lambda row: row[1].unit),
    Column("", "count", lambda row: row[1].metrics[1].count, form="d"),
)


def errors_table(
    sets: Mapping[str, Sequence[TermAccuracy]], *, place: Place = "everywhere"
) -> Table:
    """Metrics before and after of terms, by what their data are, and the improvement."""
    rows = [row for name, terms in sets.items() for row in _accuracy_rows(name, terms)]
    return ERRORS.of(rows, place=place)


def errors_in_short(sets: Mapping[str, Sequence[TermAccuracy]]) -> Table:
    """A row for each kind of the data: RMS before and after, for a console."""
    rows = [
        (name, errors) for name, terms in sets.items() for errors in by_kind(terms, by_chain=True)
    ]
    return ERRORS_IN_SHORT.of(rows, place="console")


# Times the median error beyond which a fitted row is named: noise does not reach it.
FAR: Final = 10.0


def far_rows(terms: Sequence[TermAccuracy]) -> Iterator[Text]:
    """A sentence for each term of which a few fitted rows are far from all others.

    A robust fit gives them hardly any weight: the answer is sound, the row is wrong even so.
    """
    for term in terms:
        block, origin = term.blocks[0], term.term.poses.samples.origin
        # A distance is wrong if either of its ends is wrong: `suta-calib outliers` finds which.
        if block.rows.shape[1] != 1 or not len(block.after):
            continue
        far = np.flatnonzero(block.after > FAR * np.median(block.after))
        if not len(far):
            continue
        far = far[np.argsort(-block.after[far])]
        named = [
            f"{origin[block.rows[k, 0]]} ({units.text(block.after[k], block.unit, with_unit=True)})"
            for k in far.tolist()
        ]
        several = len(far) > 1
        weighed = math.isfinite(term.term.blocks[0].noise.huber)
        yield Text(
            f"{len(far)} of {len(block.after)} fitted rows of {term.term.kind} "
            f"{'are' if several else 'is'} more than {FAR:.0f} times as far off as most: "
            f"{listed(named, 3)}. Look for a wrong label or a slip. The fit gives "
            f"{'these rows' if several else 'this row'} "
            + ("little weight." if weighed else "full weight: the job has no huber.")
        )


def _accuracy_rows(name: str, terms: Sequence[TermAccuracy]) -> Iterator[AccuracyRow]:
    if not terms:
        yield AccuracyRow(name, "no such data", NOTHING, QuantityErrors(None, "m"))
    kinds = by_kind(terms, by_chain=True)
    for errors in kinds:
        before, after = errors.metrics
        several = len({(e.kind, e.chain) for e in kinds}) > 1
        what = errors.quantity if several else errors.name
        what = f"{what}, {units.unit_name(errors.unit)}"
        yield AccuracyRow(name, what, "before", QuantityErrors(before, errors.unit))
        better = units.percent(before.rms, after.rms)
        yield AccuracyRow("", "", "after", QuantityErrors(after, errors.unit), better)
        name = ""


def accuracy_json(terms: Sequence[TermAccuracy]) -> dict[str, Json]:
    """Metrics ``before`` and ``after`` of all terms of the first one's kind."""
    if not terms:
        nothing = metrics_json(Metrics.of(np.zeros(0)))
        return {"before": nothing, "after": dict(nothing)}
    of_first_kind = [errors for errors in by_kind(terms) if errors.kind == terms[0].term.kind]
    return {"before": _of_kind(of_first_kind, 0), "after": _of_kind(of_first_kind, 1)}


def metrics_json(metrics: Metrics, unit: Unit = "m") -> Json:
    """RMS, mean, standard deviation and maximum in mm (or deg), and the count."""
    return METRICS.record(QuantityErrors(metrics, unit))


def _of_kind(kinds: Sequence[KindErrors], which: int) -> Json:
    content: Json = {}
    for errors in kinds:
        part = metrics_json(errors.metrics[which], errors.unit)
        content |= {key: value for key, value in part.items() if key not in content}
    if kinds and kinds[0].unit == "rad":
        return content
    # Orientations have one figure beside the positions.
    return {k: v for k, v in content.items() if not k.endswith("_deg") or k == "rms_deg"}


@dataclass(frozen=True, eq=False)
class BlockRows:
    """The errors of one block of a term, as rows of ``residuals.csv``."""

    data: str
    label: str
    term: TermAccuracy
    block: BlockErrors

    def __len__(self) -> int:
        return len(self.block.labels)

    def samples(self) -> list[str]:
        """Of each error the rows of the samples files it belongs to."""
        origin = self.term.term.poses.samples.origin
        return ["; ".join([origin[i] for i in rows]) for rows in self.block.rows.tolist()]

    def numbers(self, name: str, k: int = 0) -> str | list[str]:
        """Errors of the block of that name, or their ``k``-th components; empty without them."""
        values = np.reshape(getattr(self.block, name), (len(self), -1))
        if k >= values.shape[1]:
            return ""
        return [f"{v:.6g}" for v in units.shown(values[:, k], self.block.unit).tolist()]


# ``error_…`` are norms, ``c1 … c3`` the components with their signs (only ``c1`` for distances),
# all in the row's unit.
_RESIDUALS: Final = (
    Column[BlockRows]("set", None, lambda row: row.data),
    Column[BlockRows]("kind", None, lambda row: row.term.term.kind),
    Column[BlockRows]("label"),
    Column[BlockRows]("quantity", None, lambda row: row.block.name),
    Column[BlockRows]("what", None, lambda row: row.block.labels),
    Column[BlockRows]("samples", None, BlockRows.samples),
    Column[BlockRows]("unit", None, lambda row: units.unit_name(row.block.unit)),
    Column[BlockRows]("error_before", None, lambda row: row.numbers("before")),
    Column[BlockRows]("error_after", None, lambda row: row.numbers("after")),
    *(
        Column[BlockRows](
            f"c{k + 1}_{state}", None, methodcaller("numbers", f"residual_{state}", k)
        )
        for state in ("before", "after")
        for k in range(3)
    ),
)
RESIDUALS: Final = Listing[BlockRows]("Every error, before and after", *_RESIDUALS)
RESIDUALS_OF_CHAINS: Final = Listing[BlockRows](
    RESIDUALS.title,
    _RESIDUALS[0],
    Column("chain", None, lambda row: row.term.term.poses.chain),
    *_RESIDUALS[1:],
)


def residual_rows(sets: Mapping[str, Sequence[tuple[str, TermAccuracy]]]) -> Iterator[BlockRows]:
    """Every error of terms with their labels, by what their data are."""
    for data, labelled in sets.items():
        for label, term in labelled:
            yield from (BlockRows(data, label, term, block) for block in term.blocks)


def groupings() -> tuple[str, ...]:
    """Label columns of samples that errors are looked at by."""
    return tuple(noun for noun, columns in every_grouping().items() if columns == (noun,))


def groups(terms: Sequence[TermAccuracy], grouping: str) -> dict[str, FloatArray]:
    """Errors after calibration of the terms' first blocks by a label or by ``file``, in SI.

    Terms whose errors have another unit than those of the first are left out. An error that
    belongs to two landmarks, as a distance does, counts for both.
    """
    by_label: dict[str, list[FloatArray]] = {}
    for term in terms:
        names = _names(term, grouping)
        if names is None or term.blocks[0].unit != terms[0].blocks[0].unit:
            continue
        block, (different, which) = term.blocks[0], grouped(names)
        # Each error once for every name that it belongs to, name by name, in the order of rows.
        row, name = np.divmod(
            np.unique(np.arange(len(block.rows))[:, None] * len(different) + which[block.rows]),
            max(len(different), 1),
        )
        of_each = np.split(
            block.after[row[np.argsort(name, kind="stable")]],
            np.cumsum(np.bincount(name, minlength=len(different)))[:-1],
        )
        for label, errors in zip(different, of_each, strict=True):
            by_label.setdefault(label, []).append(errors)
    joined = {name: np.concatenate(errors) for name, errors in by_label.items()}
    return {name: errors for name, errors in joined.items() if len(errors)}


def _names(term: TermAccuracy, grouping: str) -> NDArray[np.str_] | None:
    samples = term.term.poses.samples
    if grouping != "file":
        return samples.labels.get(grouping)
    places = samples.file_names.tolist()
    names = {place: PurePath(place).name for place in set(places)}
    return np.array([names[p] or o for p, o in zip(places, samples.origin, strict=True)])
