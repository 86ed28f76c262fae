"""Errors of terms brought together: by kind, by landmark, by placement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.diagnostics.accuracy import BlockErrors, Metrics, TermAccuracy
from suta_calib.terms import GROUPINGS as LABEL_COLUMNS
from suta_calib.units import Unit

# Label columns of samples that errors are looked at by.
GROUPINGS: Final = tuple(noun for noun, columns in LABEL_COLUMNS.items() if columns == (noun,))


@dataclass(frozen=True, eq=False)
class KindErrors:
    """Error norms of all terms of one kind, for one quantity.

    Attributes:
        kind: of observation.
        name: ``distance``, ``position`` or ``rotation``.
        unit: m or rad.
        before, after: (n,) with the nominal and with the calibrated arm.
    """

    kind: str
    name: str
    unit: Unit
    before: FloatArray
    after: FloatArray

    @property
    def metrics(self) -> tuple[Metrics, Metrics]:
        """Before and after."""
        return Metrics.of(self.before), Metrics.of(self.after)


def by_kind(terms: Sequence[TermAccuracy]) -> list[KindErrors]:
    """Errors of all terms, one entry for each kind and quantity, in the order of the terms."""
    found: dict[tuple[str, str], list[BlockErrors]] = {}
    for term in terms:
        for block in term.blocks:
            found.setdefault((term.term.kind, block.name), []).append(block)
    return [
        KindErrors(
            kind,
            name,
            blocks[0].unit,
            np.concatenate([b.before for b in blocks]),
            np.concatenate([b.after for b in blocks]),
        )
        for (kind, name), blocks in found.items()
    ]


def groups(terms: Sequence[TermAccuracy], grouping: str) -> dict[str, FloatArray]:
    """Errors after calibration of the terms' first blocks by a label or by ``file``, m.

    An error that belongs to two landmarks, as a distance does, counts for both.
    """
    found: dict[str, list[FloatArray]] = {}
    for term in terms:
        names = _names(term, grouping)
        if names is None:
            continue
        block = term.blocks[0]
        at_rows = names[block.rows]
        for name in dict.fromkeys(names.tolist()):
            errors = block.after[(at_rows == name).any(axis=1)]
            found.setdefault(str(name), []).append(errors)
    joined = {name: np.concatenate(errors) for name, errors in found.items()}
    return {name: errors for name, errors in joined.items() if len(errors)}


def _names(term: TermAccuracy, grouping: str) -> NDArray[np.str_] | None:
    samples = term.term.poses.samples
    if grouping != "file":
        return samples.labels.get(grouping)
    return np.array([PurePath(place.rpartition(":")[0]).name or place for place in samples.origin])
