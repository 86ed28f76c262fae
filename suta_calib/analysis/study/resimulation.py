"""The measurement repeated in simulation, as if a solution were the truth.

Samples that touched something get readings that bring the calibrated tip to where it should have
been, plus noise: the nearest posture to the measured one. Samples that were seen from afar get what
the instrument would have seen, plus noise. Noise is normal, of the size the residuals showed. What
each kind touches or sees is its own to say (`Term.observed`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.simulation.noise import scattered_rotations
from suta_calib.terms import Term
from suta_calib.terms.poses import ArmPoses, PoseSource
from suta_calib.terms.term import Observed


def resimulated(
    terms: Sequence[Term],
    values: Mapping[str, float],
    noise: Sequence[float],
    random: np.random.Generator,
) -> tuple[Term, ...]:
    """The terms over simulated samples, as many as there were and in nearly the same postures.

    Args:
        terms: over an arm's samples.
        values: what is taken for the truth: of the arm and of the terms' own unknowns, m or rad.
        noise: of each block of each term, in order, m or rad per component of its residual.
        random: source of the noise.

    Raises:
        SamplesError: a kind that has no such simulation, or readings that would touch a target
            cannot be found.
    """
    levels, noisy = iter(noise), _Noisy(values, random)
    return tuple(
        term.resimulated(values, [next(levels) for _ in term.blocks], noisy) for term in terms
    )


@dataclass(frozen=True, eq=False)
class _Noisy:
    """A `Resimulation` by inverse kinematics and normal noise."""

    values: Mapping[str, float]
    random: np.random.Generator

    def touched(self, poses: PoseSource, target: FloatArray, sigma: float) -> PoseSource:
        assert isinstance(poses, ArmPoses)
        rotation, _ = poses.at(self.values)
        reached = target + sigma * self.random.standard_normal(target.shape)
        kinematics = InverseKinematics(poses.arm, self.values)
        wanted = Targets(reached, rotation, "position")
        found = kinematics.solve(wanted, poses.samples.q, self.random, starts=1)
        for row in np.flatnonzero(found.distance > max(sigma, 1e-6) / 10):
            raise SamplesError(
                "a sample whose touch cannot be simulated: no posture nearby reaches it",
                "an arm that can move its tip in all three directions there",
                where=poses.samples.origin[row],
            )
        return poses.with_samples(replace(poses.samples, q=found.q))

    def seen(self, poses: PoseSource, seen: Observed, noise: Sequence[float]) -> PoseSource:
        scatter = noise[0] * self.random.standard_normal(seen.position.shape)
        samples = replace(poses.samples, position=seen.position + scatter)
        if len(noise) > 1 and seen.rotation is not None:
            samples = replace(samples, rotation=self.turned(seen.rotation, noise[1]))
        return poses.with_samples(samples)

    def turned(self, rotation: FloatArray, sigma: float) -> FloatArray:
        return np.asarray(rotation @ scattered_rotations(self.random, sigma, len(rotation)))
