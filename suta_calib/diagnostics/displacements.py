"""How far the tip is off in every sample, as a vector in the base: what a picture shows.

A residual is a distance, pixels, or a vector in somebody else's frame. What all kinds share is the
tip: it is displaced by that much from where it should be.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.diagnostics.accuracy import block_residuals
from suta_calib.model.parameters import ParameterSet
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.terms.term import Term


def tip_displacements(term: Term, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Where the tip should have been, and how far off it is.

    Of a tip that touches, where it should have been is what the kind says (`Term.observed`). What
    an instrument or a camera sees is off by the least displacement d of the tip that explains the
    residual r best, of the least squares ‖r − ∂r/∂p · d‖.

    Args:
        term: whose samples are looked at.
        values: of the arm's parameters and the term's own, SI.

    Returns:
        Positions (n, 3) where the tip should have been and displacements (n, 3) from there, m, in
        the base.
    """
    # For differences of residuals, m: far above rounding, far below anything that is not linear.
    step = 1e-5
    rotation, position = term.poses.at(values)
    if term.medium == "touch":
        target = term.observed(values, term.poses).place
        return target, position - target
    block = term.blocks[0]

    def residual(shift: FloatArray) -> FloatArray:
        moved = MeasuredPoses(rotation, position + shift, term.poses.samples)
        return block_residuals([term.over_poses(moved)], ParameterSet(), values)[0]

    slopes = [(residual(d) - residual(-d)) / (2 * step) for d in step * np.eye(3)]
    by_place = np.stack(slopes, axis=-1)
    # Normal equations of all rows of a sample: of a board, every corner that was seen.
    curvature, gradient = np.zeros((len(position), 3, 3)), np.zeros((len(position), 3))
    rows = block.samples[:, 0]
    np.add.at(curvature, rows, np.einsum("nki,nkj->nij", by_place, by_place))
    np.add.at(gradient, rows, np.einsum("nki,nk->ni", by_place, residual(np.zeros(3))))
    # Relative curvature below which a direction of the tip is not seen at all.
    weak = np.linalg.pinv(curvature, rcond=1e-9, hermitian=True)
    displacement = np.einsum("nij,nj->ni", weak, gradient)
    return position - displacement, displacement
