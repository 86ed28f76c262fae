"""The acceptance test: every error is compared with its limit; simplifications are named.

Symbols are those of ISO 10360-12:2016: E_Uni and E_Bi, the errors of a length probed from one side
or from both; L_Dia.5x5:Art, the location error from five articulations of five touches; P_Size and
P_Form, the errors of size and form on a sphere of 25 touches.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.analysis.iso10360.measured import (
    Articulation,
    LengthErrors,
    RepeatedVisits,
    SphereProbing,
    articulations,
    probings,
    repeats,
)
from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.job.acceptance import AcceptanceJob
from suta_calib.job.limits import EXPANDED, Decision, DecisionRule, Limits, StatedUncertainty, worst
from suta_calib.units import mm

# What the standard asks for: touches of a sphere; lengths, which are five on each of seven
# measurement lines, three times.
TOUCHES: Final = 25
LINES: Final = 35
LENGTHS: Final = 105
NO_LIMITS: Final = Limits()
NOTHING_STATED: Final = StatedUncertainty()
GUARDED: Final = DecisionRule()


@dataclass(frozen=True, eq=False)
class AcceptanceMeasurements(Displayable):
    """What was measured; empty or None where a test was not made.

    Attributes:
        lengths: of the artefact.
        bidirectional: whether lengths were probed from both sides, so that they hold the
            stylus' size: E_Bi in place of E_Uni.
        articulations: points found from several articulations.
        spheres: probed spheres.
        sphere_std: standard uncertainty of the spheres' diameter, m.
        repeats: repeatedly visited points.
        notes: what must be known of these data, one sentence each.
    """

    lengths: LengthErrors | None = None
    bidirectional: bool = False
    articulations: tuple[Articulation, ...] = ()
    spheres: tuple[SphereProbing, ...] = ()
    sphere_std: float = 0.0
    repeats: tuple[RepeatedVisits, ...] = ()
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, job: AcceptanceJob) -> AcceptanceMeasurements:
        """The errors of a job's arm, held as it is.

        Raises:
            InputError: samples that do not determine what they are to measure, with their place.
        """
        lengths, points = None, list[Articulation]()
        spheres: tuple[SphereProbing, ...] = ()
        visited: tuple[RepeatedVisits, ...] = ()
        if job.lengths:
            with job.error_context("lengths"):
                lengths = LengthErrors.joined([LengthErrors.of(term) for term in job.lengths])
        for samples in job.articulation:
            place, labels = job.arm.forward(samples.q)[1], samples.labels
            with job.error_context("articulation"):
                named = labels["point"], labels.get("articulation")
                points += articulations(place, *named, sphere=job.on_spheres)
        if (probing := job.probing) is not None:
            place = job.arm.forward(probing.samples.q)[1]
            with job.error_context("probing"):
                spheres = probings(place, probing.samples.labels["sphere"], probing.diameter)
        if (visits := job.repeatability) is not None:
            place = job.arm.forward(visits.q)[1]
            with job.error_context("repeatability"):
                visited = repeats(place, visits.labels["point"])
        std = 0.0 if probing is None else probing.std
        measured = lengths, job.bidirectional, tuple(points), spheres, std, visited
        return cls(*measured, job.notes)


@dataclass(frozen=True)
class Characteristic(Displayable):
    """One characteristic of the test: the largest measured error.

    Attributes:
        symbol: of the standard, or in plain words.
        where: what it was measured on.
        value: with its sign, m.
        limit: maximum permissible error there, m; None where none is given.
        expanded: uncertainty of the test there, k = 2, m; None where none is known.
        decision: on all of them, not on the worst alone.
        count: how many there are.
        missing: what the standard asks for and was not measured; empty where nothing is.
    """

    symbol: str
    where: str
    value: float
    limit: float | None
    expanded: float | None
    decision: Decision
    count: int
    missing: str = ""

    def but_for(self, missing: str, *, amplified: bool = False) -> Characteristic:
        """The same, of a test that is not whole: what is missing may hide the largest error.

        So few values within their limit prove nothing, and neither do those beyond it where each
        is made larger by how few there are.

        Args:
            missing: what the standard asks for and was not measured; empty where nothing is.
            amplified: whether a fit to so few touches makes more of their scatter.
        """
        unproved = self.decision == "pass" or (amplified and self.decision == "fail")
        decision: Decision = "undecided" if missing and unproved else self.decision
        return replace(self, missing=missing, decision=decision)

    @property
    def broken(self) -> str:
        """Of one that has not passed: how it stands to its limit, in a sentence."""
        if self.missing and self.decision == "undecided":
            return f"{self.symbol}: {self.missing}. This proves neither a pass nor a failure."
        how = "beyond" if self.decision == "fail" else "too close to"
        sure = f" with U {mm(self.expanded):.4f} mm" if self.expanded else ""
        return (
            f"{self.symbol}: {mm(self.value):+.4f} mm ({self.where}) is {how} the limit "
            f"±{mm(self.limit or 0.0):.4f} mm{sure}."
        )


@dataclass(frozen=True, eq=False)
class AcceptanceTest(Displayable):
    """Result of an acceptance test.

    Attributes:
        measured: errors one by one.
        limits, uncertainty, rule: what they were judged with.
        characteristics: the worst of each kind.
    """

    measured: AcceptanceMeasurements
    limits: Limits
    uncertainty: StatedUncertainty
    rule: DecisionRule
    characteristics: tuple[Characteristic, ...]

    @property
    def decision(self) -> Decision:
        """On the whole: every limit must be kept."""
        judged = [figure.decision for figure in self.characteristics if figure.limit is not None]
        return worst(judged)

    @property
    def length_expanded(self) -> FloatArray:
        """(n,) expanded uncertainty of every length, m."""
        lengths = self.measured.lengths
        return np.zeros(0) if lengths is None else length_uncertainty(lengths, self.uncertainty)

    @property
    @judged
    def assessment(self) -> Assessment:
        """Passed, failed, or undecided."""
        sentence = "No limits given: figures only, no pass or fail"
        judged = [figure for figure in self.characteristics if figure.limit is not None]
        if judged:
            passed = sum(figure.decision == "pass" for figure in judged)
            words = {"pass": "Passed", "fail": "Failed", "undecided": "Neither passed nor failed"}
            sentence = f"{words[self.decision]}: {passed} of {len(judged)} limits are met"
        bad = [figure.broken for figure in judged if figure.decision != "pass"]
        notes = [*self.measured.notes]
        spread = {point.point: point.amplification for point in self.measured.articulations}
        spread |= {sphere.sphere: sphere.amplification for sphere in self.measured.spheres}
        for name, amplification in spread.items():
            # Four touches on the equator and one on the pole give 1.5.
            if amplification > 4.0:
                notes.append(
                    f"{name}: because of where the touches lie, the uncertainty of a sphere's "
                    f"centre is up to {amplification:.0f} times that of a touch. Spread the "
                    "touches over a pole and the equator."
                )
        for figure in self.characteristics:
            unsure = figure.expanded or 0.0
            if figure.limit is not None and self.rule.guard(unsure) >= figure.limit:
                notes.append(
                    f"{figure.symbol}: the uncertainty of the test (U {mm(unsure):.4f} mm) is "
                    "larger than the limit, so no result can pass."
                )
            if figure.limit is None and self.limits.given:
                notes.append(f"{figure.symbol}: no limit is given.")
        return Assessment.of(sentence, bad=bad, care=notes)

    @property
    def simplified(self) -> tuple[str, ...]:
        """Differences between this procedure and the standard's, one sentence each."""
        m = self.measured
        sentences = [
            f"{figure.symbol}: {figure.missing}."
            for figure in self.characteristics
            if figure.missing
        ]
        if m.lengths is not None:
            sentences.append(
                f"Lengths: every pair of landmarks at every placement gave {len(m.lengths)} "
                f"errors of lengths up to {mm(float(m.lengths.length.max())):.0f} mm. The "
                "standard prescribes where the lengths lie in the measuring volume. Longer "
                "lengths were not tested."
            )
        if m.articulations:
            sentences.append(
                "Articulations: the standard measures a sphere's centre in each articulation, "
                "spread over the range of the wrist."
            )
        if m.repeats:
            sentences.append(
                "The repeatability of a single point is not a characteristic of ISO 10360-12."
            )
        return tuple(sentences)


