"""An artefact certified from raw points: its landmarks, their uncertainty, and what is damaged.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.certification.points import CertificationOptions as CertificationOptions
    from suta_calib.certification.points import RawPoints as RawPoints
    from suta_calib.certification.points import read_raw_points as read_raw_points
    from suta_calib.certification.procedure import certify as certify
    from suta_calib.certification.result import Certification as Certification
    from suta_calib.certification.result import CertifiedLandmark as CertifiedLandmark
    from suta_calib.certification.result import write_certified as write_certified

__getattr__, __all__ = public(__name__)
