"""The picture of a board by an ideal camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.measurements import Board, Camera
from suta_calib.terms.reprojection import NEAREST


@dataclass(frozen=True, eq=False)
class BoardSight:
    """A board in front of a camera, at ``T_eye_board`` (n, 3, 3), (n, 3), m, of every picture."""

    board: Board
    camera: Camera
    rotation: FloatArray
    position: FloatArray

    @cached_property
    def _on_board(self) -> FloatArray:
        return np.array(list(self.board.points.values()))

    @cached_property
    def points(self) -> FloatArray:
        """(n, points, 3) the board's points in the eye, m."""
        turned = np.einsum("nij,kj->nki", self.rotation, self._on_board)
        return np.asarray(turned + self.position[:, None])

    @property
    def everywhere(self) -> FloatArray:
        """(n, points, 2) pixels, whether they are in the picture or not."""
        points = self.points.copy()
        if not self.camera.lens.sees_behind:
            points[..., 2] = np.maximum(points[..., 2], NEAREST)
        return self.camera.project(points)

    @property
    def pixels(self) -> FloatArray:
        """(n, points, 2) where corners would be found; NaN for those that are out of sight."""
        ahead = self.camera.lens.ahead(self.points, NEAREST)
        safe = np.where(ahead[..., None], self.points, [0.0, 0.0, 1.0])
        pixels = self.camera.project(safe)
        # Distortion folds back into the picture what is far outside, which its pixel does not tell.
        off = self.camera.directions(pixels) - safe / np.linalg.norm(safe, axis=-1, keepdims=True)
        near = np.abs(off).max(axis=2) < 1e-3
        shown = ahead & self.camera.inside(pixels) & near & self._faces[:, None]
        return np.where(shown[..., None], pixels, np.nan)

    @property
    def _faces(self) -> BoolArray:
        """(n,) whether a flat board shows its face; one that is not flat always shows some."""
        if not self.board.flat:
            return np.ones(len(self.position), dtype=np.bool_)
        middle = self.position + self.rotation @ self._on_board.mean(axis=0)
        distance = np.maximum(np.linalg.norm(middle, axis=1), 1e-300)
        cosine = np.einsum("ni,ni->n", self.rotation[:, :, 2], middle) / distance * self.board.into
        # Cosine of the steepest angle at which a board is still found.
        grazing = 0.25
        return np.asarray(cosine > grazing)


@dataclass(frozen=True, eq=False)
class OnePoint(Board):
    """A board of one point, such as the middle of another.

    Attributes:
        place: (3,) of the point, m.
    """

    type: ClassVar[str] = "point"

    place: FloatArray

    @cached_property
    def points(self) -> Mapping[int, FloatArray]:
        """The point, as number 0."""
        return {0: self.place}

    def scaled(self, factor: float) -> Self:
        """The same, its point so many times as far."""
        return replace(self, place=factor * self.place)

    def row(self) -> dict[str, Any]:
        """What it would be in a board's file, which it never is."""
        return {"type": self.type}
