"""Reprojection errors of a camera's pictures at some values of its unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.special import chdtri

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.pose_calibration.picture_likelihood import DIRECTIONS, WAYS
from suta_calib.pose_calibration.picture_rows import FINEST
from suta_calib.solver.problem import Problem
from suta_calib.terms import CameraView

# Norm of two unit normal components that half of them exceed.
_MIDDLE: Final = float(np.sqrt(chdtri(2, 0.5)))


@dataclass(frozen=True, eq=False)
class PictureErrors:
    """One linearisation, and what is asked of it.

    Attributes:
        residual: (m, 2) of every corner, px.
        picture: (m,) that it is in.
        by_pose: (m, 2, 6) derivative by the hand's pose, px per m and rad.
        count: of pictures.
    """

    residual: FloatArray
    picture: IntArray
    by_pose: FloatArray
    count: int

    @cached_property
    def rms(self) -> FloatArray:
        """(count,) root mean square error of the corners of each picture, px."""
        squared = np.sum(self.residual**2, axis=1)
        corners = np.bincount(self.picture, minlength=self.count)
        return np.asarray(np.sqrt(np.bincount(self.picture, squared, self.count) / corners))

    @cached_property
    def by_hand(self) -> FloatArray:
        """(count, 2) by how much each picture has the hand off, to first order: m and rad."""
        displacement = np.zeros((self.count, 2))
        for k in np.unique(self.picture):
            mine = self.picture == k
            residual = self.residual[mine].ravel()
            matrix = self.by_pose[mine].reshape(len(residual), WAYS)
            pose = np.linalg.lstsq(matrix, residual, rcond=None)[0]
            displacement[k] = np.linalg.norm(pose.reshape(2, DIRECTIONS), axis=1)
        return displacement

    def scatter(self, good: BoolArray) -> float:
        """Of one component, px, by the middle one of the errors in pictures that are believed."""
        middle = float(np.median(np.linalg.norm(self.residual[good[self.picture]], axis=1)))
        return max(middle / _MIDDLE, FINEST)

    def alone(self, good: BoolArray) -> float:
        """RMS, px, that is left where every picture may have a pose of its own, to first order."""
        left, freedom = 0.0, 0
        for k in np.flatnonzero(good):
            mine = self.picture == k
            residual = self.residual[mine].ravel()
            matrix = self.by_pose[mine].reshape(len(residual), WAYS)
            rest = residual - matrix @ np.linalg.lstsq(matrix, residual, rcond=None)[0]
            left += float(rest @ rest)
            freedom += max(len(residual) - WAYS, 0)
        return float(np.sqrt(2.0 * left / freedom)) if freedom else float("nan")


def picture_errors(term: CameraView, values: Mapping[str, float]) -> PictureErrors:
    """Of all pictures, whether they were fitted or not, at parameter values by name."""
    problem = Problem([term])
    x = np.array([values[name] for name in problem.names])
    (line,) = problem.linearise(x, problem.assumed_sigmas())
    return PictureErrors(
        line.residual / term.pixel,
        term.blocks[0].samples[:, 0],
        # The pose may be any: all six ways show in every corner.
        line.by_pose / term.pixel,
        len(term.poses),
    )
