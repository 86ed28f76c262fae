"""Acceptance test of an articulated arm after ISO 10360-12: errors, limits, decisions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.analysis.iso10360.acceptance import (
        AcceptanceMeasurements as AcceptanceMeasurements,
    )
    from suta_calib.analysis.iso10360.acceptance import AcceptanceTest as AcceptanceTest
    from suta_calib.analysis.iso10360.acceptance import Characteristic as Characteristic
    from suta_calib.analysis.iso10360.acceptance import accept as accept
    from suta_calib.analysis.iso10360.acceptance import acceptance_test as acceptance_test
    from suta_calib.analysis.iso10360.measured import Articulation as Articulation
    from suta_calib.analysis.iso10360.measured import LengthErrors as LengthErrors
    from suta_calib.analysis.iso10360.measured import Repeats as Repeats
    from suta_calib.analysis.iso10360.measured import Sphere as Sphere
    from suta_calib.analysis.iso10360.measured import SphereProbing as SphereProbing
    from suta_calib.analysis.iso10360.measured import articulations as articulations
    from suta_calib.analysis.iso10360.measured import best_sphere as best_sphere
    from suta_calib.analysis.iso10360.measured import probings as probings
    from suta_calib.analysis.iso10360.measured import repeats as repeats
    from suta_calib.analysis.iso10360.measured import smallest_sphere as smallest_sphere
    from suta_calib.job.limits import Decision as Decision
    from suta_calib.job.limits import DecisionRule as DecisionRule
    from suta_calib.job.limits import LengthLimit as LengthLimit
    from suta_calib.job.limits import Limits as Limits
    from suta_calib.job.limits import Rule as Rule
    from suta_calib.job.limits import StatedUncertainty as StatedUncertainty

__getattr__, __all__ = public(__name__)
