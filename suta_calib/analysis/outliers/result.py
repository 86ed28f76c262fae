"""Result of the search for outliers, with its verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np

from suta_calib import plotting
from suta_calib.analysis import outliers
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.solver.problem import assumed_sigma
from suta_calib.solver.solution import Solution
from suta_calib.terms import Term, every_grouping
from suta_calib.units import Unit, mm, shown, unit_name

Metric = Literal["contribution", "cooks_distance", "leave_one_out", "bias"]
METRICS: Final[tuple[Metric, ...]] = ("contribution", "cooks_distance", "leave_one_out", "bias")
# Unit of each metric, the head of its column, and the title of its plot.
METRIC_LABELS: Final[dict[Metric, tuple[Unit, str, str]]] = {
    "contribution": ("%", "share %", "Error contribution, %"),
    "cooks_distance": ("1", "Cook", "Cook's distance"),
    "leave_one_out": ("%", "l.o.o. %", "RMS reduction when left out, %"),
    "bias": ("m", "bias mm", "Bias after registration, mm"),
}


def metric_labels(metric: Metric, unit: Unit) -> tuple[Unit, str, str]:
    """`METRIC_LABELS`, where touches are off by angles or other numbers than lengths."""
    if metric != "bias":
        return METRIC_LABELS[metric]
    name = unit_name(unit)
    return unit, f"bias {name}".rstrip(), f"Bias after registration, {name}".rstrip(", ")


# Metrics that must agree before something is called an outlier. Each has a blind spot: a wrong
# landmark without leverage moves no parameter (Cook), one displaced across its distances hardly
# changes them (contribution, leave-one-out), and one whose shift a short series of touches can
# take for noise has no certain bias. Three of four leaves room for one blind spot, and no single
# metric convicts.
AGREEMENT: Final = 3
GROUPING_NOUN: Final = {f"{noun}s": noun for noun in every_grouping()}
WORDS: Final = {
    "contribution": "error contribution",
    "cooks_distance": "Cook's distance",
    "leave_one_out": "leave-one-out RMS",
    "bias": "bias",
}


@dataclass(frozen=True)
class Thresholds:
    """Thresholds of the metrics.

    Attributes:
        contribution: share of the squared errors, in multiples of 1/n for n groups.
        cook: Cook's distance, in multiples of 1/n.
        leave_one_out: relative fall of the RMS.
        bias: systematic error after registration, m.
        significance: probability that chance makes any of the 4 n values so conspicuous.
    """

    contribution: float = 1.5
    cook: float = 4.0
    leave_one_out: float = 0.05
    bias: float = 1e-3
    significance: float = 0.01

    def of(self, metric: Metric, n: int) -> float:
        """The threshold of a metric over n groups, in the metric's unit."""
        limits = (self.contribution / n, self.cook / n, self.leave_one_out, self.bias)
        return limits[METRICS.index(metric)]


@dataclass(frozen=True, eq=False)
class Displacement(Displayable):
    """Difference between the touched and the certified position of a landmark, in the artefact.

    Attributes:
        vector: (3,) touched minus certified position, m.
        std: (3,) its standard deviation, m.
    """

    vector: FloatArray
    std: FloatArray


@dataclass(frozen=True, eq=False)
class Group(Displayable):
    """One landmark, placement, set, point or row.

    Attributes:
        label: what a person calls it.
        samples: how many touches it has.
        values: the four metrics, as judged.
        p: for each, the probability that chance makes any metric of any group so conspicuous.
        flags: metrics that are over their threshold and beyond chance.
        as_calibrated: the metrics in the job's own fit, nothing set aside.
        outlier: whether enough metrics agree.
        displacement: of a landmark that is not where it is certified.
    """

    label: str
    samples: int
    values: Mapping[Metric, float]
    p: Mapping[Metric, float]
    flags: tuple[Metric, ...]
    as_calibrated: Mapping[Metric, float]
    outlier: bool
    displacement: Displacement | None = None

    @property
    def suspect(self) -> bool:
        """Flagged, but not by enough metrics."""
        return bool(self.flags) and not self.outlier


@dataclass(frozen=True, eq=False)
class Level(Displayable):
    """All groups of one sort (``landmarks``, ``rows``, …) in the order of the file.

    ``thresholds`` are those of each metric for so many groups.
    """

    name: str
    groups: tuple[Group, ...]
    thresholds: Mapping[Metric, float]

    @property
    def outliers(self) -> tuple[Group, ...]:
        """Groups that enough metrics mark."""
        return tuple(g for g in self.groups if g.outlier)

    @property
    def suspects(self) -> tuple[Group, ...]:
        """Groups that at least one metric marks."""
        return tuple(g for g in self.groups if g.suspect)


