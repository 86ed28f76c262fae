"""How far the tip is from where a calibration puts it, sample by sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.analysis.planning.situation import over
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.model.arm import ArmModel
from suta_calib.terms import Term
from suta_calib.terms.block import grouped
from suta_calib.trust.held_out import robust_level
from suta_calib.trust.tip import sensitivity, tip_displacements

# Blocks at least and at most: a t test gains little beyond 60.
BLOCKS: Final = (6, 60)
# Rows that are used at most: the exact solution takes time with the cube of their number.
MOST: Final = 1000


@dataclass(frozen=True, eq=False)
class TipResiduals(Displayable):
    """Errors of the calibrated tip.

    Attributes:
        q: (n, joints) readings of the joints that move the tip.
        jacobian: (n, 3, joints) derivative of the tip by them, base axes, m per rad or m.
        error: (n, 3) measured less calculated position of the tip, base axes, m.
        time: (n,) numbers of the stretches of time, or places, that rows were taken in, from 0.
        gross: rows that were left out because their error is gross.
    """

    q: FloatArray
    jacobian: FloatArray
    error: FloatArray
    time: IntArray
    gross: int = 0

    def __len__(self) -> int:
        return len(self.q)

    def take(self, rows: IntArray) -> TipResiduals:
        """Some of the rows, by number."""
        return TipResiduals(
            self.q[rows], self.jacobian[rows], self.error[rows], self.time[rows], self.gross
        )


def tip_derivative(arm: ArmModel, values: Mapping[str, float], q: FloatArray) -> FloatArray:
    """(n, 3, joints) derivative of the tip's position by the readings of `own_joints`."""
    by_mover = sensitivity(arm, values, arm.offsets, q).jacobian
    return np.asarray((by_mover @ arm.gearing)[:, :, own_columns(arm)])


def own_columns(arm: ArmModel) -> list[int]:
    """Which columns of the readings are those of `own_joints`."""
    return [arm.joints.index(name) for name in arm.own_joints]


def sees_position(term: Term) -> bool:
    """Whether each sample tells where the tip is in all three directions."""
    first = term.blocks[0]
    return first.unit == "m" and first.size == len("xyz") and len(first) == len(term.poses)


def tip_residuals(
    terms: Sequence[Term],
    arm: ArmModel,
    values: Mapping[str, float],
    seed: int = 0,
) -> TipResiduals | None:
    """Errors of the terms over a chain that see the position of the tip; None without such terms.

    Args:
        terms: fitted or held out.
        arm: the chain, at nominal.
        values: of its parameters and the terms' own, SI.
        seed: of the choice among too many rows.
    """
    parts = []
    for term in terms:
        if not (over(term, arm) and sees_position(term)):
            continue
        _, displacement = tip_displacements(term, values)
        parts.append((term.poses.samples.q, -displacement, _places(term)))
    if not parts:
        return None
    q: FloatArray = np.vstack([part[0] for part in parts])
    error: FloatArray = np.vstack([part[1] for part in parts])
    first, time = 0, []
    for _, _, places in parts:
        time.append(first + places)
        first += int(places.max()) + 1
    place, stretches = np.concatenate(time), block_count(len(q))
    if not BLOCKS[0] <= first <= stretches:
        place = np.arange(len(q)) * stretches // len(q)
    size = np.linalg.norm(error, axis=1)
    # Robust levels of one component beyond which the error of a row is gross: of normal errors one
    # of 50,000 is.
    sound = size <= 5.0 * np.sqrt(3.0) * max(robust_level(error), 1e-12)
    rows = np.flatnonzero(sound)
    if len(rows) > MOST:
        rows = np.sort(np.random.default_rng(seed).permutation(rows)[:MOST])
    q, error, place = q[rows], error[rows], place[rows]
    jacobian = tip_derivative(arm, values, q)
    gross = int(np.count_nonzero(~sound))
    return TipResiduals(q[:, own_columns(arm)], jacobian, error, place, gross)


def block_count(rows: int) -> int:
    """How many blocks so many rows are left out in."""
    return int(np.clip(rows // 5, *BLOCKS))


def fitted_residuals(
    terms: Sequence[Term],
    arm: ArmModel,
    values: Mapping[str, float],
    seed: int = 0,
    file: Path | None = None,
) -> TipResiduals:
    """The same of fitted terms.

    Raises:
        SamplesError: no term sees the position of the tip, or too few rows.
    """
    residuals = tip_residuals(terms, arm, values, seed)
    if residuals is None:
        kinds = ", ".join(dict.fromkeys(term.kind for term in terms))
        raise SamplesError(
            f"no observation that gives the position of the tip in all directions ({kinds})",
            "an instrument that measures the tip, or touches of certified or fixed points",
            file=file,
            where="observations",
            hint="a residual map needs the error of the tip as a vector",
        )
    # Fewer rows do not fill the blocks that are left out.
    fewest = 30
    if len(residuals) < fewest:
        raise SamplesError(
            f"{len(residuals)} rows with the position of the tip",
            f"at least {fewest}",
            file=file,
            where="observations",
            hint="with fewer rows, left-out blocks cannot prove that a residual map is right; "
            "measure more postures",
        )
    return residuals


def _places(term: Term) -> IntArray:
    """(n,) numbers of the places where rows were met; one where there are none."""
    labels = term.poses.samples.labels
    if term.place in labels:
        return grouped(labels[term.place])[1]
    return np.zeros(len(term.poses), dtype=np.intp)
