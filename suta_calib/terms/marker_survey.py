"""Where markers of unknown places are, by pictures of them: the start, and what is wrong with them.

Each picture tells the pose of each marker in it, in units of the marker's edge: two of them, for a
marker that is far away (the one with its normal turned to the other side of the ray). Pairs of
markers that are in several pictures together say which of the two is true, and how large one is
against the other. From the first marker they are placed one after the other; all pictures are then
adjusted together (Triggs et al. 2000, doi:10.1007/3-540-44480-7_21), with sizes that are free but
for the first one. The hand's motions give the scale, and the place of what is in no picture
together with the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, Self

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.lens_slopes import pixel_slopes
from suta_calib.geometry.numbers import (
    nearest_rotation,
    rotation_from_vector,
    skew,
)
from suta_calib.measurements import Board, Camera, Corners
from suta_calib.measurements.board import Marker, Markers
from suta_calib.measurements.scale import LengthScale
from suta_calib.model.parameters import PLACEMENT, Parameter
from suta_calib.terms.camera_start import poses_in_camera
from suta_calib.terms.external_frame import labelled, pose_named, pose_parameters, pose_values
from suta_calib.terms.hand_eye_start import (
    FEWEST,
    Poses,
    agreeing_hand_eye,
    loop_closures,
    motion_scale,
    some_poses,
)
from suta_calib.units import deg, mm
from suta_calib.words import listed

# Corners of a marker.
_CORNERS: Final = 4
# Numbers of a marker's pose and size.
_WAYS: Final = 7
# A marker of a stated size that is off by less is no other one, as a share: four standard
# deviations of a print, and of what pictures tell.
_OTHER_SIZE: Final = 0.025


# Rotation and position of one node in another, its size there, and in how many pictures.
_Edge = tuple[FloatArray, FloatArray, float, int]
_Edges = Mapping[tuple[int, int], _Edge]


@dataclass(frozen=True, eq=False)
class SurveyedMarkers(Markers):
    """Markers whose places follow from pictures, where a fit begins.

    Attributes:
        sought: as their file has them.
        anchor: the marker whose place is the frame; None where the file places some.
        stated: sizes that their file states and nothing denies, m.
        reference: the marker whose stated size carries the scale; None where the arm does.
        notes: what was found about them, one sentence each.
    """

    sought: Markers = field(kw_only=True)
    anchor: int | None = field(default=None, kw_only=True)
    stated: Mapping[int, float] = field(default_factory=dict, kw_only=True)
    reference: int | None = field(default=None, kw_only=True)
    notes: tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def estimated(self) -> tuple[int, ...]:
        """Numbers of the markers that the file does not place."""
        return tuple(n for n in self.markers if not self.sought.markers[n].placed)

    @property
    def sized(self) -> tuple[int, ...]:
        """Numbers of the markers whose size is estimated."""
        return tuple(n for n in self.estimated if n != self.reference)

    def with_reference(self) -> Self:
        """The same with the first stated size held: it carries the scale of an arm."""
        if self.anchor is None or not self.stated:
            return self
        number, size = next(iter(self.stated.items()))
        markers = {**self.markers, number: replace(self.markers[number], size=size)}
        return replace(self, markers=markers, reference=number)

    def scaled(self, factor: float) -> Self:
        """Larger markers, farther apart."""
        stated = {number: factor * size for number, size in self.stated.items()}
        return replace(super().scaled(factor), stated=stated)

    @property
    def length_scale(self) -> LengthScale:
        """Of what carries the scale; the sizes that are stated are priors instead."""
        return self.sought.length_scale

    @property
    def carries_scale(self) -> bool:
        """Whether places that the file states do."""
        return self.anchor is None or self.reference is not None

    def row(self) -> dict[str, object]:
        """As its file has it."""
        return self.sought.row()

    @property
    def moving(self) -> tuple[int, ...]:
        """Numbers of the markers whose place is estimated."""
        return tuple(n for n in self.estimated if n != self.anchor)

    def size_prior(self, number: int) -> float | None:
        """Standard deviation of the size that is stated of a marker, m; None of no such one.

        What all sizes have in common stays as uncertain as that of one print.
        """
        if number not in self.stated:
            return None
        return self.length_scale.std * float(np.sqrt(len(self.stated))) * self.stated[number]

    def parameters(self, label: str) -> tuple[Parameter, ...]:
        """The unknowns ``marker[N].x … rz`` and ``marker[N].size``, about where a fit begins."""
        listed_parameters: list[Parameter] = []
        for number in self.estimated:
            owner, marker = marker_owner(number, label), self.markers[number]
            if number != self.anchor:
                start = pose_values(marker.rotation, marker.position)
                listed_parameters += [
                    replace(p, nominal=float(value))
                    for p, value in zip(pose_parameters(owner), start, strict=True)
                ]
            if number == self.reference:
                continue
            prior = self.size_prior(number)
            nominal = marker.size if prior is None else self.stated[number]
            listed_parameters.append(
                Parameter(
                    owner,
                    "size",
                    "m",
                    nominal,
                    lower=0.0,
                    prior=prior,
                    plausible=nominal,
                    prior_fixed=True,
                )
            )
        return tuple(listed_parameters)

    def at(self, label: str, values: Mapping[str, float]) -> Self:
        """The board as these values of its unknowns have it."""
        markers = dict(self.markers)
        for number in self.estimated:
            owner = marker_owner(number, label)
            size = values.get(f"{owner}.size", markers[number].size)
            markers[number] = replace(markers[number], size=size)
            if f"{owner}.x" in values:
                R, p = pose_named(values, owner)
                markers[number] = replace(markers[number], position=p, rotation=R)
        return replace(self, markers=markers)

    def rows(
        self, numbers: IntArray, columns: Mapping[str, int], label: str
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Of points (n,) by number, what the residual needs of markers.

        Points (n, 3) that are fixed; corners and two flags (n, 4); and columns (n, 7) of the own
        unknowns, by name, that pose and size of the marker have.
        """
        fixed, corner = np.zeros((len(numbers), 3)), np.zeros((len(numbers), 4))
        own = np.tile(np.array([*range(6, 12), 6], dtype=np.intp), (len(numbers), 1))
        which, k = np.divmod(numbers, _CORNERS)
        unit = Marker(np.zeros(3), 1.0).corners
        for number in np.unique(which).tolist():
            mine = which == number
            if number not in self.estimated:
                fixed[mine] = self.markers[number].corners[k[mine]]
                continue
            owner, moves = marker_owner(number, label), number != self.anchor
            corner[mine, :2] = unit[k[mine], :2]
            corner[mine, 2:] = [float(moves), float(number in self.sized)]
            if number in self.sized:
                own[mine, 6] = columns[f"{owner}.size"]
            else:
                corner[mine, :2] *= self.markers[number].size
            if moves:
                own[mine, :6] = [columns[f"{owner}.{key}"] for key in PLACEMENT]
        return fixed, corner, own

    def with_markers(self, factor: float) -> Board | None:
        """None: their sizes are estimated."""
        del factor
        return None