@dataclass(frozen=True)
class GrossTouch:
    """A single touch far beyond the noise of its neighbours.

    Attributes:
        origin: file and line.
        what: was touched.
        size: length of its residual, m.
    """

    origin: str
    what: str
    size: float


@dataclass(frozen=True)
class Move:
    """Rows, from one on, that agree with the others if something is at another place.

    Attributes:
        what: was moved: an instrument, a camera, a placement, a point.
        origin: file and line of the first of them.
        distance: by which it takes them, RMS, m.
        p: probability that chance makes any row look so much like the first after a move.
        left: noise of one coordinate once it, and the moves before it, are allowed for, m.
    """

    what: str
    origin: str
    distance: float
    p: float
    left: float


@dataclass(frozen=True)
class HeldOut:
    """Effect of excluding a group on the validation errors.

    Attributes:
        before, after: RMS, m, over the same held-out rows: all but those of the group itself.
        everything: RMS, m, over all held-out rows after the exclusion.
        count: held-out rows.
    """

    before: float
    after: float
    everything: float
    count: int

    @property
    def change(self) -> float:
        """Relative change; negative where the exclusion helps."""
        return self.after / self.before - 1.0 if self.before > 0 else 0.0


@dataclass(frozen=True, eq=False)
class TermOutliers(Displayable):
    """One observation of the job.

    Attributes:
        kind: of observation.
        levels: its groups by sort.
        touches: single touches that were set aside.
        samples: how many touches there are.
        sigma: noise of one coordinate of one touch, or of one angle or number.
        position: (n, 3) certified positions of the landmarks, m, in the order of the groups.
        held_out: by the name of the level and the label of the group.
        method: ``validation``, or how the rows were held out.
        exact: whether the fit leaves no errors, so that nothing was compared.
        moves: of what was moved between its rows.
        unit: SI unit of its errors: of ``sigma``, of residuals and of the bias.
        chain: of which chain of a robot; empty where it has only one.
    """

    kind: str
    levels: tuple[Level, ...]
    touches: tuple[GrossTouch, ...]
    samples: int
    sigma: float
    position: FloatArray | None = None
    held_out: Mapping[str, Mapping[str, HeldOut]] = field(default_factory=dict)
    method: str = ""
    exact: bool = False
    moves: tuple[Move, ...] = ()
    unit: Unit = "m"
    chain: str = ""

    @property
    def name(self) -> str:
        """Its kind, and of which chain."""
        return f"{self.kind} of {self.chain}" if self.chain else self.kind

    @property
    def unexplained(self) -> float:
        """Scatter of one coordinate that neither the arm's geometry nor a move explains, m."""
        return min(self.sigma, self.moves[-1].left) if self.moves else self.sigma

    @property
    def drawn_over(self) -> str:
        """What a picture of the metrics is drawn over: the artefact, or one group after another."""
        if self.position is not None and self.level("landmarks") is not None:
            return "over the artefact"
        return f"by {GROUPING_NOUN[self.levels[-1].name]}"

    def level(self, name: str) -> Level | None:
        """The level of this name, if the term has it."""
        return next((level for level in self.levels if level.name == name), None)