@checked
def acceptance_test(job: AcceptanceJob) -> AcceptanceTest:
    """Do the acceptance test that a job describes.

    Args:
        job: read by `AcceptanceJob.load`.

    Raises:
        InputError: samples that do not determine what they are to measure.
    """
    return accept(AcceptanceMeasurements.of(job), job.limits, job.uncertainty, job.rule)


@checked
def accept(
    measured: AcceptanceMeasurements,
    limits: Limits = NO_LIMITS,
    uncertainty: StatedUncertainty = NOTHING_STATED,
    rule: DecisionRule = GUARDED,
) -> AcceptanceTest:
    """Compare measured errors with their limits."""
    m, u, characteristics = measured, uncertainty, []
    if m.lengths is not None:
        characteristics.append(_worst_length(m.lengths, m.bidirectional, limits, u, rule))
    diameter, touches = float(np.hypot(EXPANDED * m.sphere_std, u.size)), _too_few_touches(m)
    points = [(a.point, a.diameter) for a in m.articulations]
    sizes, forms = ([(s.sphere, getattr(s, of)) for s in m.spheres] for of in ("size", "form"))
    visits = [(r.point, r.diameter) for r in m.repeats]
    # What is missing of a kind, and whether few touches make more of their scatter: a size does,
    # and a sphere's place; form never does.
    fitted = any(point.amplification for point in m.articulations)
    kinds = (
        ("L_Dia", points, limits.location, u.location, _too_few_articulations(m), fitted),
        ("P_Size", sizes, limits.size, diameter, touches, True),
        ("P_Form", forms, limits.form, u.form, touches, False),
        ("repeatability", visits, limits.repeatability, u.repeatability, "", False),
    )
    for symbol, values, limit, expanded, missing, amplified in kinds:
        if values:
            where, value = max(values, key=lambda pair: abs(pair[1]))
            decision = rule.decide(value, limit, expanded)
            stated = expanded or None
            judged = Characteristic(symbol, where, value, limit, stated, decision, len(values))
            characteristics.append(judged.but_for(missing, amplified=amplified))
    return AcceptanceTest(measured, limits, uncertainty, rule, tuple(characteristics))


