"""How far an answer may be trusted: one statistical test, and what it is asked about.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.trust.evidence import Effect as Effect
    from suta_calib.trust.evidence import Evidence as Evidence
    from suta_calib.trust.evidence import LinearFit as LinearFit
    from suta_calib.trust.evidence import Rule as Rule
    from suta_calib.trust.evidence import supported_effects as supported_effects
    from suta_calib.trust.evidence import weigh_effects as weigh_effects
    from suta_calib.trust.examination import Examination as Examination
    from suta_calib.trust.hypothesis import AddedVariable as AddedVariable
    from suta_calib.trust.hypothesis import Finding as Finding
    from suta_calib.trust.hypothesis import Hypothesis as Hypothesis
    from suta_calib.trust.hypothesis import Reinterpretation as Reinterpretation
    from suta_calib.trust.hypothesis import Spoilt as Spoilt
    from suta_calib.trust.hypothesis import examine as examine
    from suta_calib.trust.hypothesis import known_hypotheses as known_hypotheses

__getattr__, __all__ = public(__name__)