@dataclass(frozen=True, eq=False, repr=False)
class Outliers(Displayable):
    """Result of the search for outliers in all observations.

    Attributes:
        solution: the job's own fit.
        terms: one entry for each observation.
        thresholds: that were used.
        explaining: names of the arm's parameters that explain systematic errors.
    """

    solution: Solution
    terms: Sequence[TermOutliers]
    thresholds: Thresholds
    explaining: tuple[str, ...]

    @property
    def in_a_line(self) -> str:
        """What was found."""
        return self.assessment.sentence

    def plot(self, term: int = 0, figure: Any = None) -> Any:
        """Draw the four metrics of one observation: over the artefact, or group by group.

        Args:
            term: which of those observations that have groups.
            figure: an empty `Figure` or `SubFigure`; a new one by default.

        Returns:
            The figure.
        """
        figure = plotting.figure_or_new(figure, (9.0, 7.0))
        outliers.draw_metrics(figure, [search for search in self.terms if search.levels][term])
        return figure

    @property
    @judged
    def assessment(self) -> Assessment:
        """What a reader must know: outliers first, then what is suspect or was set aside."""
        solution, terms = self.solution, self.terms
        bad = [] if solution.converged else [f"The calibration itself failed: {solution.sentence}."]
        bad += [
            f"The {t.samples} samples of {t.name} are fitted exactly, because there are as many "
            "unknowns as data. Outliers cannot be found. Measure more, or select fewer "
            "parameters."
            for t in terms
            if t.exact
        ]
        # Times the noise of one coordinate that is stated, or assumed, from which on it is no
        # noise.
        bad += [
            f"The samples of {t.name} scatter by {_size(t.unexplained, t.unit, '.3g')} per axis "
            "for any geometry of the arm. Something is wrong with most of them (a joint's sign, "
            "a unit, rows that do not belong together), so single outliers cannot be found. Run "
            "suta-calib calibrate to find the cause."
            for t, term in zip(terms, solution.problem.terms, strict=True)
            if t.unexplained > 20.0 * _expected(term)
        ]
        levels = [level for t in terms for level in t.levels]
        care = [
            f"{move.what} moved: from {move.origin} on, its rows are {mm(move.distance):.2g} mm "
            f"from the earlier ones (p = {move.p:.1g}). Give the later rows another label, or "
            "measure again."
            for t in terms
            for move in t.moves
        ]
        care += [_accused(level.name, g) for level in levels for g in level.outliers]
        care += [_accused(level.name, g) for level in levels for g in level.suspects]
        care += [_gross(t) for t in terms if t.touches]
        return Assessment.of(_sentence(terms), bad=bad, care=care)

    @property
    def exclusion(self) -> list[dict[str, list[str]]]:
        """For each observation what ``exclude`` would say to leave its outliers out."""
        return [
            {
                level.name: [g.label for g in level.outliers]
                for level in term.levels
                if level.outliers
            }
            for term in self.terms
        ]


def _sentence(terms: Sequence[TermOutliers]) -> str:
    if not any(t.levels for t in terms):
        return "no observation could be checked"
    named = [
        f"{GROUPING_NOUN[level.name]} {', '.join(g.label for g in level.outliers)}"
        for t in terms
        for level in t.levels
        if level.outliers
    ]
    moved = [f"moved during the measurement: {move.what}" for t in terms for move in t.moves]
    named = [f"outliers: {'; '.join(named)}"] if named else []
    if moved or named:
        return "; ".join(moved + named)
    looked = dict.fromkeys(GROUPING_NOUN[level.name] for t in terms for level in t.levels)
    return f"no {' and no '.join(looked)} is an outlier"


def _accused(level: str, group: Group) -> str:
    """Which metrics name a group, and where it was touched."""
    doubt = "" if group.outlier else " may be an outlier"
    n = "all four" if len(group.flags) == len(METRICS) else f"{len(group.flags)} of 4"
    words = ", ".join(WORDS[flag] for flag in group.flags)
    accusation = (
        f"{GROUPING_NOUN[level].capitalize()} {group.label}{doubt}: {n} metrics indicate it "
        f"({words})"
    )
    if group.suspect or group.displacement is None:
        return f"{accusation}."
    x, y, z = mm(group.displacement.vector)
    return (
        f"{accusation}; the touched position differs from the certified one by {x:+.2f}, "
        f"{y:+.2f}, {z:+.2f} mm (x, y, z of the artefact; "
        f"±{mm(float(np.max(group.displacement.std))):.2f} mm)."
    )


def _size(value: float, unit: Unit, form: str) -> str:
    """A number with its unit, as it is shown."""
    return f"{shown(value, unit):{form}} {unit_name(unit)}".rstrip()


def _expected(term: Term) -> float:
    """Noise that the job states for the first block, or that is usual."""
    block = term.blocks[0]
    return block.noise.sigma or assumed_sigma(block)


def _gross(term: TermOutliers) -> str:
    n = len(term.touches)
    worst = max(term.touches, key=lambda t: t.size)
    are, were, them, first = (
        ("is", "was", "it", "") if n == 1 else ("are", "were", "them", "worst ")
    )
    return (
        f"{n} of {term.samples} single touches {are} far beyond the noise of "
        f"{_size(term.sigma, term.unit, '.2g')} per axis and {were} not used for these figures. "
        f"The calibration uses {them} with a low weight: {first}{worst.what} ({worst.origin}), "
        f"{_size(worst.size, term.unit, '.1f')}."
    )
