"""The plan as data: what was asked for, what was chosen, what it brings."""

from __future__ import annotations

from dataclasses import dataclass, field

from suta_calib.analysis.planning.candidates import Candidate, Unreachable
from suta_calib.analysis.planning.forecast import Forecast
from suta_calib.analysis.planning.generate import Pool
from suta_calib.analysis.planning.region import Region
from suta_calib.analysis.planning.remedies import Remedy
from suta_calib.analysis.planning.situation import Situation
from suta_calib.arrays import FloatArray


@dataclass(frozen=True)
class PlanOptions:
    """What is asked for.

    Attributes:
        count: how many candidates to choose.
        criterion: ``tip``, its root mean square uncertainty in the region, or ``d``, the volume of
            the parameters' confidence ellipsoid.
        repeats: of the landmarks of a placement; as in the present data by default.
        target: uncertainty of the tip to be reached, m, or None.
        least_gain: share by which one more candidate must lessen the tip's uncertainty to be worth
            the work.
        horizon: how many candidates to look ahead to say when to stop.
        random: random choices of the same size, to compare with.
        pool: of the automatic search.
        seed: of every random number.
    """

    count: int = 3
    criterion: str = "tip"
    repeats: int | None = None
    target: float | None = None
    least_gain: float = 0.05
    horizon: int = 12
    random: int = 200
    pool: Pool = field(default_factory=Pool)
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Choice:
    """One candidate of the plan, in the order of what they bring.

    Attributes:
        candidate: what to measure.
        tip: root mean square uncertainty of the tip in the region once it is measured, m.
        gain: share by which it lessens that.
        bits: how much it lessens the log volume of the parameters' confidence ellipsoid, bits.
        identifies: parameters that are open before and told once it is measured too.
    """

    candidate: Candidate
    tip: float
    gain: float
    bits: float
    identifies: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Best:
    """The best that as many samples as the present ones could tell, from the candidates.

    Attributes:
        names: of the candidates.
        count: how many of them make as many samples.
        tip: root mean square uncertainty of the tip in the region, m.
        present: the same of the present data.
        efficiency: share of the samples with which the best set would tell as much of the tip.
        d_efficiency: the same of the parameters as a whole.
    """

    names: tuple[str, ...]
    count: int
    tip: float
    present: float
    efficiency: float
    d_efficiency: float


@dataclass(frozen=True)
class Stop:
    """When to stop.

    Attributes:
        tips: root mean square uncertainty of the tip after 0, 1, 2, … further candidates, m.
        worthwhile: how many lessen it by the stated share each; None if the last one looked at
            still does.
        least_gain: that share.
        target: uncertainty to be reached, m, or None.
        needed: how many reach the target; None if those looked at do not, or there is no target.
    """

    tips: tuple[float, ...]
    worthwhile: int | None
    least_gain: float
    target: float | None
    needed: int | None


@dataclass(frozen=True, eq=False)
class Plan:
    """The answer.

    Attributes:
        situation: where it starts.
        options: what was asked for.
        region: where the tip shall be sure.
        candidates, unreachable: what could be chosen, and what not.
        collisions: what was checked.
        before, after: what is predicted of every parameter and the tip.
        chosen: the plan, best first.
        best: what the best possible set of the present size reaches.
        random: (sets,) uncertainty of the tip for random choices of the plan's size, m.
        stop: when to stop.
        remedies: what makes unidentified parameters identified.
    """

    situation: Situation
    options: PlanOptions
    region: Region
    candidates: tuple[Candidate, ...]
    unreachable: tuple[Unreachable, ...]
    collisions: str
    before: Forecast
    after: Forecast
    chosen: tuple[Choice, ...]
    best: Best
    random: FloatArray
    stop: Stop
    remedies: tuple[Remedy, ...]
