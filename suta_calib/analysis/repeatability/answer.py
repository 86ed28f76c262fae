"""All that `suta-calib repeatability` may look at, as one answer."""

from __future__ import annotations

from dataclasses import dataclass

from suta_calib.analysis.repeatability.at_rest import Stationary
from suta_calib.analysis.repeatability.touches import RepeatedTouches
from suta_calib.analysis.repeatability.visits import Repeatability
from suta_calib.assessment import Assessment, judged
from suta_calib.showing import Displayable


@dataclass(frozen=True, eq=False)
class RepeatabilityTest(Displayable):
    """Visits to one point, repeats of many, encoders at rest; None for what was not looked at."""

    visits: Repeatability | None = None
    rest: Stationary | None = None
    touches: RepeatedTouches | None = None

    @property
    @judged
    def assessment(self) -> Assessment:
        """The worst of them, with the notes of all."""
        looked_at = (self.visits, self.touches, self.rest)
        given = [judgement.assessment for judgement in looked_at if judgement is not None]
        bad = [note for judgement in given if not judgement.usable for note in judgement.notes]
        care = [note for judgement in given if judgement.usable for note in judgement.notes]
        return Assessment.of("; ".join(item.sentence for item in given), bad=bad, care=care)