def marker_owner(number: int, label: str) -> str:
    """What a marker's unknowns are called, on a board with a label."""
    return labelled("marker", str(number) if label == "default" else f"{label}/{number}")


@dataclass(frozen=True, eq=False)
class _Node:
    """What is rigid beforehand: all markers that the file places, or one that it does not.

    Attributes:
        numbers: of its markers.
        points: (k, 3) corners, m; in edges of a marker of unknown place.
        pixels: (n, k, 2) in each picture.
    """

    numbers: tuple[int, ...]
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

    def _nodes(self, corners: Corners) -> list[_Node]:
        row = {name: k for k, name in enumerate(self.images)}
        every = {4 * n + k: (n, k) for n in self.sought.markers for k in range(_CORNERS)}
        pixels = {n: np.full((len(row), _CORNERS, 2), np.nan) for n in self.sought.markers}
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
            nodes.append(_Node(tuple(placed), points, together))
        unit = Marker(np.zeros(3), 1.0).corners
        nodes += [_Node((n,), unit, pixels[n]) for n in self.sought.unplaced]
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
            if not self.sought.markers[node.numbers[0]].placed and seen.sum() < 2
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
        adjusted = _Adjustment.of(self, first, R, p, size)
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
        if self.sought.markers[self.nodes[0].numbers[0]].placed:
            return next(part for part in parts if 0 in part)
        return max(parts, key=len)

    def _edges(
        self, usable: Sequence[int]
    ) -> dict[tuple[int, int], tuple[FloatArray, FloatArray, float, int]]:
        """By pair of nodes: rotation and position of the second in the first, and its size.

        In edges of the first one. Pairs of which no two pictures agree are in none.
        """
        edges = {}
        for a in usable:
            for b in usable:
                if a < b and (both := np.flatnonzero(self.seen[a] & self.seen[b])).size >= 2:
                    found = self._edge(a, b, both)
                    if found is not None:
                        edges[a, b] = found
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
            each = ratio * to_b - from_a
            place = np.average(each, axis=0, weights=weight)
            distance = np.linalg.norm(each - place, axis=1)
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

    def _without_moved(self, adjusted: _Adjustment) -> _Adjustment:
        """The same without markers that moved while the pictures were taken."""
        for _ in range(3):
            moved = adjusted.moved()
            if moved is None or len(adjusted.nodes) < 3:
                break
            k, row, shift, turn = moved
            number = self.nodes[k].numbers[0]
            self.notes.append(
                f"Marker {number} moved between {self.images[row - 1]} and {self.images[row]}, by "
                f"{shift} and {deg(turn):.2g}°. It is left out. Fix it, and take the pictures "
                "again, or leave out the pictures of one side (exclude)."
            )
            adjusted = adjusted.without(k)
        return adjusted

    def _scaled(self, adjusted: _Adjustment, apart: Sequence[int]) -> SurveyedMarkers:
        """In metres, with what is in no picture together with these."""
        sought = self.sought.markers
        seen = np.isfinite(adjusted.picture_p[:, 0])
        A = some_poses(self.hand, seen)
        B = adjusted.picture_turn[seen], adjusted.picture_p[seen]
        anchored = sought[self.nodes[adjusted.anchor].numbers[0]].placed
        ratios = {
            k: adjusted.size[k] / size
            for k in adjusted.nodes
            if (size := self._size(k)) is not None and not sought[self.nodes[k].numbers[0]].placed
        }
        by_sizes = 1.0 / float(np.median(list(ratios.values()))) if ratios else None
        start = 1.0 if anchored else by_sizes
        by_hand, told = _scale_by_hand(A, B, start) if seen.sum() >= FEWEST else (1.0, False)
        if anchored:
            scale = 1.0
        elif by_sizes is not None and not (told and self.exact_hand):
            scale = by_sizes
        elif told:
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
            {k: scale * r for k, r in ratios.items()}, told and self.exact_hand
        )
        markers = {n: m for n, m in sought.items() if m.placed}
        for k in adjusted.nodes:
            (number, *_), size = self.nodes[k].numbers, scale * adjusted.size[k]
            if not sought[number].placed:
                markers[number] = Marker(scale * adjusted.p[k], size, adjusted.R[k])
        X, Z = (
            agreeing_hand_eye(A, (B[0], scale * B[1]))
            if seen.sum() >= FEWEST
            else ((np.eye(3), np.zeros(3)),) * 2
        )
        lost: list[int] = []
        for k in apart:
            other = self._by_hand(k, X, Z) if told or anchored else None
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
        alike = len(values) > 1 and bool(np.all(np.abs(values / middle - 1.0) < _OTHER_SIZE))
        common = middle if len(values) > 2 or alike or not by_hand else 1.0
        off = {k: r / common for k, r in ratios.items() if abs(r / common - 1.0) > _OTHER_SIZE}
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
        if by_hand and abs(common - 1.0) > _OTHER_SIZE:
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


