"""Twists and screws: what no change of frames alters."""

from __future__ import annotations

import numpy as np
import pytest

from suta_calib.geometry.numbers import random_rotations, rotation_from_vector
from suta_calib.geometry.screws import motion_from_twist, screw_invariants, twist_from_motion


def test_a_motion_is_the_exponential_of_its_twist() -> None:
    rng = np.random.default_rng(0)
    R, p = random_rotations(rng, 200), rng.normal(size=(200, 3))
    again, position = motion_from_twist(twist_from_motion(R, p))
    assert np.abs(again - R).max() < 1e-12
    assert np.abs(position - p).max() < 1e-12


@pytest.mark.parametrize("angle", [0.0, 1e-9, 9.99e-4, 1.001e-3, 1.0, 3.14])
def test_small_and_large_turns(angle: float) -> None:
    """Half of a motion, twice, is the motion: no series breaks where it takes over."""
    rng = np.random.default_rng(0)
    axis = np.array([[0.6, 0.0, 0.8]])
    p = rng.normal(size=(1, 3))
    R = rotation_from_vector(angle * axis)
    half_R, half_p = motion_from_twist(0.5 * twist_from_motion(R, p))
    assert half_R @ half_R == pytest.approx(R, abs=1e-12)
    assert (half_R @ half_p[..., None])[..., 0] + half_p == pytest.approx(p, abs=1e-12)


def test_invariants_are_those_of_any_frame_and_of_the_way_back() -> None:
    rng = np.random.default_rng(0)
    R, p = random_rotations(rng, 50), rng.normal(size=(50, 3))
    Q, t = random_rotations(rng, 1)[0], rng.normal(size=3)
    found = screw_invariants(R, p)
    # C⁻¹ M C of a change of frames C.
    turned, moved = Q.T @ R @ Q, (R @ t + p - t) @ Q
    assert screw_invariants(turned, moved) == pytest.approx(found, abs=1e-12)
    back = np.swapaxes(R, 1, 2)
    inverse = screw_invariants(back, -(back @ p[..., None])[..., 0])
    assert inverse == pytest.approx(found, abs=1e-12)


def test_a_screw_about_an_axis() -> None:
    R = rotation_from_vector([[0.0, 0.0, 0.5]])
    assert screw_invariants(R, np.array([[7.0, -3.0, 0.2]])) == pytest.approx(
        np.array([[0.5, 0.1]])
    )
