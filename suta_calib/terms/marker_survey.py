"""Where markers of unknown places are, by pictures of them: the start, and what is wrong with them.

Each picture tells the pose of each marker in it, in units of the marker's edge: two of them, for a
marker that is far away (the one with its normal turned to the other side of the ray). Pairs of
markers that are in several pictures together say which of the two is true, and how large one is
against the other. From the first marker they are placed one after the other; all pictures are then
adjusted together (`marker_adjustment`), with sizes that are free but for the first one. The hand's
motions give the scale, and the place of what is in no picture together with the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import nearest_rotation
from suta_calib.measurements import Camera, Corners
from suta_calib.measurements.board import CORNERS, Marker, Markers
from suta_calib.terms.hand_eye_start import (
    FEWEST,
    Poses,
    agreeing_hand_eye,
    loop_closures,
    motion_scale,
    some_poses,
)
from suta_calib.terms.marker_adjustment import Adjustment, Node, Pictures
from suta_calib.terms.surveyed_markers import SurveyedMarkers
from suta_calib.units import deg, mm
from suta_calib.words import listed

# Rotation and position of one node in another, its size there, and in how many pictures.
_Edge = tuple[FloatArray, FloatArray, float, int]
_Edges = Mapping[tuple[int, int], _Edge]


def surveyed(
    board: Markers,
    corners: Corners,
    camera: Camera,
    hand: Mapping[str, Poses],
    *,
    exact_hand: bool = True,
) -> SurveyedMarkers:
    """A board whose unknown places are those that pictures show; markers that they leave open go.

    Args:
        board: with markers of unknown places.
        corners: of pictures.
        camera: that took them.
        hand: A of ``A X B = Z`` by picture.
        exact_hand: whether the hand was measured; otherwise it moves as an arm does that is not
            calibrated yet, and stated sizes give the scale.

    Raises:
        SamplesError: pictures that do not tell where the markers are.
    """
    return _Survey(board, corners, camera, hand, exact_hand).board


class _Survey:
    """The steps, one after the other."""

    def __init__(
        self,
        board: Markers,
        corners: Corners,
        camera: Camera,
        hand: Mapping[str, Poses],
        exact_hand: bool = True,
    ) -> None:
        self.sought, self.camera, self.exact_hand = board, camera, exact_hand
        self.images = [name for name in corners.images if name in hand]
        self.hand = (
            np.array([hand[name][0] for name in self.images]).reshape(-1, 3, 3),
            np.array([hand[name][1] for name in self.images]).reshape(-1, 3),
        )
        self.notes: list[str] = []
        self.nodes = self._nodes(corners)
        self.candidates = [node.poses(camera) for node in self.nodes]
        self.seen = np.array([np.isfinite(c[0][1][:, 0]) for c in self.candidates])

    def _nodes(self, corners: Corners) -> list[Node]:
        row = {name: k for k, name in enumerate(self.images)}
        every = {CORNERS * n + k: (n, k) for n in self.sought.markers for k in range(CORNERS)}
        pixels = {n: np.full((len(row), CORNERS, 2), np.nan) for n in self.sought.markers}
        for image, point, pixel in zip(
            corners.image.tolist(), corners.point.tolist(), corners.pixel, strict=True
        ):
            if image in row:
                number, k = every[point]
                pixels[number][row[image], k] = pixel
        placed = [n for n, m in self.sought.markers.items() if m.placed]
        nodes = []
        if placed:
            points = np.concatenate([self.sought.markers[n].corners for n in placed])
            together = np.concatenate([pixels[n] for n in placed], axis=1)
            nodes.append(Node(tuple(placed), True, points, together))
        unit = Marker(np.zeros(3), 1.0).corners
        nodes += [Node((n,), False, unit, pixels[n]) for n in self.sought.unplaced]
        return [node for node in nodes if np.isfinite(node.pixels).any()]

    @cached_property
    def board(self) -> SurveyedMarkers:
        """The answer."""
        never = [
            n for n in self.sought.unplaced if not any(n in node.numbers for node in self.nodes)
        ]
        once = [
            node.numbers[0]
            for node, seen in zip(self.nodes, self.seen, strict=True)
            if not node.placed and seen.sum() < 2
        ]
        self._say(never, "no picture")
        self._say(once, "one picture only")
        usable = [k for k, node in enumerate(self.nodes) if node.numbers[0] not in once]
        if not usable:
            raise SamplesError(
                "no marker in two pictures or more",
                "pictures with several markers, from several directions",
                where="corners",
            )
        edges = self._edges(usable)
        parts = _parts(usable, edges)
        first = self._first(parts)
        R, p, size = self._placed(first, edges)
        pictures = Pictures(self.camera, self.nodes, self.seen)
        adjusted = Adjustment.of(pictures, first, R, p, size)
        adjusted = self._without_moved(adjusted)
        return self._scaled(adjusted, [k for k in usable if k not in first])

    def _say(self, numbers: Sequence[int], where: str) -> None:
        if numbers:
            one = len(numbers) == 1
            self.notes.append(
                f"Marker{'' if one else 's'} {listed([str(n) for n in numbers])} "
                f"{'is' if one else 'are'} in {where}, which does not determine "
                f"{'its place' if one else 'their places'}. Take two pictures or more of each, "
                "together with another marker."
            )

    def _first(self, parts: Sequence[list[int]]) -> list[int]:
        """The markers that are seen together: those about what the file places, or the most."""
        if self.nodes[0].placed:
            return next(part for part in parts if 0 in part)
        return max(parts, key=len)

    def _edges(self, usable: Sequence[int]) -> dict[tuple[int, int], _Edge]:
        """By pair of nodes: rotation and position of the second in the first, and its size.

        In edges of the first one. Pairs of which no two pictures agree are in none.
        """
        edges = {}
        for a in usable:
            for b in usable:
                if a < b and (both := np.flatnonzero(self.seen[a] & self.seen[b])).size >= 2:
                    edge = self._edge(a, b, both)
                    if edge is not None:
                        edges[a, b] = edge
        return edges

    def _edge(self, a: int, b: int, rows: IntArray) -> _Edge | None:
        of_a = [some_poses(pose, rows) for pose in self.candidates[a]]
        of_b = [some_poses(pose, rows) for pose in self.candidates[b]]
        ways = [(i, j) for i in range(len(of_a)) for j in range(len(of_b))]
        turns = np.array([np.swapaxes(of_a[i][0], 1, 2) @ of_b[j][0] for i, j in ways])
        every = turns.reshape(-1, 3, 3)
        # Each picture's nearest way from each candidate, an outlier counting no more than 0.3 rad.
        off = np.linalg.norm(every[:, None, None] - turns[None], axis=(-2, -1)) / np.sqrt(2.0)
        least = np.minimum(off.min(axis=1), 0.3)
        best = int(np.argmin(least.sum(axis=1)))
        way = off[best].argmin(axis=0)
        agreeing = off[best].min(axis=0) < 0.3
        if agreeing.sum() < 2:
            return None
        chosen, count = way[agreeing], np.flatnonzero(agreeing)
        turn = nearest_rotation(turns[chosen, count].sum(axis=0))
        R_a = np.array([of_a[ways[w][0]][0][k] for w, k in zip(chosen, count, strict=True)])
        t_a, t_b = of_a[0][1][count], of_b[0][1][count]
        # R_aᵀ (ρ t_b - t_a) is the same in all pictures: ρ is b's size in a's.
        from_a, to_b = (np.einsum("nji,nj->ni", R_a, t) for t in (t_a, t_b))
        known = self._ratio(a, b)
        weight = np.ones(len(count))
        ratio, place = 1.0, np.zeros(3)
        for _ in range(10):
            if known is None:
                w = weight[:, None] / weight.sum()
                x, y = to_b - (w * to_b).sum(axis=0), from_a - (w * from_a).sum(axis=0)
                power = float(np.sum(w * x * x))
                if power <= 1e-4 * float(np.mean(to_b**2)):
                    return None
                ratio = float(np.sum(w * x * y)) / power
            else:
                ratio = known
            apart_by = ratio * to_b - from_a
            place = np.average(apart_by, axis=0, weights=weight)
            distance = np.linalg.norm(apart_by - place, axis=1)
            middle = max(float(np.median(distance)), 1e-9)
            weight = 1.0 / (1.0 + (distance / (2.0 * middle)) ** 2)
        if not ratio > 0:
            return None
        return turn, place, ratio, len(count)

    def _ratio(self, a: int, b: int) -> float | None:
        """Size of one node in that of another, by their file."""
        sizes = [self._size(k) for k in (a, b)]
        return None if None in sizes else sizes[1] / sizes[0]  # type: ignore[operator]

    def _size(self, k: int) -> float | None:
        """Edge of a node's marker, m; 1 of what the file places; None where it is not stated."""
        marker = self.sought.markers[self.nodes[k].numbers[0]]
        if marker.placed:
            return 1.0
        return None if np.isnan(marker.size) else marker.size

    def _placed(
        self,
        part: Sequence[int],
        edges: _Edges,
    ) -> tuple[dict[int, FloatArray], dict[int, FloatArray], dict[int, float]]:
        """Rotation, position and size of each node in the first one, by what is seen most often."""
        anchor = min(part)
        R, p = {anchor: np.eye(3)}, {anchor: np.zeros(3)}
        size = {anchor: self._size(anchor) or 1.0}
        while len(R) < len(part):
            best = max(
                (edge for edge in edges if (edge[0] in R) != (edge[1] in R)),
                key=lambda edge: edges[edge][3],
            )
            a, b = best
            turn, place, ratio, _ = edges[best]
            if a in R:
                R[b], p[b] = R[a] @ turn, p[a] + size[a] * R[a] @ place
                size[b] = size[a] * ratio
            else:
                R[a], size[a] = R[b] @ turn.T, size[b] / ratio
                p[a] = p[b] - size[a] * R[a] @ place
        return R, p, size

    def _without_moved(self, adjusted: Adjustment) -> Adjustment:
        """The same without markers that moved while the pictures were taken."""
        for _ in range(3):
            moved = adjusted.moved()
            if moved is None or len(adjusted.nodes) < 3:
                break
            k, row, shift, turn = moved
            number, size = self.nodes[k].numbers[0], self._size(k)
            # Without a size only parts of a marker are known here.
            by = f"{mm(shift * size):.2g} mm" if size else f"{shift:.2g} of its size"
            self.notes.append(
                f"Marker {number} moved between {self.images[row - 1]} and {self.images[row]}, by "
                f"{by} and {deg(turn):.2g}°. It is left out. Fix it, and take the pictures "
                "again, or leave out the pictures of one side (exclude)."
            )
            adjusted = adjusted.without(k)
        return adjusted

    def _scaled(self, adjusted: Adjustment, apart: Sequence[int]) -> SurveyedMarkers:
        """In metres, with what is in no picture together with these."""
        sought = self.sought.markers
        judged = np.isfinite(adjusted.picture_p[:, 0])
        A = some_poses(self.hand, judged)
        B = adjusted.picture_turn[judged], adjusted.picture_p[judged]
        anchored = self.nodes[adjusted.anchor].placed
        ratios = {
            k: adjusted.size[k] / size
            for k in adjusted.nodes
            if not self.nodes[k].placed and (size := self._size(k)) is not None
        }
        by_sizes = 1.0 / float(np.median(list(ratios.values()))) if ratios else None
        start = 1.0 if anchored else by_sizes
        by_hand, determined = (
            _scale_by_hand(A, B, start) if judged.sum() >= FEWEST else (1.0, False)
        )
        if anchored:
            scale = 1.0
        elif by_sizes is not None and not (determined and self.exact_hand):
            scale = by_sizes
        elif determined:
            scale = by_hand
        else:
            raise SamplesError(
                "no marker with size_mm, and motions of the hand that do not determine the scale",
                "the size of one marker, or a hand that moves between the pictures",
                where="board",
                hint="add size_mm to one marker, or take pictures from places that are farther "
                "apart, turned about two axes",
            )
        stated = self._sizes_that_agree(
            {k: scale * r for k, r in ratios.items()}, determined and self.exact_hand
        )
        markers = {n: m for n, m in sought.items() if m.placed}
        for k in adjusted.nodes:
            (number, *_), size = self.nodes[k].numbers, scale * adjusted.size[k]
            if not self.nodes[k].placed:
                markers[number] = Marker(scale * adjusted.p[k], size, adjusted.R[k])
        X, Z = (
            agreeing_hand_eye(A, (B[0], scale * B[1]))
            if judged.sum() >= FEWEST
            else ((np.eye(3), np.zeros(3)),) * 2
        )
        lost: list[int] = []
        for k in apart:
            other = self._by_hand(k, X, Z) if determined or anchored else None
            if other is None:
                lost += self.nodes[k].numbers
            else:
                markers[self.nodes[k].numbers[0]] = other
        if lost:
            s = "s" * (len(lost) > 1)
            self.notes.append(
                f"Marker{s} {listed([str(n) for n in lost])}: not in two pictures together with "
                "another marker, and the motions of the hand do not determine where. Left out."
            )
        anchor = None if anchored else self.nodes[adjusted.anchor].numbers[0]
        ordered = {n: markers[n] for n in sought if n in markers}
        return SurveyedMarkers(
            self.sought.dictionary,
            ordered,
            scale=self.sought.scale,
            sought=self.sought,
            anchor=anchor,
            stated=stated,
            notes=tuple(self.notes),
        )

    def _sizes_that_agree(self, ratios: Mapping[int, float], by_hand: bool) -> dict[int, float]:
        """Stated sizes, m, by marker, without those that pictures or hand contradict."""
        if not ratios:
            return {}
        values = np.array(list(ratios.values()))
        middle = float(np.median(values))
        # A marker of a stated size that is off by less is no other one, as a share: four standard
        # deviations of a print, and of what pictures tell.
        other_size = 0.025
        consistent = len(values) > 1 and bool(np.all(np.abs(values / middle - 1.0) < other_size))
        common = middle if len(values) > 2 or consistent or not by_hand else 1.0
        off = {k: r / common for k, r in ratios.items() if abs(r / common - 1.0) > other_size}
        for k, factor in off.items():
            number = self.nodes[k].numbers[0]
            size = self.sought.markers[number].size
            others = (
                "the other markers" if common != 1.0 or not by_hand else "the motions of the hand"
            )
            self.notes.append(
                f"Marker {number} is {factor:.3f} times as large as its size_mm, compared with "
                f"{others}: about {mm(factor * size):.1f} mm, not {mm(size):g} mm. Its size is "
                "estimated instead. Measure the edge of its black square, and correct size_mm."
            )
        if by_hand and abs(common - 1.0) > other_size:
            self.notes.append(
                f"By the motions of the hand all markers are about {common:.3f} times as large as "
                "their size_mm. The sizes are estimated instead. Measure the markers, and check "
                "the unit and the scale of the hand's positions."
            )
            return {}
        return {
            self.nodes[k].numbers[0]: self.sought.markers[self.nodes[k].numbers[0]].size
            for k in ratios
            if k not in off
        }

    def _by_hand(self, k: int, X: Poses, Z: Poses) -> Marker | None:
        """A marker that is in no picture with the others, by the hand that carried the camera."""
        rows = np.flatnonzero(self.seen[k])
        A = some_poses(self.hand, rows)
        poses = [some_poses(pose, rows) for pose in self.candidates[k]]
        to_eye = A[0] @ X[0], np.einsum("nij,j->ni", A[0], X[1]) + A[1]
        turns = np.array([Z[0].T @ to_eye[0] @ R for R, _ in poses])
        every = turns.reshape(-1, 3, 3)
        off = np.linalg.norm(every[:, None, None] - turns[None], axis=(-2, -1)) / np.sqrt(2.0)
        best = int(np.argmin(np.minimum(off.min(axis=1), 0.3).sum(axis=1)))
        way, agreeing = off[best].argmin(axis=0), off[best].min(axis=0) < 0.3
        if agreeing.sum() < 2:
            return None
        count = np.flatnonzero(agreeing)
        R = nearest_rotation(turns[way[count], count].sum(axis=0))
        ray = np.einsum("nij,nj->ni", to_eye[0], poses[0][1])[count]
        start, size = to_eye[1][count], self._size(k)
        if size is None:
            x, y = ray - ray.mean(axis=0), start - start.mean(axis=0)
            power = float(np.sum(x * x))
            size = -float(np.sum(x * y)) / power if power > 0 else 0.0
            if not size > 0:
                return None
        place = (start + size * ray).mean(axis=0)
        return Marker(Z[0].T @ (place - Z[1]), size, R)


