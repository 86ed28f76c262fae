"""Boards that look the same after half a turn: which pictures are numbered from the other end."""

from __future__ import annotations

import numpy as np
import pytest
from camera_scenes import X, Z

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.terms.board_pictures import COMPARED, half_turned

HALF_TURN = np.diag([-1.0, -1.0, 1.0])


def turns(n: int, noise: float, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Rotations (n, 3, 3) of hands all over the place, and of the board in the eye on them."""
    random = np.random.default_rng(seed)
    hand = rotation_from_vector(random.uniform(-1.5, 1.5, (n, 3)))
    seen = np.swapaxes(hand @ X[0], 1, 2) @ Z[0]
    return hand, seen @ rotation_from_vector(noise * random.standard_normal((n, 3)))


@pytest.mark.parametrize(("count", "wrong"), [(5, 0), (30, 4), (COMPARED + 50, 40)])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.5])
def test_the_fewer_are_found(count: int, wrong: int, share: float) -> None:
    """Also where some poses of the hand are anything, and the others off by a degree."""
    random = np.random.default_rng(1)
    hand, seen = turns(count, 0.02)
    flipped = np.arange(count) < share * count
    seen[flipped] = seen[flipped] @ HALF_TURN
    strange = random.choice(count, wrong, replace=False)
    hand[strange] = rotation_from_vector(random.uniform(-2, 2, (wrong, 3)))
    found = half_turned(hand, seen, seen @ HALF_TURN)
    fine = ~np.isin(np.arange(count), strange)
    if 2 * found.sum() == count or share == 0.5:
        # Either half may be the one that is turned.
        found = found ^ (found[fine][0] != flipped[fine][0])
    assert np.array_equal(found[fine], flipped[fine])


def test_what_moves_otherwise_is_left_alone() -> None:
    hand, seen = turns(30, 0.0)
    other, _ = turns(30, 0.0, seed=1)
    assert not half_turned(other, seen, seen @ HALF_TURN).any()
    assert not half_turned(hand[:1], seen[:1], seen[:1]).any()
