"""Chooses what to measure next, predicts the result, and says when to stop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from suta_calib.analysis.planning.candidates import Candidate, Place, read_candidates
from suta_calib.analysis.planning.design import (
    Design,
    SharedInformation,
    SharedUnknowns,
    best_set,
    candidate_information,
    exchange,
    greedy,
    no_information,
    present_information,
    random_sets,
)
from suta_calib.analysis.planning.reach import Reach
from suta_calib.analysis.planning.region import Region, candidate_pool
from suta_calib.analysis.planning.result import (
    Best,
    Choice,
    Expected,
    Forecast,
    Plan,
    PlanOptions,
    Remedy,
    Stop,
)
from suta_calib.analysis.planning.situation import Situation
from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray
from suta_calib.errors import JobError, SamplesError
from suta_calib.job.calibration import CalibrationJob
from suta_calib.solver.solve import Progress, identify_at
from suta_calib.threads import single_threaded
from suta_calib.trust.explanation import Explanation, explain
from suta_calib.trust.tip import Sensitivity


@checked
def situation_of_job(
    job: CalibrationJob, progress: Progress | None = None, chain: str = ""
) -> Situation:
    """A job at its solution, or at nominal where its data are too few to be fitted yet.

    Args:
        job: whose data are at hand.
        progress: called with (starts done, starts).
        chain: of several chains of a robot the one for which is planned.

    Raises:
        JobError: it looks at no arm.
        ParameterError: there are several chains, and this is none of them.
    """
    job.arm.chosen(chain)
    try:
        result = job.run(progress)
    except SamplesError:  # too little data is what a plan is for
        return Situation.of(job.problem(), chain=chain)
    judged = result.assessment
    trouble = "" if judged.usable else next(iter(judged.notes), judged.sentence)
    return Situation.of(result.solution.problem, result.solution, trouble, chain)


def candidate_places(
    file: Path, situation: Situation, options: PlanOptions
) -> tuple[tuple[Place, ...], PlanOptions]:
    """The places a user would accept, and the options with the repeats that the file states.

    Args:
        file: ``candidates.yaml``.
        situation: says how often things are touched where the file does not.
        options: repeats that are stated there stay.

    Raises:
        JobError: the file cannot be used; names the line and the key.
    """
    artefact = situation.artefact
    repeats = options.repeats or situation.repeats
    # Touches of a point where there is no artefact to say how many are usual.
    touches = 20 if artefact is None else repeats * len(artefact.landmarks)
    read = read_candidates(file, situation.arm, touches)
    return read.places, replace(options, repeats=options.repeats or read.repeats)


@single_threaded
@checked
def plan(
    situation: Situation,
    options: PlanOptions,
    places: Sequence[Place] | None = None,
    region: Region | None = None,
    progress: Progress | None = None,
) -> Plan:
    """Choose what to measure next.

    Args:
        situation: the present data and what is known of the arm.
        options: how many, by which criterion, and when to stop.
        places: what could be measured; searched in the region by default.
        region: where the tip shall be sure; around what was touched by default.
        progress: called with (candidates done, candidates).

    Raises:
        JobError: the arm reaches none of the places, or next to nothing of the region.
    """
    region = Region.around(situation) if region is None else region
    options = replace(options, repeats=options.repeats or situation.repeats)
    assert options.repeats is not None
    if places is None:
        places = candidate_pool(situation, region, options.pool, options.repeats, options.seed)
    reached = Reach(situation, options.repeats, options.seed).candidates(places)
    if not reached.candidates:
        none = reached.unreachable
        first = f"; {none[0].name}: {none[0].reason}" if none else ""
        raise JobError(
            f"{len(none)} candidates, and the arm reaches none of them{first}",
            "at least one within reach and joint limits",
            where="candidates",
            hint="move the candidates nearer to the arm, or give another region",
        )
    space = SharedUnknowns.of(situation)
    tip = region.sensitivity(situation, space.names[: space.arm_count], options.seed)
    information = []
    for done, candidate in enumerate(reached.candidates, start=1):
        information.append(candidate_information(situation, space, candidate))
        if progress is not None:
            progress(done, len(reached.candidates))
    now = present_information(situation, space)
    design = Design.over(space, information, tip_weight(space, tip), options.criterion, now)
    chosen = best_set(design, now, options.count)
    after = sum((information[k] for k in chosen), now)
    informed = list(zip(reached.candidates, information, strict=True))
    drawn = random_sets(design, options.count, options.random, options.seed)
    return Plan(
        situation=situation,
        options=options,
        region=region,
        candidates=reached.candidates,
        unreachable=reached.unreachable,
        collisions=reached.collisions,
        before=forecast(space, now, tip),
        after=forecast(space, after, tip),
        chosen=_choices(space, design, now, [informed[k] for k in chosen]),
        best=_best(situation, space, design, now, informed),
        random=np.array([design.tip(now, rows) for rows in drawn]),
        stop=_stop(design, now, options),
        remedies=remedies(situation, space, now, reached.candidates, information),
    )


def tip_weight(space: SharedUnknowns, tip: Sensitivity) -> FloatArray:
    """(p, p) W with trace(W C) the mean variance of the registered tip over the region, m²."""
    jacobian = tip.registered()
    weight = np.zeros((len(space.names),) * 2)
    arm = slice(0, space.arm_count)
    weight[arm, arm] = np.einsum("nip,niq->pq", jacobian, jacobian) / len(jacobian)
    return weight


def _choices(
    space: SharedUnknowns,
    design: Design,
    now: SharedInformation,
    chosen: Sequence[tuple[Candidate, SharedInformation]],
) -> tuple[Choice, ...]:
    choices = []
    before = now
    for candidate, more in chosen:
        after = before + more
        tips = [design.tip(t) for t in (before, after)]
        gain = 1.0 - tips[1] / tips[0] if tips[0] > 0 else 0.0
        bits = (design.d(before) - design.d(after)) * space.arm_count / math.log(2.0)
        open_before, still = (
            [c.fixed for c in space.identify(state).combinations] for state in (before, after)
        )
        newly_identifiable = tuple(name for name in open_before if name not in still)
        choices.append(Choice(candidate, tips[1], gain, bits, newly_identifiable))
        before = after
    return tuple(choices)


def _best(
    situation: Situation,
    space: SharedUnknowns,
    design: Design,
    now: SharedInformation,
    candidates: Sequence[tuple[Candidate, SharedInformation]],
) -> Best:
    typical = float(np.median([candidate.samples for candidate, _ in candidates]))
    count = max(1, min(len(design), round(situation.samples / typical)))
    none = no_information(space)
    rows = best_set(design, none, count)
    tips = design.tip(now), design.tip(none, rows)
    # What nothing here can tell is the same in both and must not make them alike.
    fixed = space.identify(sum((candidates[k][1] for k in rows), none)).fixed
    estimated = max(space.arm_count - int(np.sum(fixed < space.arm_count)), 1)
    change = (design.d(none, rows) - design.d(now)) * space.arm_count / estimated
    return Best(
        names=tuple(candidates[k][0].name for k in rows),
        count=count,
        tip=tips[1],
        present=tips[0],
        efficiency=(tips[1] / tips[0]) ** 2 if tips[0] > 0 else 1.0,
        d_efficiency=math.exp(2.0 * change),
    )


def _stop(design: Design, now: SharedInformation, options: PlanOptions) -> Stop:
    """Look ahead by the tip's uncertainty, whatever the plan is chosen by."""
    by_tip = replace(design, criterion="tip")
    far = exchange(by_tip, now, greedy(by_tip, now, max(options.horizon, options.count)))
    tips = [by_tip.tip(now, far[:k]) for k in range(len(far) + 1)]
    gains = [1.0 - b / a if a > 0 else 0.0 for a, b in pairwise(tips)]
    small = [k for k, gain in enumerate(gains) if gain < options.least_gain]
    reached = [k for k, tip in enumerate(tips) if options.target and tip <= options.target]
    return Stop(
        tips=tuple(tips),
        worthwhile=small[0] if small else None,
        least_gain=options.least_gain,
        target=options.target,
        needed=reached[0] if reached else None,
    )


