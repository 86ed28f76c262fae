"""A measurement repeated in simulation: what a kind of observation is given to do so with.

A term knows where its touches should have been, or what its instrument should have seen. How an arm
reaches that, and how it scatters, is the rehearsal's: `analysis.study.resimulated` has one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.terms.poses import PoseSource


class Resimulation(Protocol):
    """Simulated touches, sightings and turns, with noise."""

    def touched(self, poses: PoseSource, target: FloatArray, sigma: float) -> PoseSource:
        """Poses near the given ones whose tip is at the targets (n, 3), m, plus noise.

        Args:
            poses: as they were measured.
            target: (n, 3) where the tip should have been, m, in the base frame.
            sigma: standard deviation of each coordinate, m.
        """

    def seen(
        self, poses: PoseSource, seen: tuple[FloatArray, FloatArray], noise: Sequence[float]
    ) -> PoseSource:
        """The same poses with what an instrument sees in their samples, plus noise.

        Args:
            poses: as they were measured.
            seen: rotations (n, 3, 3) and positions (n, 3), m, without noise.
            noise: standard deviation of a coordinate, m, and, where orientations are seen, of a
                component of their turn, rad.
        """

    def turned(self, rotation: FloatArray, sigma: float) -> FloatArray:
        """Rotations (n, 3, 3), each turned by noise of ``sigma`` rad about every axis."""


def pose_named(values: Mapping[str, float], label: str) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and position (3,), m, of the unknowns ``label.x … label.rz``."""
    six = np.array([values[f"{label}.{key}"] for key in ("x", "y", "z", "rx", "ry", "rz")])
    return rotation_from_vector(six[3:]), six[:3]
