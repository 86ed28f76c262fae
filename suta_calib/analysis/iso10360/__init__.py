"""Acceptance test of an articulated arm after ISO 10360-12: errors, limits, decisions."""

from suta_calib.analysis.iso10360.acceptance import (
    AcceptanceMeasurements,
    AcceptanceTest,
    Characteristic,
    accept,
    acceptance_test,
)
from suta_calib.analysis.iso10360.measured import (
    Articulation,
    LengthErrors,
    Repeats,
    Sphere,
    SphereProbing,
    articulations,
    best_sphere,
    probings,
    repeats,
    smallest_sphere,
)
from suta_calib.job.limits import (
    Decision,
    DecisionRule,
    LengthLimit,
    Limits,
    Rule,
    StatedUncertainty,
)

__all__ = [
    "AcceptanceMeasurements",
    "AcceptanceTest",
    "Articulation",
    "Characteristic",
    "Decision",
    "DecisionRule",
    "LengthErrors",
    "LengthLimit",
    "Limits",
    "Repeats",
    "Rule",
    "Sphere",
    "SphereProbing",
    "StatedUncertainty",
    "accept",
    "acceptance_test",
    "articulations",
    "best_sphere",
    "probings",
    "repeats",
    "smallest_sphere",
]
