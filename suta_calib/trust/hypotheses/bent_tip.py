"""A tip that moves when its tool tilts: a shaft that bends, a ball that rolls."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.terms.fixed_point import FixedPoint
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.trust import AddedVariable, Effect, Evidence, Examination, SpoiltData, Truth
from suta_calib.units import deg, with_std

EVENLY: Final = "evenly"
TO_ONE_SIDE: Final = "to one side"


class BentTip(AddedVariable):
    """The tip is displaced across its shaft by a matrix times the tilt.

    With a the shaft, n the middle direction of all poses and θ the tilt between the two, the tip in
    the tool is ``t + K P Rᵀ n θ / sin θ``, where P leaves what is across a. Where K is the same to
    all sides, a tip farther along a takes up what is linear in θ, and what is left grows with θ²:
    `EVENLY` asks for that with one number. `TO_ONE_SIDE` asks for all four numbers of K.
    """

    name = "bent tip"
    about = "The tip is displaced more, the farther the tool tilts."
    applies_to = (FixedPoint,)
    needs_arm = False
    by_itself = True
    # A tip that bends evenly by 1.5 mm at 45° explains 4 % of the squared residuals of 120 poses
    # with 0.15 mm of noise, and is 10 times its ± off: a tip elsewhere takes up the rest
    # (simulated).
    worth = 0.01
    # The p-value decides: of four numbers at once each may be small.
    times_std = 2.0

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each way of bending, in m of displacement per rad of tilt."""
        tip = np.array([answer.solution.values[f"tip.{axis}"] for axis in "xyz"])
        if np.linalg.norm(tip) < 1e-6:
            return  # The tool's own origin: there is no shaft.
        evenly, to_sides, farthest = bending(answer.rotation, tip)
        for name, moves in ((EVENLY, evenly), (TO_ONE_SIDE, to_sides)):
            columns = answer.by_shift(answer.rotation @ moves / answer.length)
            yield Effect(name, columns, about=farthest)

    def sentence(self, evidence: Evidence) -> str:
        """Motion of the tip at the largest tilt, and possible causes."""
        tilt = evidence.effect.about
        size, std = displacement(evidence)
        way = {EVENLY: "the same to all sides", TO_ONE_SIDE: "more to one side"}
        return (
            f"The farther the tool tilts, the larger the error of the tip: "
            f"{with_std(size, std, 'm')} at {deg(tilt):.0f}°, {way[evidence.effect.name]}. "
            "Check whether the tool bends, whether a ball rolls or slips in its seat, and whether "
            "the tracker's rotations are wrong. The estimated tip absorbs a part of this error, "
            "and ± includes it."
        )

    def spoil(self, data: FixedPoint, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """A tip that bends by 2 mm per rad to one side of the tool, and not to the other."""
        poses = data.poses
        assert isinstance(poses, MeasuredPoses)
        tip = np.array([values[f"tip.{axis}"] for axis in "xyz"])
        _, to_sides, _ = bending(poses.rotation, tip)
        side = rng.uniform(-np.pi, np.pi)
        along = np.array([np.cos(side), np.sin(side)])
        size = 2e-3 * np.outer(along, along).ravel()
        off = np.einsum("nij,njk,k->ni", poses.rotation, to_sides, size)
        moved = MeasuredPoses(poses.rotation, poses.position - off, poses.samples)
        return SpoiltData(data.over_poses(moved), size, TO_ONE_SIDE)


def displacement(evidence: Evidence) -> tuple[float, float]:
    """How far the tip is displaced at the largest tilt, and its standard deviation, m."""
    tilt = evidence.effect.about
    length, std = evidence.length()
    return tilt * length, tilt * std


def bending(rotation: FloatArray, tip: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """How the tip is displaced in the tool, per rad of tilt, and the largest tilt, rad.

    Evenly (n, 3, 1), and to sides (n, 3, 4), by rotations (n, 3, 3) of a shaft along the tip (3,).
    """
    shaft = tip / np.linalg.norm(tip)
    middle = (rotation @ shaft).mean(axis=0)
    middle /= max(float(np.linalg.norm(middle)), 1e-300)
    direction = np.einsum("nij,i->nj", rotation, middle)
    cosine = np.clip(direction @ shaft, -1.0, 1.0)
    tilt = np.arccos(cosine)
    across = direction - cosine[:, None] * shaft
    across *= (tilt / np.maximum(np.sin(tilt), 1e-9))[:, None]
    sides = np.linalg.svd(shaft[None])[2][1:]
    to_sides = np.einsum("ia,nb->niab", sides.T, across @ sides.T).reshape(-1, 3, 4)
    return across[..., None], to_sides, float(tilt.max())
