"""Zeros of joints of which the data tell only combinations: priors alone split these.

A parameter with a prior is never held. Where joints turn about parallel axes and nothing is
observed between them, all zeros have values and a ±, although each alone is known no better than
before. With S the priors' standard deviations of the joints' zeros, and C their covariance after
the fit,

    S⁻¹ C S⁻¹ u = λ u,    0 < λ ≤ 1

the data tell nothing worth a report along u where λ exceeds a half, as of a single parameter
(`solver.solution.INFORMED`). Zeros that several of these directions share, and that another
direction does tell, are a combination that priors split.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.model.robot import AnyArm
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import INFORMED
from suta_calib.trust.rich_data import RichData
from suta_calib.units import Unit, std_text, text, unit_name
from suta_calib.words import combination, enumerated


@dataclass(frozen=True, eq=False)
class PriorSplit(Displayable):
    """Zeros of joints that only priors tell apart.

    Attributes:
        names: of the offsets, base to tip.
        unit: theirs.
        stds: of each, after the fit.
        told: by offset, the factor in the combination that the data tell; empty where they tell
            several.
        tip: by how much the registered tip is unsure because of it, m, RMS in postures all over.
        links: between the joints, base to tip.
        kinds: of the observations that do not separate them.
        postures: whether the same in more postures would.
    """

    names: tuple[str, ...]
    unit: Unit
    stds: tuple[float, ...]
    told: dict[str, float]
    tip: float
    links: tuple[str, ...]
    kinds: tuple[str, ...]
    postures: bool

    @property
    def sentence(self) -> str:
        """What the data tell, how well each is known, what that is at the tip, and the remedy."""
        if not self.told:
            what = f"combinations of {enumerated(self.names)}"
        elif all(math.isclose(factor, 1.0, abs_tol=0.1) for factor in self.told.values()):
            what = f"the sum of {enumerated(self.names)}"
        else:
            what = f"the combination {combination(self.told)}"
        least, most = (std_text(f(self.stds), self.unit, with_unit=False) for f in (min, max))
        size = f"± {most}" if least == most else f"± {least} to {most}"
        size += f" {unit_name(self.unit)}"
        tip = text(self.tip, "m", with_unit=True)
        several = len(self.links) > 1
        remedy = (
            "Measure in postures that differ more in these joints"
            if self.postures
            else f"Measure on the link{'s' * several} {enumerated(self.links)} too: "
            f"{'for each, ' * several}add a row of kind {enumerated(self.kinds, 'or')} with "
            f"{'its name' if several else 'the key'} (link: {self.links[0]}). Or add observations "
            "of where the tip is"
        )
        return (
            f"The data tell only {what}. Each alone comes from its prior ({size}). This is {tip} "
            f"at the tip in other postures (one standard deviation). {remedy}."
        )


def prior_splits(
    problem: Problem, x: FloatArray, covariance: FloatArray, prior: FloatArray
) -> tuple[PriorSplit, ...]:
    """Combinations of zeros that priors split, and that matter at the tip.

    Args:
        problem: which has priors.
        x: (n,) where to look.
        covariance: (n, n) of the parameters after the fit.
        prior: (n,) variance of each before it.
    """
    arm = problem.arm
    if arm is None:
        return ()
    zeros = {
        k: p.unit
        for k, p in enumerate(problem.arm_parameters.values())
        if p.name in arm.offsets and p.free and p.prior is not None
    }
    split = dict[tuple[int, ...], tuple[FloatArray, FloatArray]]()
    for unit in dict.fromkeys(zeros.values()):
        rows = np.array([k for k, of in zeros.items() if of == unit])
        scale = np.sqrt(prior[rows])
        values, vectors = np.linalg.eigh(covariance[np.ix_(rows, rows)] / np.outer(scale, scale))
        # A misfit may scatter an estimate more, but nobody knows less than before the data.
        size = np.sqrt(np.minimum(values, 1.0))
        untold = values > INFORMED
        for group in _groups(vectors[:, untold] @ vectors[:, untold].T):
            open_steps = (vectors * size)[np.ix_(group, untold)] * scale[group, None]
            determined = vectors[np.ix_(group, ~untold)]
            split[tuple(rows[group].tolist())] = open_steps, determined
    if not split:
        return ()
    rich = RichData(problem, x)

    def moves(at: Sequence[int], steps: FloatArray) -> float:
        columns = [rich.names.index(problem.names[k]) for k in at]
        directions = np.zeros((steps.shape[1], len(rich.names)))
        directions[:, columns] = steps.T
        return math.hypot(*(rich.registered(step / rich.unit) for step in directions))

    # What the same observations would leave in postures all over, in standard deviations before.
    spread = np.sqrt([prior[problem.names.index(name)] for name in rich.names]) / rich.unit
    limited = np.isfinite(spread)
    spread = np.where(limited, spread, 1.0)
    information = rich.same * np.outer(spread, spread) + np.diag(limited.astype(float))
    left = np.linalg.pinv(information, hermitian=True)

    before = moves([*zeros], np.diag(np.sqrt(prior[[*zeros]])))
    splits = []
    for at, (open_steps, determined) in split.items():
        tip = moves(at, open_steps)
        # Motion of the tip by what is not told, over that by the priors of all zeros, from which on
        # it is worth a report: as of a value over what is plausible
        # (`solver.identifiability.WEAK`).
        if tip < 0.1 * before:
            continue
        names = tuple(problem.names[k] for k in at)
        columns = [rich.names.index(name) for name in names]
        stds = np.sqrt(np.minimum(np.diag(covariance)[[*at]], prior[[*at]]))
        axes, sizes, _ = np.linalg.svd(determined)
        factors = axes[:, 0] / np.sqrt(prior[[*at]])
        factors = factors / factors[np.argmax(np.abs(factors))]
        # Directions that are told within the combination, and not by others beside it.
        single = np.count_nonzero(sizes > 0.5) == 1
        splits.append(
            PriorSplit(
                *(names, zeros[at[0]], tuple(stds.tolist())),
                dict(zip(names, factors.tolist(), strict=True)) if single else {},
                tip,
                _between(arm, [problem.parameters[name].owner for name in names]),
                tuple(dict.fromkeys(term.kind for term in problem.terms)),
                bool(np.linalg.eigvalsh(left[np.ix_(columns, columns)])[-1] < INFORMED),
            )
        )
    return tuple(splits)


def _groups(projector: FloatArray) -> Iterator[IntArray]:
    """Numbers of zeros (k,) that share untold directions, and are told in part."""
    part = np.diag(projector)
    # Of a zero, the part that must be in untold directions, and in told ones, to be in a
    # combination.
    least_part = 0.1
    left = set(np.flatnonzero((part > least_part) & (part < 1.0 - least_part)).tolist())
    while left:
        group, added = set[int](), {min(left)}
        while added:
            group |= added
            near = (np.abs(projector[[*added]]) > least_part).any(axis=0)
            added = set(np.flatnonzero(near).tolist()) & left - group
        left -= group
        if len(group) > 1:
            yield np.array(sorted(group), dtype=np.intp)


def _between(arm: AnyArm, joints: list[str]) -> tuple[str, ...]:
    """The links that these joints carry, but for the last: a sensor there separates them."""
    carried = {owner: link for one in arm.arms for link, owner in reversed(one.links.items())}
    return tuple(carried[joint] for joint in joints[:-1] if joint in carried)