def _scale_by_hand(hand: Poses, target: Poses, start: float | None) -> tuple[float, bool]:
    """How many times as far the hand moves as the markers are apart; whether motions tell it.

    By the pictures that agree; ``start`` is what sizes say, if they say anything.
    """
    R, p = target
    scale, share = (start, 0.0) if start else motion_scale(hand, target)
    keep = np.ones(len(p), dtype=np.bool_)
    for _ in range(5):
        if not scale > 0.0:
            return 1.0, False
        A, B = some_poses(hand, keep), (R[keep], scale * p[keep])
        X, Z = agreeing_hand_eye(A, B)
        turned, place = loop_closures(hand, X, (R, scale * p))
        off = np.linalg.norm(place - np.median(place, axis=0), axis=1)
        turn = np.linalg.norm(turned - Z[0], axis=(1, 2))
        # Pictures that are this many times as far off as the middle one are in a wrong pose.
        agreeing = (off <= 4.0 * np.median(off)) & (turn <= 4.0 * np.median(turn))
        if agreeing.sum() < FEWEST:
            return scale, False
        before = scale
        scale, share = motion_scale(some_poses(hand, agreeing), some_poses(target, agreeing))
        if np.array_equal(agreeing, keep) and abs(scale - before) < 1e-6 * before:
            break
        keep = agreeing
    return scale, bool(scale > 0.0 and share < 0.1)


def _parts(nodes: Sequence[int], edges: Mapping[tuple[int, int], object]) -> list[list[int]]:
    """Nodes that edges join, each once."""
    part = {k: k for k in nodes}
    for _ in nodes:
        for a, b in edges:
            part[a] = part[b] = min(part[a], part[b])
    return [[k for k in nodes if part[k] == first] for first in sorted(set(part.values()))]
