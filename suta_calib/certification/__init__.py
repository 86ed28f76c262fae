"""An artefact certified from raw points: its landmarks, their uncertainty, and what is damaged.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import lazily

if TYPE_CHECKING:
    from suta_calib.certification.points import (
        CertificationOptions,
        RawPoints,
        read_raw_points,
    )
    from suta_calib.certification.procedure import certify
    from suta_calib.certification.result import (
        Certification,
        CertifiedLandmark,
        write_certified,
    )

_HOMES = {
    "points": ("CertificationOptions", "RawPoints", "read_raw_points"),
    "procedure": ("certify",),
    "result": ("Certification", "CertifiedLandmark", "write_certified"),
}

__all__ = [
    "Certification",
    "CertificationOptions",
    "CertifiedLandmark",
    "RawPoints",
    "certify",
    "read_raw_points",
    "write_certified",
]

__getattr__ = lazily(__name__, _HOMES)
