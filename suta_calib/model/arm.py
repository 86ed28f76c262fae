"""The arm whose geometry is unknown: one chain of a URDF, as Pinocchio reads it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.batched import Batched
from suta_calib.errors import ParameterError, UrdfError
from suta_calib.geometry.symbols import Symbol
from suta_calib.model.chain import Chain, ChainJoint, read_chain
from suta_calib.model.gravity import Load, check_masses, gravity_in_base, loads
from suta_calib.model.kinematics import Motion, Segment, forward_kinematics
from suta_calib.model.nongeometric import COMPLIANCE, nongeometric_parameters
from suta_calib.model.parameters import Parameter, ParameterSet, Selection, select_parameters
from suta_calib.model.urdf import folded_origin, write_urdf
from suta_calib.units import Unit


class ArmModel:
    """A serial chain base → tip with a parametric geometry.

    Build one with `from_urdf`. Readings ``q`` are (n, joints) in the order of `joints`, rad for
    revolute joints and m for prismatic ones, as the encoders report them.

    Attributes:
        chain: the joints as the URDF's text gives them, base → tip, fixed ones included.
        model: `pin.Model` with every joint off the chain locked at its neutral position.
        segments: the same chain as Pinocchio understood it.
        parameters: every placement and offset that could be unknown, all at nominal.
        nongeometric: eccentricity and compliance of its revolute joints, all zero (`nongeometric`).
    """

    def __init__(self, chain: Chain, model: pin.Model) -> None:
        self.chain = chain
        self.model = model
        self.segments = tuple(
            _segment(model, joint, _prefix(chain, joint)) for joint in chain.joints
        )
        self.parameters = ParameterSet(_parameters(self.segments))
        turning = [s.prefix for s in self.segments if s.motion == "revolute"]
        self.nongeometric = ParameterSet(nongeometric_parameters(turning))

    @classmethod
    def from_urdf(cls, path: str | Path, tip: str, base: str | None = None) -> ArmModel:
        """Read the chain from ``base`` (default: the root link) to ``tip`` (any link or frame).

        Raises:
            UrdfError: no such file, link or chain, or a chain with a joint that is not revolute,
                continuous, prismatic or fixed.
        """
        chain = read_chain(path, tip, base)
        try:
            model = pin.buildModelFromUrdf(str(path))
        except (ValueError, RuntimeError) as error:
            raise UrdfError(
                f"a model Pinocchio refuses ({str(error).strip().splitlines()[0]})",
                "a URDF that Pinocchio can load",
                file=path,
            ) from error
        on_chain = {joint.name for joint in chain.moving}
        locked = [i for i in range(1, model.njoints) if model.names[i] not in on_chain]
        return cls(chain, pin.buildReducedModel(model, locked, pin.neutral(model)))

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the moving joints, base → tip: the columns of a samples file."""
        return tuple(joint.name for joint in self.chain.moving)

    @property
    def tip(self) -> str:
        """The name the tip's own parameters carry."""
        return self.chain.tip

    @cached_property
    def geometric(self) -> frozenset[str]:
        """Names the word ``geometric`` stands for: placements of moving joints and of the tip."""
        last = self.segments[-1].prefix
        return frozenset(
            name
            for s in self.segments
            if s.motion != "fixed" or s.prefix == last
            for name in s.parameter_names
            if not name.endswith(".offset")
        )

    @cached_property
    def offered(self) -> ParameterSet:
        """`parameters`, then `nongeometric`: all that can be selected."""
        return ParameterSet([*self.parameters.values(), *self.nongeometric.values()])

    @cached_property
    def loads(self) -> tuple[Load, ...]:
        """The masses on the moving joints, base → tip, as the URDF has them."""
        return loads(self.chain, self.model)

    def select(self, *rows: Selection | str) -> ParameterSet:
        """The parameters that are to be estimated; strings stand for unbounded selections.

        Raises:
            ParameterError: a row that fits no parameter.
            UrdfError: a joint's compliance is selected, and nothing beyond it has a mass.
        """
        selections = [r if isinstance(r, Selection) else Selection((r,)) for r in rows]
        chosen = select_parameters(self.offered, self.geometric, selections)
        self._check_masses(chosen)
        return chosen

    def _check_masses(self, names: Iterable[str]) -> None:
        split = (name.rpartition(".") for name in names)
        yielding = [joint for joint, _, key in split if key == COMPLIANCE]
        check_masses(self.chain, self.loads, yielding)

    def function(self, names: Sequence[str]) -> Symbol:
        """CasADi function of `kinematics.forward_kinematics`, built once for each set of names."""
        for name in names:
            _ = self.offered[name]
        return _kinematics(self, tuple(names))

    def forward(
        self, q: ArrayLike, values: Mapping[str, float] | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Tip poses ``T_base_tip`` for readings and parameter values (nominal where not given).

        Args:
            q: (n, joints) or (joints,) readings.
            values: parameter values by name; names of other things than this arm are ignored.

        Returns:
            Rotations (n, 3, 3) and positions (n, 3), m; without n for a single reading.
        """
        readings = np.asarray(q, dtype=float)
        own = {k: v for k, v in (values or {}).items() if v and k in self.nongeometric}
        own |= {k: v for k, v in (values or {}).items() if k in self.parameters}
        rows = np.atleast_2d(readings)
        if rows.shape[1] != len(self.joints):
            raise ParameterError(
                f"readings of {rows.shape[1]} joints", f"{len(self.joints)}: {self.joints}"
            )
        batch = Batched(self.function(list(own)), len(rows), shared=[0])
        batch.inputs[0][:] = list(own.values())
        batch.inputs[1][:] = rows
        flat, position, _ = batch()
        rotation = np.swapaxes(flat.reshape(-1, 3, 3), 1, 2).copy()
        if readings.ndim == 1:
            return rotation[0], position[0]
        return rotation, position

    def write_urdf(self, destination: str | Path, values: Mapping[str, float]) -> None:
        """The user's own URDF with these values in the origins of its joints, for raw readings.

        Args:
            destination: file to write.
            values: parameter values by name; those of other things than this arm are ignored, and
                so are eccentricity and compliance: a URDF cannot hold them.

        Raises:
            OutputError: the file could not be written; nothing is left half-written.
        """
        write_urdf(self.chain.path, Path(destination), self.origins(values))

    def origins(self, values: Mapping[str, float]) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Position (3,), m, and rpy (3,), rad, of every joint's origin with these values folded in.

        Args:
            values: parameter values by name, as in `write_urdf`; nominal where not given.
        """
        found = {}
        for joint in self.chain.joints:
            prefix = _prefix(self.chain, joint)
            xyz = [values.get(f"{prefix}.{k}", joint.xyz[i]) for i, k in enumerate("xyz")]
            vector = [values.get(f"{prefix}.r{k}", 0.0) for k in "xyz"]
            offset = values.get(f"{prefix}.offset", 0.0)
            found[joint.name] = folded_origin(joint, np.array(xyz), np.array(vector), offset)
        return found


@lru_cache(maxsize=16)
def _kinematics(arm: ArmModel, names: tuple[str, ...]) -> Symbol:
    arm._check_masses(names)
    gravity = gravity_in_base(arm.chain, arm.model)
    return forward_kinematics(arm.segments, names, arm.loads, gravity)


def _prefix(chain: Chain, joint: ChainJoint) -> str:
    """A fixed joint that carries the tip is known by the tip's name, all others by their own."""
    is_tip = joint is chain.joints[-1] and not joint.moving
    return chain.tip if is_tip else joint.name


def _segment(model: pin.Model, joint: ChainJoint, prefix: str) -> Segment:
    """A joint's own origin: its placement relative to its parent link, and its axis."""
    parent = model.frames[model.getFrameId(joint.parent, pin.FrameType.BODY)]
    axis = np.zeros(3)
    if joint.moving:
        index = model.getJointId(joint.name)
        placement = model.jointPlacements[index]
        jacobian = pin.computeJointJacobian(model, model.createData(), pin.neutral(model), index)
        subspace = jacobian.reshape(6, model.nv)[:, model.joints[index].idx_v]
        axis = subspace[:3] + subspace[3:]
    else:
        kinds = pin.FrameType.FIXED_JOINT
        placement = model.frames[model.getFrameId(joint.name, kinds)].placement
    origin = parent.placement.actInv(placement)
    return Segment(prefix, _motion(joint), origin.rotation, joint.xyz, axis)


def _motion(joint: ChainJoint) -> Motion:
    if joint.type == "fixed":
        return "fixed"
    return "prismatic" if joint.type == "prismatic" else "revolute"


def _parameters(segments: Sequence[Segment]) -> list[Parameter]:
    parameters = []
    for s in segments:
        for name in s.parameter_names:
            key = name.rsplit(".", 1)[1]
            length = key in ("x", "y", "z") or (key == "offset" and s.motion == "prismatic")
            unit: Unit = "m" if length else "rad"
            nominal = float(s.position["xyz".index(key)]) if key in ("x", "y", "z") else 0.0
            parameters.append(Parameter(name, unit, nominal))
    return parameters