def forecast(space: SharedUnknowns, information: SharedInformation, tip: Sensitivity) -> Forecast:
    """Predict the standard deviations that such information gives.

    Args:
        space: the unknowns.
        information: on them.
        tip: postures of the region, with derivatives by the arm's parameters.
    """
    fixed = set(space.identify(information).fixed.tolist())
    estimated = np.array([k for k in range(len(space.names)) if k not in fixed], dtype=np.intp)
    covariance = space.covariance(information, estimated)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    expected = [
        Expected(p.name, p.unit, p.plausible, None if k in fixed else float(std[k]))
        for k, p in enumerate(list(space.parameters.values())[: space.arm_count])
    ]
    return Forecast(
        parameters=tuple(expected),
        fixed=tuple(e.name for e in expected if e.std is None),
        tip=_tip_rms(space, space.plausible_covariance(information), tip),
        tip_estimated=_tip_rms(space, covariance, tip),
    )


def _tip_rms(space: SharedUnknowns, covariance: FloatArray, tip: Sensitivity) -> float:
    arm = slice(0, space.arm_count)
    std = tip.std(covariance[arm, arm], tip.registered())
    return float(np.sqrt(np.mean(std**2)))


def remedies(
    situation: Situation,
    space: SharedUnknowns,
    present: SharedInformation,
    candidates: Sequence[Candidate],
    information: Sequence[SharedInformation],
) -> tuple[Remedy, ...]:
    """One for each parameter of the arm that the present data leave open.

    A candidate determines a parameter that would no longer be held with what it adds, if fewer
    would be held in all: of a combination, holding another one instead is no gain.
    """
    names = _fixed(space, present)
    if not names:
        return ()
    problem, x = situation.problem, situation.x
    texts = {e.fixed: e for e in explain(problem, x, identify_at(problem, x, situation.sigmas))}
    remedies_found = []
    left = [_fixed(space, present + more) for more in information]
    left_by_all = _fixed(space, sum(information, present))
    for name in names:
        k = space.names.index(name)
        able = [
            (candidate, float(more.curvature[k, k]))
            for candidate, more, fixed in zip(candidates, information, left, strict=True)
            if name not in fixed and len(fixed) < len(names)
        ]
        best = [candidate for candidate, _ in sorted(able, key=lambda pair: -pair[1])]
        text = texts.get(name, Explanation(name, "", ""))
        remedies_found.append(
            Remedy(
                parameter=name,
                candidates=tuple(c.name for c in best),
                sorts=tuple(dict.fromkeys(c.sort for c in best)),
                by_all=name not in left_by_all and len(left_by_all) < len(names),
                why=text.sentence,
                advice=text.remedy,
            )
        )
    return tuple(remedies_found)


def _fixed(space: SharedUnknowns, information: SharedInformation) -> list[str]:
    """The arm's parameters that would be held."""
    arm = space.names[: space.arm_count]
    return [c.fixed for c in space.identify(information).combinations if c.fixed in arm]
