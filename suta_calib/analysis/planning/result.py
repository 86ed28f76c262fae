"""The plan: its options, the chosen measurements, the predicted result, and the verdict."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from suta_calib import plotting
from suta_calib.analysis import planning
from suta_calib.analysis.planning.candidates import Candidate, Unreachable
from suta_calib.analysis.planning.region import Pool, Region
from suta_calib.analysis.planning.situation import Situation
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.units import Unit, mm, text


@dataclass(frozen=True)
class PlanOptions(Displayable):
    """What is asked for.

    Attributes:
        count: how many candidates to choose.
        criterion: ``tip``, its RMS uncertainty in the region, or ``d``, the volume of the
            parameters' confidence ellipsoid.
        repeats: of the landmarks of a placement; as in the present data by default.
        target: uncertainty of the tip to be reached, m, or None.
        least_gain: part by which one more candidate must lessen the tip's uncertainty.
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
class Choice(Displayable):
    """One candidate of the plan, in the order of what they bring.

    Attributes:
        candidate: what to measure.
        tip: RMS uncertainty of the tip in the region once it is measured, m.
        gain: part by which it lessens that.
        bits: by which it lessens the log volume of the parameters' confidence ellipsoid.
        identifies: parameters that are open before and told once it is measured too.
    """

    candidate: Candidate
    tip: float
    gain: float
    bits: float
    identifies: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Best(Displayable):
    """The best that as many samples as the present ones could tell, from the candidates.

    Attributes:
        names: of the candidates.
        count: how many of them make as many samples.
        tip, present: RMS uncertainty of the tip in the region, m, and that of the present data.
        efficiency: part of the samples with which the best set would tell as much of the tip.
        d_efficiency: the same of the parameters as a whole.
    """

    names: tuple[str, ...]
    count: int
    tip: float
    present: float
    efficiency: float
    d_efficiency: float


@dataclass(frozen=True)
class Expected:
    """One parameter: how far off it might be (m, rad), and its predicted standard deviation.

    ``std`` is None where it would be held.
    """

    name: str
    unit: Unit
    plausible: float
    std: float | None


@dataclass(frozen=True, eq=False)
class Forecast(Displayable):
    """All of them, and the tip in a region after registration.

    Attributes:
        parameters: the arm's.
        fixed: names of those that would be held at nominal.
        tip: RMS 3-D uncertainty, m, if held parameters are as far off as plausible.
        tip_estimated: the same if they are exact: what the calibration's own ± tell.
    """

    parameters: tuple[Expected, ...]
    fixed: tuple[str, ...]
    tip: float
    tip_estimated: float


@dataclass(frozen=True)
class Remedy(Displayable):
    """A parameter the present data cannot tell.

    Attributes:
        parameter: its name.
        candidates: names of those that determine it, each by itself, the surest first.
        sorts: of these candidates.
        by_all: whether all candidates together determine it; else none can.
        why: no observation sees it.
        advice: what else would help, or that nothing is needed.
    """

    parameter: str
    candidates: tuple[str, ...]
    sorts: tuple[str, ...]
    by_all: bool
    why: str
    advice: str


@dataclass(frozen=True)
class Stop(Displayable):
    """When to stop.

    Attributes:
        tips: RMS uncertainty of the tip after 0, 1, 2, … further candidates, m.
        worthwhile: how many lessen it by ``least_gain`` each; None if all looked at do.
        least_gain: as in `PlanOptions`.
        target: uncertainty to be reached, m, or None.
        needed: how many reach it; None if those looked at do not.
    """

    tips: tuple[float, ...]
    worthwhile: int | None
    least_gain: float
    target: float | None
    needed: int | None


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Displayable):
    """The answer.

    Attributes:
        situation, options, region: where it starts, what was asked for, where the tip shall be
            sure.
        candidates, unreachable, collisions: what could be chosen, what not, and what was checked.
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

    @property
    def in_a_line(self) -> str:
        """The predicted improvement, as a sentence."""
        return self.assessment.sentence

    def plot(self, figure: Any = None) -> Any:
        """Draw the arm, what was measured, and what to measure next, from above and the side, mm.

        Args:
            figure: an empty `Figure` or `SubFigure`; a new one by default.

        Returns:
            The figure.
        """
        figure = plotting.figure_or_new(figure, (9.0, 5.0))
        planning.draw_bench(figure, self)
        return figure

    def plot_gain(self, ax: Any = None) -> Any:
        """Draw how sure the tip will be by the number of further candidates, mm.

        Args:
            ax: `Axes` to draw on; those of a new figure by default.

        Returns:
            The `Axes`.
        """
        axes = plotting.axes_or_new(ax, (6.5, 3.2))
        planning.draw_gain(axes, self)
        return axes

    @property
    @judged
    def assessment(self) -> Assessment:
        """The predicted improvement, with notes."""
        names = ", ".join(choice.candidate.name for choice in self.chosen)
        sentence = (
            f"With {names}, the uncertainty of the tip changes from {text(self.before.tip, 'm')} "
            f"to {text(self.after.tip, 'm')} mm (3-D RMS in the region, after registration)"
        )
        trouble = self.situation.trouble
        bad = [
            f"Do not use the calibration itself ({trouble.rstrip('.')}). Correct that first: "
            "this plan assumes the nominal arm, and the artefact and readings as the job states "
            "them."
        ]
        return Assessment.of(sentence, bad=bad if trouble else [], care=self._notes())

    def _notes(self) -> list[str]:
        notes, after, stop = [], self.after, self.stop
        if not (self.situation.solved or self.situation.trouble):
            notes.append(
                "The present data are too few for a fit. The prediction uses the nominal arm and "
                "an assumed noise (0.5 mm where the job gives none)."
            )
        if self.situation.lacking > 1.0:
            notes.append(
                f"The residuals are {self.situation.lacking:.1f} times the scatter of repeats, "
                "or the noise that the job states. The model is incomplete, and more rows do not "
                "correct that. Every ± here is multiplied by this factor. First estimate more of "
                "the geometry."
            )
        if left := [r.parameter for r in self.remedies if r.by_all and r.parameter in after.fixed]:
            notes.append(
                f"Still unidentified after this plan: {', '.join(left)}. Choose more candidates."
            )
        # A plan that lessens the tip's uncertainty by less than this part is for nothing.
        if after.tip > (1 - 0.01) * self.before.tip:
            notes.append(
                "No candidate reduces the uncertainty of the tip noticeably. To improve the "
                "parameters, use --criterion d."
            )
        # Uncertainty of the tip from what is held, as a part of what is estimated, that is nothing.
        if after.tip > (1 + 0.05) * after.tip_estimated:
            notes.append(
                "Most of the remaining uncertainty comes from parameters that are held at "
                "assumed values, not measured. If these were exact, the uncertainty of the tip "
                f"would be {text(after.tip_estimated, 'm')} mm."
            )
        if stop.target is not None and stop.needed is None:
            notes.append(
                f"The target of {mm(stop.target):.3g} mm is not reached with "
                f"{len(stop.tips) - 1} more measurements: {text(stop.tips[-1], 'm')} mm."
            )
        return notes
