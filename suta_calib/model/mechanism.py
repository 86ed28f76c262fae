"""What one chain and several chains that share joints have in common: joints and parameters."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Container, Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.atomic import write_bytes_atomically
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.model.chain import Chain, ChainJoint
from suta_calib.model.kinematics import Segment
from suta_calib.model.parameters import (
    MASS,
    OFFSET,
    POSITION,
    ROTATION,
    ParameterSet,
    Selection,
    select_parameters,
)
from suta_calib.model.urdf import urdf_bytes
from suta_calib.units import Unit

Origins = dict[str, tuple[FloatArray, FloatArray]]


class Mechanism(Displayable):
    """Joints and links whose geometry is unknown: an `ArmModel`, or a `Robot` of several.

    Attributes:
        readings: the joints that have a column in the samples, in the order of the columns.
        segments: the joints of all chains, each once.
        loop_segments: the joints of closed loops that are on no chain.
        parameters: every placement and offset that could be unknown, all at nominal.
        nongeometric: errors beside the geometry, such as gain or compliance; zero at nominal.
        grades: how it was made, of `measurements.scale.GRADES`; empty if nobody says it. In a cell
            by robot, else by no name.
    """

    readings: tuple[ChainJoint, ...]
    segments: tuple[Segment, ...]
    loop_segments: tuple[Segment, ...]
    parameters: ParameterSet
    nongeometric: ParameterSet
    grades: Mapping[str, str]

    @property
    @abstractmethod
    def chained(self) -> tuple[Chain, ...]:
        """The chains as the URDF's text gives them, one or several."""

    @property
    @abstractmethod
    def urdf(self) -> tuple[Path, bytes]:
        """The URDF it was read from: the file, or what messages call a given text; its bytes."""

    @property
    @abstractmethod
    def geometric(self) -> frozenset[str]:
        """Names the word ``geometric`` stands for: placements of moving joints and of the tips."""

    @abstractmethod
    def at(self, values: Mapping[str, float]) -> Mechanism:
        """The same with these values as its nominal ones."""

    @abstractmethod
    def check_masses(self, names: Iterable[str]) -> None:
        """Refuse joints on which nothing hangs: their compliance would do nothing.

        Raises:
            UrdfError: a name is the compliance of such a joint.
        """

    @abstractmethod
    def masses_felt(self, chosen: Container[str]) -> set[str]:
        """Names of the masses at which gravity deflects it.

        Args:
            chosen: names of compliances that are unknown; others count where they are not zero.
        """

    @abstractmethod
    def origins(self, values: Mapping[str, float]) -> Origins:
        """Position (3,), m, and rpy (3,), rad, of every joint's origin as in `calibrated_urdf`."""

    @property
    def grade(self) -> str:
        """How all of it was made; empty if nobody says it, or if the robots of a cell differ."""
        made = {*self.grades.values()}
        return made.pop() if len(made) == 1 else ""

    def maker(self, owner: str) -> str:
        """By which of `grades` a joint was made."""
        robot, _, _ = owner.partition("/")
        return robot if robot in self.grades else ""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that have a reading: the columns of a samples file."""
        return tuple(joint.name for joint in self.readings)

    @property
    def tips(self) -> tuple[str, ...]:
        """Names that the parameters of the tips carry."""
        return tuple(chain.tip for chain in self.chained)

    @property
    def robot(self) -> str:
        """Name of the robot in its URDF."""
        return self.chained[0].robot

    @cached_property
    def units(self) -> dict[str, Unit]:
        """Unit of the reading of each of `joints`: rad, or m."""
        return {j.name: "m" if j.type == "prismatic" else "rad" for j in self.readings}

    @cached_property
    def movers(self) -> tuple[Segment, ...]:
        """The segments that readings move: those with one and those that follow one.

        Those of closed loops beside the chain are among them.
        """
        return tuple(s for s in (*self.segments, *self.loop_segments) if s.read)

    @cached_property
    def read_from(self) -> dict[str, str]:
        """Which of `joints` moves each of `movers`, by name: itself, or the one it mimics."""
        return {s.owner: self.joints[s.column] for s in self.movers}

    @cached_property
    def couplings(self) -> dict[str, str]:
        """Names of the couplings of `movers`, with which of `joints` each takes the reading of."""
        return {name: joint for s in self.movers for name, joint in s.couplings.items()}

    @cached_property
    def offsets(self) -> tuple[str, ...]:
        """Names of the offsets of `movers`: what moves the tip as their motion does."""
        return tuple(name for s in self.movers for name in s.names(OFFSET))

    @cached_property
    def like_offsets(self) -> tuple[str, ...]:
        """Names of what moves a joint's origin along or about the joint's axis, as its offset does.

        Only of joints whose axis is one of the axes in which the origin is moved.
        """
        names = []
        for joint in self._moving_joints:
            slides = joint.type == "prismatic"
            axis = np.abs(rotation_from_rpy(joint.rpy) @ joint.axis if slides else joint.axis)
            if axis.max() > 1.0 - 1e-9:
                names.append(f"{joint.name}.{(POSITION if slides else ROTATION)[axis.argmax()]}")
        return tuple(dict.fromkeys(names))

    @cached_property
    def gearing(self) -> FloatArray:
        """(movers, joints) how far each of `movers` goes per unit of each reading.

        The tip's velocity per reading is its velocity per offset times this, which is the identity
        for an arm without a mimic or a coupling.
        """
        matrix = np.zeros((len(self.movers), len(self.joints)))
        for row, segment in zip(matrix, self.movers, strict=True):
            row[segment.column] = segment.multiplier
            for name, joint in segment.couplings.items():
                row[segment.others[joint]] = self.nongeometric[name].nominal
        return matrix

    @property
    def _moving_joints(self) -> tuple[ChainJoint, ...]:
        """All joints that move, those without a reading of their own included, each once."""
        every = (joint for chain in self.chained for joint in (*chain.joints, *chain.beside))
        moving = (joint for joint in every if joint.moving and not joint.passive)
        return tuple({joint.name: joint for joint in moving}.values())

    @cached_property
    def offered(self) -> ParameterSet:
        """`parameters`, then `nongeometric`: all that can be selected."""
        return ParameterSet([*self.parameters.values(), *self.nongeometric.values()])

    def select(self, *rows: Selection | str) -> ParameterSet:
        """The parameters that are to be estimated; strings stand for unbounded selections.

        Raises:
            ParameterError: a row that fits no parameter.
            UrdfError: a joint's compliance is selected, and nothing beyond it has a mass.
        """
        selections = [r if isinstance(r, Selection) else Selection((r,)) for r in rows]
        chosen = select_parameters(self.offered, self.geometric, selections)
        self.check_masses(chosen)
        return chosen

    def check_masses_felt(self, chosen: ParameterSet) -> None:
        """Refuse unknown masses that no compliance, unknown or not zero, makes visible.

        Raises:
            ParameterError: names the first of them.
        """
        felt = self.masses_felt(chosen)
        for parameter in chosen.values():
            if parameter.key == MASS and parameter.name not in felt:
                raise ParameterError(
                    f"{parameter.name}, but no compliance of a joint that carries this mass",
                    "a mass beside joint.compliance, compliance_x or compliance_y: a mass moves "
                    "the tip only where a joint yields to it",
                    where="parameters: select",
                    hint=f"select {parameter.owner}.compliance_x too, or do not select the mass",
                )

    def calibrated_urdf(self, values: Mapping[str, float]) -> bytes:
        """The user's own URDF with these values in the origins of its joints, for raw readings.

        Args:
            values: parameter values by name; those of other things than this arm are ignored, and
                so is what is no geometry: a URDF cannot hold it.
        """
        return urdf_bytes(*self.urdf, self.origins(values))

    def calibrated_urdfs(self, values: Mapping[str, float]) -> dict[str, bytes]:
        """`calibrated_urdf` of each robot of a cell, by its name; empty for a robot alone."""
        del values
        return {}

    def write_urdf(self, destination: str | Path, values: Mapping[str, float]) -> None:
        """Write `calibrated_urdf` of these values to a file.

        Of a cell it has all robots in it; the URDF of each is beside it, as ``NAME_robot.urdf``.

        Raises:
            OutputError: the file could not be written; nothing is left half-written.
        """
        path = Path(destination)
        write_bytes_atomically(path, self.calibrated_urdf(values))
        for robot, data in self.calibrated_urdfs(values).items():
            write_bytes_atomically(path.with_name(f"{path.stem}_{robot}{path.suffix}"), data)


def union(sets: Sequence[ParameterSet]) -> ParameterSet:
    """Parameters of several chains, each once: those that they share are one unknown."""
    by_name = {name: p for parameters in reversed(sets) for name, p in parameters.items()}
    order = dict.fromkeys(name for parameters in sets for name in parameters)
    return ParameterSet(by_name[name] for name in order)
