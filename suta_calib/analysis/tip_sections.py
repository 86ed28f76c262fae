"""Sections through the workspace: where the tip can be, and its uncertainty there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from suta_calib.analysis.planning.region import Region
from suta_calib.analysis.planning.situation import readings_of
from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import rotation_from_vector, vector_turning_z_to
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.solver.solution import Solution
from suta_calib.trust.tip import Sensitivity, sensitivity


@dataclass(frozen=True, eq=False)
class Knowledge(Displayable):
    """An arm as a calibration left it.

    Attributes:
        arm: the nominal arm.
        values: calibrated values by name, m or rad.
        names, covariance: p parameters that were estimated, and (p, p) how surely.
        fixed: parameters that were not: what is said holds relative to them.
        visited: (m, joints) readings of the samples; anywhere where none is known.
        open_directions: what the data left open: change of each parameter, and the plausible size.
    """

    arm: ArmModel
    values: Mapping[str, float]
    names: tuple[str, ...]
    covariance: FloatArray
    fixed: tuple[str, ...]
    visited: FloatArray
    open_directions: tuple[tuple[str, Mapping[str, float], float], ...] = ()

    @classmethod
    def of(cls, solution: Solution, chain: str = "") -> Knowledge:
        """From a solution, for the arm or a chain, with the readings of its samples."""
        problem = solution.problem
        assert problem.arm is not None
        arm = problem.arm.chosen(chain)
        parameters, (names, covariance) = problem.arm_parameters, solution.arm_covariance
        return cls(
            arm=arm,
            values=solution.values,
            names=names,
            covariance=covariance,
            fixed=tuple(n for n in solution.unidentified if n in parameters),
            visited=readings_of(problem, arm),
            open_directions=tuple(
                (c.fixed, c.direction, parameters[c.fixed].plausible)
                for c in solution.identification.combinations
                if c.fixed in parameters
            ),
        )

    @classmethod
    def unvisited(
        cls,
        arm: ArmModel,
        values: Mapping[str, float],
        names: Sequence[str],
        covariance: FloatArray,
        fixed: Sequence[str],
        open_directions: Sequence[tuple[str, Mapping[str, float], float]] = (),
    ) -> Knowledge:
        """From a result without samples: postures anywhere within the joint limits."""
        # Postures to start searches from where nothing is known of any.
        q = InverseKinematics(arm, {}).random_readings(np.random.default_rng(0), 400)
        return cls(arm, values, tuple(names), covariance, tuple(fixed), q, tuple(open_directions))

    @cached_property
    def kinematics(self) -> InverseKinematics:
        """Inverse kinematics of the calibrated arm."""
        return InverseKinematics(self.arm.at(self.values), {})

    @cached_property
    def farthest(self) -> float:
        """Largest distance of the tip from the base, m."""
        q = self.kinematics.random_readings(np.random.default_rng(0), 4000)
        _, position = self.arm.forward(q, self.values)
        # Beyond the farthest the tip gets, nothing needs to be tried.
        return 1.02 * float(np.linalg.norm(position, axis=1).max())

    def at(self, q: FloatArray) -> Sensitivity:
        """The tip and its derivative by the estimated parameters."""
        return sensitivity(self.arm, self.values, self.names, q)


@dataclass(frozen=True, eq=False)
class Slice:
    """One section through the workspace."""

    name: str  # ``side`` or ``top``
    # (3,) unit vectors of the section's axes in the base, the first horizontal.
    along: FloatArray
    up: FloatArray
    origin: FloatArray  # (3,) where both coordinates are zero, m
    # Coordinates of the grid, m.
    u: FloatArray
    v: FloatArray
    # (v, u) 3-D standard uncertainty, m; NaN out of reach.
    registered: FloatArray
    absolute: FloatArray

    def project(self, points: FloatArray) -> FloatArray:
        """(n, 2) coordinates of points (n, 3) in the section's plane."""
        away = points - self.origin
        return np.stack([away @ self.along, away @ self.up], axis=1)


@dataclass(frozen=True, eq=False)
class Walker(Displayable):
    """Postures for tip positions, each like its neighbours', so that the map is smooth."""

    knowledge: Knowledge
    axis: FloatArray
    seed: int

    def reach(self, places: FloatArray, near: float = 0.0) -> FloatArray:
        """Readings that bring the tip to places, outward from the postures that were visited.

        Args:
            places: (n, 3) places in the base, m.
            near: what also counts as reached by an arm that cannot bring its tip to any place, but
                only along a line or a surface, m.

        Returns:
            (n, joints), NaN out of reach.
        """
        knowledge = self.knowledge
        attainable = knowledge.kinematics.attainable["position"]
        _, reached_places = knowledge.arm.forward(knowledge.visited, knowledge.values)
        readings = knowledge.visited
        turned = rotation_from_vector(vector_turning_z_to(self.axis))
        rotation = np.tile(turned, (len(places), 1, 1))
        found_readings = np.full((len(places), readings.shape[1]), np.nan)
        order = np.argsort(KDTree(reached_places).query(places)[0], kind="stable")
        starts = 3
        for rows in np.array_split(order, min(8, len(order))):
            rows = rows[np.linalg.norm(places[rows], axis=1) <= knowledge.farthest]
            if not len(rows):
                continue
            start = readings[KDTree(reached_places).query(places[rows])[1]]
            targets = Targets(places[rows], rotation[rows], knowledge.kinematics.most("axis"))
            answer = knowledge.kinematics.solve(
                targets, start, np.random.default_rng(self.seed), starts
            )
            reached = answer.reached | ((answer.distance <= near) & (not attainable))
            good = rows[reached]
            found_readings[good] = answer.q[reached]
            reached_places = np.vstack([reached_places, places[good]])
            readings = np.vstack([readings, found_readings[good]])
        return found_readings


def slices(walker: Walker, region: Region, reference: Sensitivity, grid: int) -> tuple[Slice, ...]:
    """The vertical plane through the base's z axis and the region, and a horizontal one in it."""
    far = walker.knowledge.farthest
    centre = (region.lower + region.upper) / 2
    towards = math.atan2(centre[1], centre[0])
    ahead = np.array([math.cos(towards), math.sin(towards), 0.0])
    x, y, z = np.eye(3)
    planes = (("side", ahead, z, 0.0 * z), ("top", x, y, centre[2] * z))
    wide = np.linspace(-far, far, grid)
    covariance = walker.knowledge.covariance
    sections = []
    for name, along, up, origin in planes:
        places = origin + wide[None, :, None] * along + wide[:, None, None] * up
        q = walker.reach(places.reshape(-1, 3), near=(wide[1] - wide[0]) / 2)
        good = np.isfinite(q).all(axis=1)
        registered, absolute = np.full((2, len(q)), np.nan)
        if good.any():
            at = walker.knowledge.at(q[good])
            registered[good] = at.std(covariance, at.registered(reference))
            absolute[good] = at.std(covariance)
        stds = (std.reshape(grid, grid) for std in (registered, absolute))
        sections.append(Slice(name, along, up, origin, wide, wide, *stds))
    return tuple(sections)
