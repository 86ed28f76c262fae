"""Compares two arms on the same validation data: the job's URDF and another one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.errors import UrdfError
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.model.chain import Chain, chain_of
from suta_calib.model.parameters import ParameterSet
from suta_calib.model.robot import AnyArm, same_chain
from suta_calib.model.urdf_tree import read_tree
from suta_calib.terms import ArmPoses, Term
from suta_calib.trust.accuracy import (
    Gain,
    TermAccuracy,
    added_by_estimates,
    block_residuals,
    fit_own,
    gain_of,
    read_where_fitted,
    term_accuracies,
)
from suta_calib.units import text
from suta_calib.words import listed


@dataclass(frozen=True, eq=False)
class ArmComparison:
    """Errors of held-out terms with the job's own arm (before) and with another (after)."""

    terms: tuple[TermAccuracy, ...]  # one for each held-out term
    # Mean square that the other arm's covariance adds to their lengths, m²; zero where the
    # covariance is not known.
    unsure: float = 0.0
    unsure_std: float = 0.0  # standard deviation of that, m²
    rows_in_fit: int = 0  # held-out rows that were read where rows of the job's observations were
    left_out: tuple[str, ...] = ()  # what the job estimates, but the other arm's URDF cannot hold

    @cached_property
    def gain(self) -> Gain:
        """Difference of the errors of both arms, with its significance."""
        gain = gain_of(self.terms, self.unsure, self.unsure_std)
        assert gain is not None
        return gain

    @cached_property
    @judged
    def assessment(self) -> Assessment:
        """Care if the other arm is worse or the data show no difference; always usable."""
        gain = self.gain
        job_rms, this = (text(rms, gain.unit, with_unit=True) for rms in (gain.before, gain.after))
        care = []
        if gain.worse:
            care.append("The given URDF is worse than the job's URDF on these data.")
        elif not gain.better:
            care.append(
                "These data do not show a difference between the given URDF and the job's URDF."
            )
        if self.rows_in_fit:
            rows = sum(len(accuracy.term.poses) for accuracy in self.terms)
            care.append(
                f"{self.rows_in_fit} of {rows} validation rows have the same postures as rows of "
                "the job's observations. If the given arm was fitted to those observations, this "
                "comparison is valid only at these postures."
            )
        sentence = f"RMS {job_rms} with the job's URDF, {this} with this one"
        if 0.0 < abs(gain.significance) < math.inf:
            sentence += f" ({abs(gain.significance):.1f} standard errors apart)"
        facts = []
        if self.left_out:
            facts.append(
                f"The job estimates {listed(self.left_out, 4)}. No URDF holds these values, so they"
                " are left out here. To include them, give the result that was written with this "
                "URDF: --result result.json."
            )
        return Assessment.of(sentence, care=care, facts=facts)


def compare_arms(
    observations: Sequence[Term],
    validation: Sequence[Term],
    other: AnyArm,
    beside_geometry: Mapping[str, float] = MappingProxyType({}),
    uncertainty: tuple[Sequence[str], FloatArray] | None = None,
) -> ArmComparison:
    """Errors on the validation rows with the terms' own arm (before) and another (after).

    Both arms are held as they are. A term's own unknown that has the same name in the
    observations is fitted there, with the arm in question; one that is new is fitted on the
    validation rows. ``beside_geometry`` are the other arm's gains, eccentricities and compliances,
    ``uncertainty`` is what of it was estimated, with the covariance, where that is known.
    """
    nothing = ParameterSet()
    before = block_residuals(validation, nothing, _fitted(observations, validation, nothing))
    judged = [_through(term, other) for term in validation]
    fixed = other.select(*beside_geometry) if beside_geometry else ParameterSet()
    fitted = [_through(term, other) for term in observations]
    values = _fitted(fitted, judged, fixed, beside_geometry)
    terms = term_accuracies(validation, before, block_residuals(judged, fixed, values))
    # Rows that were fitted were read where they are.
    rows_in_fit = int(read_where_fitted(observations, validation).sum())
    if uncertainty is None or not uncertainty[0]:
        return ArmComparison(terms, rows_in_fit=rows_in_fit)
    names, covariance = uncertainty
    estimated = other.select(*names)
    at = {p.name: p.nominal for p in estimated.values()} | values
    first = [term for term in judged if term.kind == judged[0].kind]
    added = added_by_estimates(first, estimated, at, names, covariance)
    return ArmComparison(terms, *added, rows_in_fit)


def check_calibrated(nominal: AnyArm, other: AnyArm, values: Mapping[str, float]) -> None:
    """Refuse the calibrated arm (``other``) of values that were not folded into its URDF."""
    if differing := _differing(nominal, other.chained, values):
        raise UrdfError(
            f"the origin of {differing} differs from the values of the result",
            "the calibrated.urdf that was written with this result",
            file=other.urdf[0],
            where=differing,
        )


def check_nominal(nominal: AnyArm, result: Path, values: Mapping[str, float]) -> None:
    """Refuse an arm from which a ``result.json`` was not made, as the URDF beside it tells."""
    names = ("calibrated.urdf", "not_usable.urdf")
    for made in filter(Path.exists, (result.with_name(name) for name in names)):
        tree = read_tree(made)
        other = [chain_of(tree, chain.tip, chain.base) for chain in nominal.chained]
        same_joints = all(
            [joint.name for joint in one.joints] == [joint.name for joint in its.joints]
            for one, its in zip(other, nominal.chained, strict=True)
        )
        differing = _differing(nominal, other, values) if same_joints else ""
        if not same_joints or differing:
            what = f"the origin of {differing}" if same_joints else "the joints"
            raise UrdfError(
                f"an arm that was not the one calibrated: {what} differ from those in {made.name}",
                f"the URDF from which {made} was made",
                file=nominal.urdf[0],
                hint="give the URDF, --tip and --base of the calibrated job",
            )
        return


def _differing(nominal: AnyArm, other: Sequence[Chain], values: Mapping[str, float]) -> str:
    """The first joint whose origin is not what these values make of the nominal one, if any."""
    made = nominal.origins(values)
    for joint in (joint for chain in other for joint in chain.joints):
        xyz, rpy = made.get(joint.name, (joint.xyz, joint.rpy))
        turn = rotation_from_rpy(rpy).T @ rotation_from_rpy(joint.rpy)
        difference = max(
            float(np.abs(xyz - joint.xyz).max()), float(np.abs(turn - np.eye(3)).max())
        )
        # Origins that differ by less, m or rad, were rounded when they were written.
        if difference > 1e-7:
            return joint.name
    return ""


def _fitted(
    observations: Sequence[Term],
    validation: Sequence[Term],
    fixed: ParameterSet,
    fitted_values: Mapping[str, float] = MappingProxyType({}),
) -> dict[str, float]:
    """Values of the validation terms' own unknowns, the arm held."""
    shared = {p.name for term in validation for p in term.own_parameters}
    sharing = [t for t in observations if any(p.name in shared for p in t.own_parameters)]
    return fit_own(validation, fixed, fit_own(sharing or validation, fixed, fitted_values))


def _through(term: Term, other: AnyArm) -> Term:
    """The same observations with another arm behind the readings."""
    if not isinstance(term.poses, ArmPoses):
        return term
    of_job = term.poses.arm
    arm = same_chain(of_job, other)
    if arm.joints != of_job.joints:
        raise UrdfError(
            f"the moving joints {', '.join(arm.joints)}",
            f"the joints of the job's arm: {', '.join(of_job.joints)}",
            file=arm.chain.path,
        )
    return term.over_poses(ArmPoses(arm, term.poses.samples))