@dataclass(frozen=True, eq=False)
class _Adjustment:
    """All pictures of some nodes, adjusted together; in units of the anchor's size, or metres.

    Attributes:
        survey: whose nodes they are.
        nodes: their numbers there; the first one, `anchor`, stays.
        R, p, size: of each, by number.
        picture_turn, picture_p: (n, 3, 3), (n, 3) ``T_eye_anchor``; NaN of pictures without any.
        normal: sums of the derivatives over the corners of each picture (`_Normal`).
    """

    survey: _Survey
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
        survey: _Survey,
        part: Sequence[int],
        R: Mapping[int, FloatArray],
        p: Mapping[int, FloatArray],
        size: Mapping[int, float],
    ) -> _Adjustment:
        """Levenberg and Marquardt from a start; corners far off pull no harder than others."""
        nodes = tuple(sorted(part))
        shown, at = _Layout.of(survey, nodes, R, p, size)
        seen = _CornerTable.of(survey, nodes, shown)
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
        picture_turn = np.full((len(survey.images), 3, 3), np.nan)
        picture_p = np.full((len(survey.images), 3), np.nan)
        picture_turn[seen.pictures], picture_p[seen.pictures] = at.picture_turn, at.picture_p
        return cls(
            survey,
            nodes,
            {k: at.R[i] for k, i in index.items()},
            {k: at.p[i] for k, i in index.items()},
            {k: float(at.size[i]) for k, i in index.items()},
            picture_turn,
            picture_p,
            normal,
        )

    def without(self, k: int) -> _Adjustment:
        """The same without a node."""
        nodes = [other for other in self.nodes if other != k]
        # The frame is that of the first one that is left.
        R, p = self.R[nodes[0]], self.p[nodes[0]]
        turns = {other: R.T @ self.R[other] for other in nodes}
        places = {other: R.T @ (self.p[other] - p) for other in nodes}
        return _Adjustment.of(self.survey, nodes, turns, places, self.size)

    def moved(self) -> tuple[int, int, str, float] | None:
        """The node that moved while pictures were taken: from which picture on, and how far.

        By the test of added variables: six more numbers for its pose from some picture on. None
        where chance explains what the best of them gains.
        """
        normal = self.normal
        rows = np.flatnonzero(np.isfinite(self.picture_p[:, 0]))
        # What the file places is the frame, and stays.
        first = self.survey.nodes[self.anchor].numbers[0]
        fixed = int(self.survey.sought.markers[first].placed)
        full = normal.reduced.sum(axis=0)
        free = normal.free
        inverse = np.linalg.pinv(full[np.ix_(free, free)], 1e-12, hermitian=True)
        best: tuple[float, int, int, FloatArray] = (0.0, -1, -1, np.zeros(6))
        after, pull = np.zeros_like(full), np.zeros(len(full))
        tests = 0
        there = np.array([[self.survey.seen[k, row] for k in self.nodes] for row in rows])
        for i in range(len(rows) - 1, 0, -1):
            after, pull = after + normal.reduced[i], pull + normal.gradient[i]
            for j in range(fixed, len(self.nodes)):
                if not there[i, j] or there[i:, j].sum() < 2 or there[:i, j].sum() < 2:
                    continue
                tests += 1
                mine = slice(_WAYS * j, _WAYS * j + 6)
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
        size = self.size[self.nodes[j]]
        shift = float(np.linalg.norm(step[:3]))
        # Without a size only shares of a marker are known here.
        known = self.survey._size(self.nodes[j])
        text = f"{mm(shift / size * known):.2g} mm" if known else f"{shift / size:.2g} of its size"
        return self.nodes[j], int(rows[i]), text, float(np.linalg.norm(step[3:]))


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
        survey: _Survey,
        nodes: Sequence[int],
        R: Mapping[int, FloatArray],
        p: Mapping[int, FloatArray],
        size: Mapping[int, float],
    ) -> tuple[BoolArray, _Layout]:
        """Nodes as they are, and each picture by all of its corners; which pictures tell it.

        A picture that has corners behind the camera in the pose that fits it best tells none.
        """
        points = np.concatenate([size[k] * survey.nodes[k].points @ R[k].T + p[k] for k in nodes])
        pixels = np.concatenate([survey.nodes[k].pixels for k in nodes], axis=1)
        turn, place = poses_in_camera(points, pixels, survey.camera)
        there = np.isfinite(pixels).all(axis=2)
        in_eye = np.einsum("nij,kj->nki", turn, points) + place[:, None]
        posed = np.isfinite(place[:, 0])
        ahead = survey.camera.lens.ahead(np.where(posed[:, None, None], in_eye, 0.0), 1e-9)
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
        return pictures, nodes.reshape(-1, _WAYS)


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
    def of(cls, survey: _Survey, nodes: Sequence[int], shown: BoolArray) -> _CornerTable:
        """Of some of the pictures (n,)."""
        number = np.cumsum(shown) - 1
        parts = []
        for i, k in enumerate(nodes):
            there = np.isfinite(survey.nodes[k].pixels).all(axis=2) & shown[:, None]
            picture, point = np.nonzero(there)
            parts.append(
                (
                    number[picture],
                    np.full(len(picture), i),
                    survey.nodes[k].points[point],
                    survey.nodes[k].pixels[picture, point],
                )
            )
        picture, node, local, pixel = (np.concatenate(each) for each in zip(*parts, strict=True))
        free = np.ones((len(nodes), _WAYS), dtype=np.bool_)
        free[0] = False
        return cls(survey.camera, shown, picture, node, local, pixel, free.ravel())

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
        pm, whole = np.zeros((n, m, 6, _WAYS)), np.zeros((n, m, _WAYS, _WAYS))
        pull = np.zeros((n, m, _WAYS))
        where = self.picture, self.node
        np.add.at(pm, where, np.swapaxes(P, 1, 2) @ wM)
        np.add.at(whole, where, np.swapaxes(M, 1, 2) @ wM)
        np.add.at(pull, where, np.einsum("kdc,kd->kc", wM, error))
        blocks = np.zeros((n, m, _WAYS, m, _WAYS))
        every = np.arange(m)
        blocks[:, every, :, every] = np.swapaxes(whole, 0, 1)
        return _Normal(
            blocks.reshape(n, m * _WAYS, m * _WAYS),
            pull.reshape(n, -1),
            (pp, np.moveaxis(pm, 2, 1).reshape(n, 6, -1), pr),
            np.flatnonzero(self.sizes_free),
            length,
            result_sigma,
        )
