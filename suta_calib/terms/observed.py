"""Ideal readings of an instrument, and their simulation with noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.measurements.camera import Camera
from suta_calib.model.parameters import End
from suta_calib.terms.poses import PoseSource


@dataclass(frozen=True)
class TrueFrame:
    """A frame that a simulation of a kind may state, in place of the unknown that it is.

    Attributes:
        owner: the unknowns, ``own.x … own.rz``.
        key: of the simulation's file: what it is, ``_in_``, and in whose frame.
        about: what it is, in words.
        required: whether a simulation must state it; the frames coincide by default.
        seen_from: whether it is the pose of what stands still in what sees it, not of what sees in
            what carries it.
    """

    owner: str
    key: str
    about: str
    required: bool
    seen_from: bool = False

    @property
    def end(self) -> End:
        """Which end of the chain it moves with."""
        return "tip" if self.key.endswith("_in_tip") else "base"


@dataclass(frozen=True, eq=False)
class Observed(Displayable):
    """The ideal reading of an instrument, or the ideal position of a touching tip.

    Attributes:
        position: (n, 3), m: of what is seen, in the instrument or the camera; of a tip that
            touches, in the base. None for an instrument that sees no position.
        rotation: (n, 3, 3) of the same, or None where the observation says nothing of it.
        pixels: (n, points, 2) where a camera sees the points of a board, px, NaN for those that it
            does not; None for who sees no points. What is seen is then these.
        camera: in whose picture they are.
        numbers: what is measured beside these, by name of `SampleColumns.numbers`, (n,) in SI.
        axes: (n, 3, 3) whose columns are directions in which the position scatters by itself; None
            for the axes of its frame.
        sigma: (n, 3) by how much, m, where the kind says it; None where it scatters as whoever
            simulates has it.
        sighted: (n,) whether a position is in sight; None where all are.
    """

    position: FloatArray | None = None
    rotation: FloatArray | None = None
    pixels: FloatArray | None = None
    camera: Camera | None = None
    numbers: Mapping[str, FloatArray] = field(default_factory=dict)
    axes: FloatArray | None = None
    sigma: FloatArray | None = None
    sighted: BoolArray | None = None

    def scattered(self, noise: FloatArray) -> FloatArray:
        """`place` with noise (n, 3), m, of the directions in which it scatters."""
        off = noise if self.axes is None else np.einsum("nij,nj->ni", self.axes, noise)
        return np.asarray(self.place + off)

    @property
    def place(self) -> FloatArray:
        """`position` of who has one: of what touches, and of what is seen somewhere."""
        assert self.position is not None
        return self.position

    @property
    def in_sight(self) -> BoolArray:
        """(n,) whether something is seen: of a board, half of its points."""
        if self.sighted is not None:
            return self.sighted
        if self.pixels is None:
            parts = (self.position, self.rotation, *self.numbers.values())
            return np.ones(next(len(p) for p in parts if p is not None), dtype=np.bool_)
        return np.asarray(np.isfinite(self.pixels[..., 0]).mean(axis=1) >= 0.5)


class Resimulation(Protocol):
    """A measurement repeated in simulation: how an arm reaches its targets, and how that scatters.

    A term knows where its touches should have been, or what its instrument should have seen; the
    rest is the resimulation's: `analysis.study.trial` has one.
    """

    def touched(self, poses: PoseSource, target: FloatArray, sigma: float) -> PoseSource:
        """Poses near the given ones, the tip at the targets (n, 3), m, plus noise of each axis."""

    def observed(
        self, poses: PoseSource, ideal: Observed, noise: Mapping[str, float], relative: FloatArray
    ) -> PoseSource:
        """The same poses with what an instrument ideally sees in their samples, plus noise.

        Standard deviations are of a coordinate of the ``position``, m, of a component of the turn
        of the ``rotation``, rad, of ``pixels``, px, and of each number by its name; ``relative`` is
        a factor on that of the position, of each coordinate (n, 3), or of all (1, 1).
        """

    def turned(self, rotation: FloatArray, sigma: float) -> FloatArray:
        """Rotations (n, 3, 3), each turned by noise of ``sigma`` rad about every axis."""