def _too_few_touches(m: AcceptanceMeasurements) -> str:
    few = [f"{len(s.radial)} of {s.sphere}" for s in m.spheres if len(s.radial) < TOUCHES]
    asked = f"the standard requires {TOUCHES} touches of each sphere, spread over half of it"
    return f"{', '.join(few)} touches; {asked}" if few else ""


def _too_few_articulations(m: AcceptanceMeasurements) -> str:
    sentences = []
    # What the standard asks for: articulations of a point, and touches in each.
    least, touches_each = 5, 5
    for point in m.articulations:
        few = len(point.names) < least
        # Each touch of a seat tells the place; a sphere's centre needs all that are asked for.
        if few or (point.amplification and point.touches < touches_each * len(point.names)):
            sentences.append(
                f"{point.touches} touches in {len(point.names)} articulations of {point.point}"
            )
    asked = f"the standard requires {touches_each} touches in each of {least} articulations"
    return f"{', '.join(sentences)}; {asked}" if sentences else ""


def length_uncertainty(lengths: LengthErrors, u: StatedUncertainty) -> FloatArray:
    """Expanded (k = 2) uncertainty (n,) of what each length truly was, m."""
    calibration = (EXPANDED * lengths.calibration_std) ** 2
    return np.asarray(np.sqrt(calibration + u.length**2 + (u.per_length * lengths.length) ** 2))


def _worst_length(
    lengths: LengthErrors,
    bidirectional: bool,
    limits: Limits,
    uncertainty: StatedUncertainty,
    rule: DecisionRule,
) -> Characteristic:
    expanded = length_uncertainty(lengths, uncertainty)
    limit = None if limits.length is None else limits.length.at(lengths.length)
    beyond = np.abs(lengths.error) - (0.0 if limit is None else limit - rule.guard(expanded))
    row = int(np.argmax(beyond))
    decisions: list[Decision] = ["no limit"]
    if limit is not None:
        rows = zip(lengths.error.tolist(), limit.tolist(), expanded.tolist(), strict=True)
        decisions = [rule.decide(*row) for row in rows]
    missing = ""
    if len(lengths) < LENGTHS or lengths.lines < LINES:
        missing = (
            f"{len(lengths)} lengths on {lengths.lines} different lines; the standard requires "
            f"{LENGTHS} lengths: five on each of seven lines through the measuring volume, three "
            "times each"
        )
    place = f"{lengths.label[row]}, {mm(lengths.length[row]):.1f} mm, {lengths.placement[row]}"
    return Characteristic(
        "E_Bi" if bidirectional else "E_Uni",
        place,
        float(lengths.error[row]),
        None if limit is None else float(limit[row]),
        float(expanded[row]) or None,
        worst(decisions),
        len(lengths),
    ).but_for(missing)
