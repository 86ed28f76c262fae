"""A kind of observation: a height gauge on a surface plate says how high the tip is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from suta_calib import Noise, Parameter, Term
from suta_calib.geometry.numbers import rotation_from_vector, vector_turning_z_to
from suta_calib.geometry.symbols import symbolic_rotation
from suta_calib.measurements import NumberColumn, SampleColumns
from suta_calib.terms import Block, Observed, PoseSource
from suta_calib.terms.block import Pose


def _difference(poses: Sequence[Pose], own: Any, data: Any) -> Any:
    """Height of the tip above the plate, less what the gauge read: the residual of one row."""
    up = symbolic_rotation(ca.vertcat(own[1], own[2], 0))[:, 2]
    return ca.dot(up, poses[0].p) - own[0] - data[0]


@dataclass(frozen=True, eq=False, repr=False)
class Height(Term):
    """``uᵀ p - d - height`` of every row: p is the tip, u and d are the plate's, unknown."""

    kind: ClassVar[str] = "height"
    about: ClassVar[str] = "a height gauge on a surface plate measured how high the tip is"
    columns: ClassVar[SampleColumns] = SampleColumns(
        numbers=(NumberColumn("height", "m"),), about={"height": "Of the tip above the plate."}
    )
    medium: ClassVar = "instrument"
    has_angles: ClassVar[bool] = False

    noise: Noise = Noise()

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The plate's distance from the base's origin, and how it leans."""
        return (
            Parameter("plate", "z", "m", plausible=1.0),
            Parameter("plate", "rx", "rad", plausible=0.1),
            Parameter("plate", "ry", "rad", plausible=0.1),
        )

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """One length for each row; every row looks at all three unknowns."""
        samples = self.poses.samples
        own, data = np.tile([0, 1, 2], (len(samples), 1)), samples.numbers["height"][:, None]
        each = Block.per_sample
        return (each("height", "m", 1, _difference, own, data, self.noise, samples.origin),)

    def start(self, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Of ``uᵀ p - d = height``, which is linear in u and d: by least squares."""
        del rotation
        rows = np.column_stack([position, -np.ones(len(position))])
        *up, _ = np.linalg.lstsq(rows, self.poses.samples.numbers["height"], rcond=None)[0]
        length = float(np.linalg.norm(up))
        up = np.array(up) / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])
        d = np.mean(position @ up - self.poses.samples.numbers["height"])
        return np.array([d, *vector_turning_z_to(up)[:2]])

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """What an ideal gauge would read: for `simulate`, and for tests of your own."""
        d, rx, ry = (values[p.name] for p in self.own_parameters)
        up = rotation_from_vector(np.array([rx, ry, 0.0]))[:, 2]
        return Observed(numbers={"height": poses.at(values)[1] @ up - d})
