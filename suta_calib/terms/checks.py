"""Checks that several kinds share."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from suta_calib.arrays import FloatArray
from suta_calib.model.lengths import other_lengths
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import Term
from suta_calib.units import mm

# Extents of what was seen or touched and of what the arm moved that differ by more are in different
# units: no geometry is so wrong.
OTHER_UNIT: Final = 20.0


def check_unit(
    term: Term,
    what: str,
    size: float,
    extent: Callable[[FloatArray], float],
    expected: str,
    hint: str,
) -> None:
    """Refuse lengths in another unit than the arm's; no solver could fit them.

    Where one length of the arm in another unit would explain it, and no other length would, that
    one is named. The size is the root mean square distance, m, of what was seen or touched from its
    middle, ``extent`` that of tips (n, 3). The hint says which columns or key have the unit.
    """
    moved = extent(term.poses.nominal_tips)
    # A tip that moves by less, m, lies on the axes that were turned about, if anything moved.
    if moved < 1e-7:
        raise term.refuse(
            f"readings that move the tip by only {mm(moved):.2g} mm",
            "different readings, and a tip that is not on the axes of the joints",
        )
    if not moved / OTHER_UNIT <= size <= moved * OTHER_UNIT:
        raise term.refuse(
            f"{what} that scatter by {mm(size):.4g} mm about their middle, where the arm's "
            f"readings move the tip by {mm(moved):.4g} mm",
            expected,
            hint=hint + (_or_a_length(term, size, extent) if 0.0 < size < moved else ""),
        )


def _or_a_length(term: Term, size: float, extent: Callable[[FloatArray], float]) -> str:
    """The length of the arm that is in another unit, as the end of a hint; empty for none.

    One that is too short leaves the arm's extent to all others, and lets nothing seem so large.
    """
    if not isinstance(term.poses, ArmPoses):
        return ""
    off = [
        (abs(math.log(extent(term.poses.at(length.values)[1]) / size)), length)
        for length in other_lengths(term.poses.arm)
    ]
    # Those of what is in the same unit, for all that is wrong of a drawn arm, differ by less.
    same_unit = 1.5
    fitting = [length for length in off if length[0] < math.log(same_unit)]
    if len({length.owner for _, length in fitting}) != 1:
        return ""
    return f" They would agree if {min(fitting, key=lambda length: length[0])[1].sentence}."
