"""Two tips that hold one rigid thing: the pose of one in the other does not change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.geometry.symbols import Symbol, symbolic_chordal_log
from suta_calib.measurements import SampleColumns
from suta_calib.model.parameters import PLACEMENT
from suta_calib.terms.block import LEARNT, Block, Noise, Pose, pose_of
from suta_calib.terms.external_frame import pose_values
from suta_calib.terms.hand_eye_start import chordal_mean
from suta_calib.terms.observed import Observed, Resimulation
from suta_calib.terms.places import PlaceTerm
from suta_calib.terms.poses import PoseSource
from suta_calib.terms.term import Gap


def _position(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """In the frame of the tip: in the base frame, noise would seem to tell where it points."""
    del data
    return poses[0].inverse_act(unknowns[:3])


def _rotation(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    turned = ca.reshape(data, 3, 3)
    return symbolic_chordal_log(turned.T @ poses[0].R.T @ pose_of(unknowns).R)


@dataclass(frozen=True, eq=False, repr=False)
class LoopClosure(PlaceTerm):
    """``T_i⁻¹ X`` for a tip that keeps its pose X in the tip of another chain.

    The chain goes from the other tip to this one (``base_chain``): both hold one rigid thing, and
    the arms move while neither lets go. Every grip has a pose X of its own, unknown or given.

    Such data tell nothing of what carries both chains, of where the robot stands, or of where
    either tip is in its link, for the unknown grip takes that up. They tell no scale either, unless
    the pose of a grip is given. The chain must have seven joints at least to move at all.

    Attributes:
        poses: samples with the label grip.
        angular_noise: scatter and robustness of the orientation, rad per axis.
        turns: (n, 3, 3) how the tip was turned from where the grip has it; not at all by default.
    """

    kind = "closed_loop"
    order = 11
    about = (
        "two tips that hold one rigid thing while both arms move: the pose of one tip in the other "
        "is constant; the chain goes from the other tip to this one (base_chain)"
    )
    columns = SampleColumns(
        labels=("grip",),
        about={"grip": "Label of how the thing was held: the same until a hand lets go of it."},
    )
    has_angles = True
    between_chains = True
    place = "grip"
    place_unknown = "grip"
    place_keys = PLACEMENT
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {"grip": ("grip",), "row": ()}
    leaves_open: ClassVar[Mapping[Gap, tuple[str, str]]] = {
        "base": (
            "a closed loop does not show where the other tip is in its link, or where the robot "
            "stands, because the unknown pose of the grip cancels it",
            "measure one of the tips with an external instrument (tracked_point), or give the "
            "pose of the grip",
        ),
        "tool": (
            "moves the tip in its link. A closed loop does not show this, because the unknown pose "
            "of the grip cancels it",
            "measure the tip itself, or give the pose of the grip",
        ),
    }

    angular_noise: Noise = LEARNT
    turns: FloatArray | None = None

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The positions, and the orientations."""
        (position,) = self._blocks("position", 3, _position)
        n = len(self.poses)
        turns = np.tile(np.eye(3), (n, 1, 1)) if self.turns is None else self.turns
        rotation = replace(
            position,
            name="rotation",
            unit="rad",
            residual=_rotation,
            data=np.swapaxes(turns, 1, 2).reshape(n, 9),
            noise=self.angular_noise,
        )
        return position, rotation

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The tip where its grip has it."""
        held = self._there(values, poses)
        return Observed(held[:, :3], rotation_from_vector(held[:, 3:]))

    def resimulated(
        self, values: Mapping[str, float], noise: Sequence[float], again: Resimulation
    ) -> Self:
        """Every tip where its grip has it.

        The turns are those that it would have had, rather than the arm readings that give both: a
        chain of few joints has no other posture in one pose.
        """
        simulated = super().resimulated(values, noise, again)
        held = simulated.observed(values, simulated.poses).rotation
        assert held is not None
        rotation, _ = simulated.poses.at(values)
        turns = again.turned(np.swapaxes(rotation, 1, 2) @ held, noise[1])
        return replace(simulated, turns=turns)

    def take(self, rows: ArrayLike) -> Self:
        """The term over some of its samples."""
        turns = None if self.turns is None else self.turns[np.asarray(rows)]
        return replace(self, poses=self.poses.take(rows), turns=turns)

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """The mean pose of every grip."""
        turns = rotation if self.turns is None else rotation @ self.turns
        starts = [
            pose_values(chordal_mean(turns[rows]), position[rows].mean(axis=0))
            for _, rows in self._by_place()
        ]
        return np.concatenate([np.zeros(0), *starts])

    def check_enough(self) -> None:
        """Two postures of every grip at least: the pose of one takes up all that one tells."""
        for name, rows in self._by_place():
            if len(np.unique(self.poses.postures[rows])) < 2:
                raise self.refuse(
                    f"grip {name} in {len(rows)} sample{'s' * (len(rows) != 1)} of one posture",
                    "every grip in at least two postures, because its pose is unknown",
                    hint="is its label misspelt? Move both arms without letting go",
                )
