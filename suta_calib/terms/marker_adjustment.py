"""All pictures of some markers adjusted together, and which marker moved meanwhile.

Triggs et al. 2000, Bundle adjustment, doi:10.1007/3-540-44480-7_21: normal equations about a layout
of markers and pictures, each picture's pose eliminated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.lens_slopes import pixel_slopes
from suta_calib.geometry.numbers import rotation_from_vector, skew
from suta_calib.measurements import Camera
from suta_calib.terms.camera_start import poses_in_camera
from suta_calib.terms.hand_eye_start import Poses

# Numbers of a marker's pose and size.
WAYS: Final = 7


@dataclass(frozen=True, eq=False)
class Node:
    """What is rigid beforehand: all markers that the file places, or one that it does not.

    Attributes:
        numbers: of its markers.
        placed: whether the file places them.
        points: (k, 3) corners, m; in edges of a marker of unknown place.
        pixels: (n, k, 2) in each picture.
    """

    numbers: tuple[int, ...]
    placed: bool
    points: FloatArray
    pixels: FloatArray

    def poses(self, camera: Camera) -> list[Poses]:
        """``T_eye_node`` in each picture, and the other one that a flat one may have."""
        R, p = poses_in_camera(self.points, self.pixels, camera)
        if np.ptp(self.points[:, 2]) > 0.0:
            return [(R, p)]
        ray = p / np.linalg.norm(p, axis=1, keepdims=True)
        about = 2.0 * ray[:, :, None] * ray[:, None, :] - np.eye(3)
        return [(R, p), (about @ R @ np.diag([-1.0, -1.0, 1.0]), p)]


@dataclass(frozen=True, eq=False)
class Pictures:
    """What a camera saw of all nodes.

    Attributes:
        camera: that took them.
        nodes: with their pixels in every picture.
        seen: (nodes, n) which of them are seen well enough in a picture to tell their pose.
    """

    camera: Camera
    nodes: Sequence[Node]
    seen: BoolArray

    @property
    def count(self) -> int:
        """How many pictures there are."""
        return int(self.seen.shape[1])


@dataclass(frozen=True, eq=False)
class Adjustment:
    """All pictures of some nodes, adjusted together; in units of the anchor's size, or metres.

    Attributes:
        pictures: of all nodes.
        nodes: their numbers there; the first one, `anchor`, stays.
        R, p, size: of each, by number.
        picture_turn, picture_p: (n, 3, 3), (n, 3) ``T_eye_anchor``; NaN of pictures without any.
        normal: sums of the derivatives over the corners of each picture (`_Normal`).
    """

    pictures: Pictures
    nodes: tuple[int, ...]
    R: Mapping[int, FloatArray]
    p: Mapping[int, FloatArray]
    size: Mapping[int, float]
    picture_turn: FloatArray
    picture_p: FloatArray
    normal: _Normal

    @property
    def anchor(self) -> int:
        """The node that stays where it is."""
        return self.nodes[0]

    @classmethod
    def of(
        cls,
        pictures: Pictures,
        part: Sequence[int],
        R: Mapping[int, FloatArray],
        p: Mapping[int, FloatArray],
        size: Mapping[int, float],
    ) -> Adjustment:
        """Levenberg and Marquardt from a start; corners far off pull no harder than others."""
        nodes = tuple(sorted(part))
        shown, at = _Layout.of(pictures, nodes, R, p, size)
        seen = _CornerTable.of(pictures, nodes, shown)
        normal = seen.normal(at)
        damping = 1e-3
        for _ in range(60):
            trial = at.moved(normal.step(damping))
            other = seen.normal(trial, normal.sigma)
            if other.cost < normal.cost_at(normal.sigma):
                gain = 1.0 - other.cost / normal.cost_at(normal.sigma)
                at, normal, damping = trial, seen.normal(trial), max(damping / 10.0, 1e-12)
                if gain < 1e-7:
                    break
            else:
                damping *= 10.0
                if damping > 1e8:
                    break
        index = {k: i for i, k in enumerate(nodes)}
        picture_turn = np.full((pictures.count, 3, 3), np.nan)
        picture_p = np.full((pictures.count, 3), np.nan)
        picture_turn[seen.pictures], picture_p[seen.pictures] = at.picture_turn, at.picture_p
        return cls(
            pictures,
            nodes,
            {k: at.R[i] for k, i in index.items()},
            {k: at.p[i] for k, i in index.items()},
            {k: float(at.size[i]) for k, i in index.items()},
            picture_turn,
            picture_p,
            normal,
        )

    def without(self, k: int) -> Adjustment:
        """The same without a node."""
        nodes = [other for other in self.nodes if other != k]
        # The frame is that of the first one that is left.
        R, p = self.R[nodes[0]], self.p[nodes[0]]
        turns = {other: R.T @ self.R[other] for other in nodes}
        places = {other: R.T @ (self.p[other] - p) for other in nodes}
        return Adjustment.of(self.pictures, nodes, turns, places, self.size)

    def moved(self) -> tuple[int, int, float, float] | None:
        """The node that moved while pictures were taken, from which picture on, and how far.

        A displacement, as a part of its size, and a turn, rad.

        By the test of added variables: six more numbers for its pose from some picture on. None
        where chance explains what the best of them gains.
        """
        normal = self.normal
        rows = np.flatnonzero(np.isfinite(self.picture_p[:, 0]))
        # What the file places is the frame, and stays.
        fixed = int(self.pictures.nodes[self.anchor].placed)
        full = normal.reduced.sum(axis=0)
        free = normal.free
        inverse = np.linalg.pinv(full[np.ix_(free, free)], 1e-12, hermitian=True)
        best: tuple[float, int, int, FloatArray] = (0.0, -1, -1, np.zeros(6))
        after, pull = np.zeros_like(full), np.zeros(len(full))
        tests = 0
        there = np.array([[self.pictures.seen[k, row] for k in self.nodes] for row in rows])
        for i in range(len(rows) - 1, 0, -1):
            after, pull = after + normal.reduced[i], pull + normal.gradient[i]
            for j in range(fixed, len(self.nodes)):
                if not there[i, j] or there[i:, j].sum() < 2 or there[:i, j].sum() < 2:
                    continue
                tests += 1
                mine = slice(WAYS * j, WAYS * j + 6)
                across = after[mine][:, free]
                inner = after[mine, mine] - across @ inverse @ across.T
                step = -np.linalg.pinv(inner, 1e-9, hermitian=True) @ pull[mine]
                gain = float(-step @ pull[mine])
                if gain > best[0]:
                    best = gain, j, i, step
        gain, j, i, step = best
        freedom = normal.count - len(free) - 6 * len(rows) - 6
        if not tests or freedom < 1:
            return None
        left = max(normal.squares - gain, 1e-9 * normal.count)
        # Chance of one of all tests, as often as of a picture that is taken for an outlier; and
        # what is smaller than a twentieth of a size is a bent wall, no marker that moved.
        if tests * float(fdtrc(6, freedom, gain / 6 / (left / freedom))) > 1e-6:
            return None
        if gain < 0.05 * normal.squares:
            return None
        shift = float(np.linalg.norm(step[:3])) / self.size[self.nodes[j]]
        return self.nodes[j], int(rows[i]), shift, float(np.linalg.norm(step[3:]))


@dataclass(frozen=True, eq=False)
class _Layout:
    """Where nodes (m) and pictures (n) are, and how large the nodes are."""

    R: FloatArray
    p: FloatArray
    size: FloatArray
    picture_turn: FloatArray
    picture_p: FloatArray

    @classmethod
    def of(
        cls,
        pictures: Pictures,
        nodes: Sequence[int],
        R: Mapping[int, FloatArray],
        p: Mapping[int, FloatArray],
        size: Mapping[int, float],
    ) -> tuple[BoolArray, _Layout]:
        """Nodes as they are, and each picture by all of its corners; which pictures tell it.

        A picture that has corners behind the camera in the pose that fits it best tells none.
        """
        points = np.concatenate([size[k] * pictures.nodes[k].points @ R[k].T + p[k] for k in nodes])
        pixels = np.concatenate([pictures.nodes[k].pixels for k in nodes], axis=1)
        turn, place = poses_in_camera(points, pixels, pictures.camera)
        there = np.isfinite(pixels).all(axis=2)
        in_eye = np.einsum("nij,kj->nki", turn, points) + place[:, None]
        posed = np.isfinite(place[:, 0])
        ahead = pictures.camera.lens.ahead(np.where(posed[:, None, None], in_eye, 0.0), 1e-9)
        shown = posed & np.asarray((ahead | ~there).all(axis=1))
        layout = cls(
            np.array([R[k] for k in nodes]),
            np.array([p[k] for k in nodes]),
            np.array([size[k] for k in nodes]),
            turn[shown],
            place[shown],
        )
        return shown, layout

    def moved(self, step: tuple[FloatArray, FloatArray]) -> _Layout:
        """After a step of pictures (n, 6) and nodes (m, 7): position, turn, logarithm of size."""
        of_pictures, of_nodes = step
        return _Layout(
            rotation_from_vector(of_nodes[:, 3:6]) @ self.R,
            self.p + of_nodes[:, :3],
            self.size * np.exp(np.clip(of_nodes[:, 6], -0.5, 0.5)),
            rotation_from_vector(of_pictures[:, 3:]) @ self.picture_turn,
            self.picture_p + of_pictures[:, :3],
        )


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations about a layout.

    Attributes:
        reduced: (n, 7m, 7m) of the nodes, each picture's pose eliminated.
        gradient: (n, 7m) likewise.
        by_picture: (n, 6, 6), (n, 6, 7m) and (n, 6): of each picture's own pose.
        free: which of the 7m are estimated.
        length: (k,) of the errors of the corners, px.
        sigma: of a component, px.
        count: of numbers.
    """

    whole: FloatArray
    pull: FloatArray
    by_picture: tuple[FloatArray, FloatArray, FloatArray]
    free: IntArray
    length: FloatArray
    sigma: float

    @property
    def count(self) -> int:
        return 2 * len(self.length)

    @property
    def squares(self) -> float:
        return float(np.sum(self._weight(self.sigma) * self.length**2))

    def _weight(self, sigma: float) -> FloatArray:
        weight = np.minimum(1.0, 3.0 * sigma / np.maximum(self.length, 1e-12)) / sigma**2
        return np.asarray(weight)

    @property
    def cost(self) -> float:
        """Huber's, at its sigma."""
        return self.cost_at(self.sigma)

    def cost_at(self, sigma: float) -> float:
        """Huber's, of a sigma."""
        scaled = self.length / sigma
        return float(np.sum(np.where(scaled < 3.0, scaled**2, 6.0 * scaled - 9.0)))

    @cached_property
    def _solved(self) -> tuple[FloatArray, FloatArray]:
        pp, pm, pr = self.by_picture
        both = np.concatenate([pm, pr[:, :, None]], axis=2)
        solved = np.linalg.solve(
            pp + 1e-12 * np.eye(6) * np.trace(pp, axis1=1, axis2=2)[:, None, None], both
        )
        return solved[:, :, :-1], solved[:, :, -1]

    @cached_property
    def reduced(self) -> FloatArray:
        return np.asarray(self.whole - np.swapaxes(self.by_picture[1], 1, 2) @ self._solved[0])

    @cached_property
    def gradient(self) -> FloatArray:
        return np.asarray(self.pull - np.einsum("nij,ni->nj", self.by_picture[1], self._solved[1]))

    def step(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """Of pictures (n, 6) and nodes (m, 7)."""
        pp, pm, pr = self.by_picture
        damped = pp + damping * np.einsum("nii->ni", pp)[:, :, None] * np.eye(6)
        both = np.linalg.solve(damped, np.concatenate([pm, pr[:, :, None]], axis=2))
        by_nodes, alone = both[:, :, :-1], both[:, :, -1]
        whole = self.whole.sum(axis=0)
        curvature = whole + damping * np.diag(np.diag(whole))
        curvature -= np.einsum("nij,nik->jk", pm, by_nodes)
        slope = self.pull.sum(axis=0) - np.einsum("nij,ni->j", pm, alone)
        nodes = np.zeros(len(slope))
        f = self.free
        if len(f):
            unit = 1.0 / np.sqrt(np.maximum(np.diag(curvature)[f], 1e-300))
            scaled = curvature[np.ix_(f, f)] * np.outer(unit, unit)
            nodes[f] = -unit * np.linalg.lstsq(scaled, unit * slope[f], rcond=1e-12)[0]
        pictures = -(alone + by_nodes @ nodes)
        return pictures, nodes.reshape(-1, WAYS)


@dataclass(frozen=True, eq=False)
class _CornerTable:
    """Corners of some nodes: picture and node of each, its place there, and its pixel."""

    camera: Camera
    pictures: BoolArray
    picture: IntArray
    node: IntArray
    local: FloatArray
    pixel: FloatArray
    sizes_free: BoolArray

    @classmethod
    def of(cls, pictures: Pictures, nodes: Sequence[int], shown: BoolArray) -> _CornerTable:
        """Of some of the pictures (n,)."""
        number = np.cumsum(shown) - 1
        parts = []
        for i, k in enumerate(nodes):
            there = np.isfinite(pictures.nodes[k].pixels).all(axis=2) & shown[:, None]
            picture, point = np.nonzero(there)
            parts.append(
                (
                    number[picture],
                    np.full(len(picture), i),
                    pictures.nodes[k].points[point],
                    pictures.nodes[k].pixels[picture, point],
                )
            )
        picture, node, local, pixel = (np.concatenate(part) for part in zip(*parts, strict=True))
        free = np.ones((len(nodes), WAYS), dtype=np.bool_)
        free[0] = False
        return cls(pictures.camera, shown, picture, node, local, pixel, free.ravel())

    def normal(self, at: _Layout, sigma: float | None = None) -> _Normal:
        """The equations about a layout, weighed by the corners' scatter, or by a given one."""
        n, m = len(at.picture_p), len(at.p)
        edge = at.size[self.node, None] * np.einsum("kij,kj->ki", at.R[self.node], self.local)
        turned = np.einsum("kij,kj->ki", at.picture_turn[self.picture], edge + at.p[self.node])
        points = turned + at.picture_p[self.picture]
        ahead = self.camera.lens.ahead(points, 1e-9)
        points = np.where(ahead[:, None], points, [0.0, 0.0, 1.0])
        error = self.camera.project(points) - self.pixel
        error[~ahead] = 1e4
        length = np.linalg.norm(error, axis=1)
        scatter = max(float(np.median(length)) / 1.177, 1e-3)
        result_sigma = scatter if sigma is None else sigma
        weight = np.minimum(1.0, 3.0 * result_sigma / np.maximum(length, 1e-12)) / result_sigma**2
        weight = np.where(ahead, weight, 0.0)
        by_place, _ = pixel_slopes(self.camera.lens, points, self.camera.intrinsics)
        P = np.concatenate([by_place, -by_place @ skew(turned)], axis=2)
        G = by_place @ at.picture_turn[self.picture]
        M = np.concatenate([G, -G @ skew(edge), (G @ edge[:, :, None])], axis=2)
        wP, wM = weight[:, None, None] * P, weight[:, None, None] * M
        pp, pr = np.zeros((n, 6, 6)), np.zeros((n, 6))
        np.add.at(pp, self.picture, np.swapaxes(P, 1, 2) @ wP)
        np.add.at(pr, self.picture, np.einsum("kdc,kd->kc", wP, error))
        pm, whole = np.zeros((n, m, 6, WAYS)), np.zeros((n, m, WAYS, WAYS))
        pull = np.zeros((n, m, WAYS))
        where = self.picture, self.node
        np.add.at(pm, where, np.swapaxes(P, 1, 2) @ wM)
        np.add.at(whole, where, np.swapaxes(M, 1, 2) @ wM)
        np.add.at(pull, where, np.einsum("kdc,kd->kc", wM, error))
        blocks = np.zeros((n, m, WAYS, m, WAYS))
        every = np.arange(m)
        blocks[:, every, :, every] = np.swapaxes(whole, 0, 1)
        return _Normal(
            blocks.reshape(n, m * WAYS, m * WAYS),
            pull.reshape(n, -1),
            (pp, np.moveaxis(pm, 2, 1).reshape(n, 6, -1), pr),
            np.flatnonzero(self.sizes_free),
            length,
            result_sigma,
        )
