"""Poses that are known before the calibration: surveyed or certified, exact or with a prior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import (
    rotation_from_vector,
    tangent_of_vector,
    vector_from_rotation,
    vector_turning_z_to,
)
from suta_calib.measurements import YamlSection
from suta_calib.measurements.fields import ANGLE, RPY_DEG, Value, fields_of, keyed, read_as
from suta_calib.measurements.fields import POSITION as POSITION_MM
from suta_calib.measurements.samples import finite, numbers_of, rotation_matrix
from suta_calib.model.parameters import POSITION, ROTATION
from suta_calib.units import from_mm

_STD_MM: Final = Value(
    "mm", lambda section, name: np.full(3, from_mm(section.number(name, "positive")))
)


@dataclass(frozen=True)
class PriorValue:
    """What is known of one unknown beforehand: a value, and its standard deviation; None for sure.

    Both in the unknown's unit, m or rad.
    """

    value: float
    std: float | None


@dataclass(frozen=True, eq=False)
class GivenPose(Displayable):
    """A known pose or position of something, exact or with standard deviations.

    Attributes:
        position: (3,), m.
        rotation: (3, 3), or None where the orientation stays unknown.
        position_std: (3,) standard deviation of each coordinate, m, or one of all; None for an
            exact position.
        rotation_std: standard deviation of the turn about any axis, rad; None for an exact one.
        line: where it stands in its file.
    """

    position: FloatArray = keyed(POSITION_MM)
    rotation: FloatArray | None = keyed(
        RPY_DEG,
        "How it is turned, as in a URDF; without it the orientation stays unknown.",
        None,
        "rotation_rpy_deg",
    )
    position_std: FloatArray | None = keyed(
        _STD_MM,
        "Standard deviation of each coordinate; without it the position is taken as exact.",
        None,
        "prior_mm",
    )
    rotation_std: float | None = keyed(
        ANGLE,
        "Standard deviation of the turn about any axis; without it the orientation is taken as "
        "exact.",
        None,
        "prior_deg",
    )
    line: int | None = None

    def __post_init__(self) -> None:
        checked = {"position": finite("GivenPose: position", self.position, (3,))}
        if self.rotation is not None:
            checked["rotation"] = rotation_matrix("GivenPose: rotation", self.rotation)
        if self.position_std is not None:
            std = np.broadcast_to(numbers_of("GivenPose: position_std", self.position_std), 3)
            checked["position_std"] = finite("GivenPose: position_std", std, (3,))
        for name, array in checked.items():
            object.__setattr__(self, name, array)

    @classmethod
    def read(cls, section: YamlSection) -> GivenPose:
        """``position_mm``, and what else of its keys there is.

        Raises:
            InputError: a key that is unknown, missing or unusable; names the line and the key.
        """
        given = read_as(cls, section, line=section.line)
        if given.rotation is None and given.rotation_std is not None:
            raise section.refuse(
                "prior_deg without an orientation", "rotation_rpy_deg beside it", at=("prior_deg",)
            )
        return given

    @property
    def inverse(self) -> GivenPose:
        """``T_b_a`` of a ``T_a_b`` whose orientation is known.

        Its position is unsure by the turn too, through the lever between the two.
        """
        assert self.rotation is not None
        back = self.rotation.T
        position, std = -back @ self.position, self.position_std
        if std is not None and self.rotation_std is not None:
            lever = position @ position - position**2
            std = np.asarray(np.sqrt((back**2) @ std**2 + self.rotation_std**2 * lever))
        return GivenPose(position, back, std, self.rotation_std, self.line)

    def of_point(self, owner: str) -> dict[str, PriorValue]:
        """The unknowns ``owner.x|y|z``."""
        std = [None] * 3 if self.position_std is None else self.position_std.tolist()
        pairs = zip(POSITION, self.position.tolist(), std, strict=True)
        return {f"{owner}.{key}": PriorValue(value, s) for key, value, s in pairs}

    def of_pose(self, owner: str) -> dict[str, PriorValue]:
        """The unknowns ``owner.x … owner.rz``; without the last three where no turn is known."""
        by_name = self.of_point(owner)
        if self.rotation is None:
            return by_name
        vector = vector_from_rotation(self.rotation)
        inverse = np.linalg.inv(tangent_of_vector(vector))
        return by_name | self._turns(owner, ROTATION, vector, np.asarray(inverse))

    def of_axis(self, owner: str, axis: int, along: tuple[str, ...]) -> dict[str, PriorValue]:
        """The unknowns of something that only an axis of the pose matters for: ``rx``, ``ry``.

        They are the shortest turn (rx, ry, 0) of the base's z axis to the one that the axis lies
        on, of the two directions the one that points up.

        Args:
            owner: of the unknowns.
            axis: of the pose: 0, 1 or 2.
            along: keys of the place's coordinates in the frame turned so, that are unknowns too.
                Their prior is that of the position, whatever the axis is.
        """
        assert self.rotation is not None
        direction = self.rotation[:, axis]
        turn = vector_turning_z_to(direction if direction[2] >= 0 else -direction)
        frame = rotation_from_vector(turn)
        there = frame.T @ self.position
        std = None if self.position_std is None else np.sqrt((frame.T**2) @ self.position_std**2)
        by_name = {}
        for key in along:
            k = POSITION.index(key)
            by_name[f"{owner}.{key}"] = PriorValue(
                float(there[k]), None if std is None else float(std[k])
            )
        # Turned about the horizontal it leans by one for one; aside by the sine of its lean.
        lean = float(np.linalg.norm(turn))
        radial = turn[:2] / lean if lean else np.array([1.0, 0.0])
        stretch = lean / np.sin(lean) if lean else 1.0
        by_tilt = np.column_stack([radial, stretch * np.array([-radial[1], radial[0]])])
        return by_name | self._turns(owner, ROTATION[:2], turn[:2], by_tilt)

    def _turns(
        self, owner: str, keys: tuple[str, ...], values: FloatArray, derivative: FloatArray
    ) -> dict[str, PriorValue]:
        """Components of a turn, unsure by so much for each small turn about an axis."""
        spread = np.linalg.norm(derivative, axis=1)
        std = [None if self.rotation_std is None else float(self.rotation_std * s) for s in spread]
        pairs = zip(keys, values.tolist(), std, strict=True)
        return {f"{owner}.{key}": PriorValue(value, s) for key, value, s in pairs}


POSE_KEYS: Final = fields_of(GivenPose)
