"""All that `suta-calib repeatability` may look at, as one answer."""

from __future__ import annotations

from dataclasses import dataclass

from suta_calib.analysis.repeatability.at_rest import Stationary
from suta_calib.analysis.repeatability.touches import RepeatedTouches
from suta_calib.analysis.repeatability.visits import Repeatability
from suta_calib.assessment import Assessment, judged
from suta_calib.showing import Shown


@dataclass(frozen=True, eq=False)
class RepeatabilityTest(Shown):
    """Visits to one point, repeats of many, encoders at rest; None for what was not looked at."""

    visits: Repeatability | None = None
    rest: Stationary | None = None
    touches: RepeatedTouches | None = None

    @property
    @judged
    def assessment(self) -> Assessment:
        """The worst of them, with the notes of all."""
        looked_at = (self.visits, self.touches, self.rest)
        given = [each.assessment for each in looked_at if each is not None]
        bad = [note for each in given if not each.usable for note in each.notes]
        care = [note for each in given if each.usable for note in each.notes]
        return Assessment.of("; ".join(each.sentence for each in given), bad=bad, care=care)
