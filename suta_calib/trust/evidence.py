"""One statistical test for all errors that a model may lack: the added-variable (score) test.

Let a converged fit have whitened residuals r (m,), the Jacobian J (m, p) of its parameters, robust
weights W and prior precisions P. An effect that the fit lacks adds columns Z (m, k) times an
unknown size s. All parameters of the fit may follow. Then, to first order,

    N = Zᵀ W Z - Zᵀ W J (Jᵀ W J + P)⁻¹ Jᵀ W Z,   s = -N⁻¹ Zᵀ W r,   gain = sᵀ N s

where the gain is the drop in the squared residuals. Nothing is fitted again. Without the effect,

    F = (gain / k) / (left / freedom)

has Fisher's distribution F(k, freedom). Where several rows share an error (`LinearFit.clusters`),
F is divided by the design effect: how much more the scores vary than independent rows would.

References:
    C. R. Rao, Large sample tests of statistical hypotheses concerning several parameters, Proc.
    Camb. Phil. Soc. 44 (1948) 50-57, doi:10.1017/S0305004100023987.
    R. D. Cook, S. Weisberg, Residuals and Influence in Regression (1982), section 2.3.2.
    L. Kish, Survey Sampling (1965): the design effect.
    C. Cameron, J. Gelbach, D. Miller, Robust inference with multiway clustering (2011),
    doi:10.1198/jbes.2010.07136: rows that belong to two clusters.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final, overload

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.trust.linear_fit import LinearFit
from suta_calib.trust.rule import Rule

# p-value by clusters that an effect must have in any case: the design effect is an average over all
# effects, and a single cluster must not make a finding.
SUPPORTED: Final = 0.05
# Predicted standard deviation of a size over its plausible size, up to which the data can tell it.
TELLING: Final = 0.25


@dataclass(frozen=True, eq=False)
class Stretches(Displayable, Sequence[FloatArray]):
    """Windows that are runs of samples: 1 from one sample up to another, 0 elsewhere.

    Sums over the rows between any two edges serve all of them, so that every time at which
    something may have changed costs as much as one (Andrews 1993, doi:10.2307/2951764).

    Attributes:
        sample: (m,) number of the sample that each row looks at.
        places: (w, 2) number of the first sample, and of the one after the last.
    """

    sample: IntArray
    places: IntArray

    def __len__(self) -> int:
        return len(self.places)

    @overload
    def __getitem__(self, index: int) -> FloatArray: ...
    @overload
    def __getitem__(self, index: slice) -> list[FloatArray]: ...
    def __getitem__(self, index: int | slice) -> FloatArray | list[FloatArray]:
        """(m,) one of them."""
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        first, end = self.places[index]
        return np.asarray((self.sample >= first) & (self.sample < end), dtype=float)

    def sums(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """(w, k, c) products of rows (m, k) and (m, c), summed within each window."""
        edges = np.unique(self.places)
        bins = np.searchsorted(edges, self.sample, side="right")
        order = np.argsort(bins, kind="stable")
        binned = np.zeros((len(edges) + 1, left.shape[1], right.shape[1]))
        for rows in np.split(order, np.flatnonzero(np.diff(bins[order])) + 1):
            if len(rows):
                binned[bins[rows[0]]] = left[rows].T @ right[rows]
        before = np.cumsum(binned, axis=0)
        ends = np.searchsorted(edges, self.places)
        return np.asarray(before[ends[:, 1]] - before[ends[:, 0]])


@dataclass(frozen=True, eq=False)
class Effect(Displayable):
    """An error that no parameter of the fit describes, such as a base that moved.

    Attributes:
        name: what it is, unique within its hypothesis, such as a joint's name.
        columns: (m, k) change of the whitened residuals per unit of size.
        plausible: (k,) how large a size may be. A component that the data determine no better than
            a quarter of that is left at zero. None: no limit.
        windows: (m,) factors of the rows, one array for each variant that is tried: 0 before and 1
            after a row (`Stretches` serve many at once), a drift from 0 to 1, a single row. None:
            the effect is in all rows alike.
        parameters: names of the parameters of the arm that describe it, where there are any.
        about: what the hypothesis that made it wants to remember.
        log_choices: logarithm of how many such effects it was chosen from, beside its windows:
            which rows suffer, out of all subsets.
    """

    name: str
    columns: FloatArray
    plausible: FloatArray | None = None
    windows: Sequence[FloatArray] | None = None
    parameters: tuple[str, ...] = ()
    about: Any = None
    log_choices: float = 0.0

    def columns_in(self, window: int | None) -> FloatArray:
        """(m, k) in one of the windows."""
        if window is None or self.windows is None:
            return self.columns
        return self.columns * self.windows[window][:, None]


@dataclass(frozen=True, eq=False)
class Evidence(Displayable):
    """The evidence for one effect.

    Attributes:
        effect: which.
        window: number of the window that fits best; None without windows.
        size: (k,) estimate, in the units of the effect; 0 where the data do not determine it.
        covariance: (k, k) of the estimate.
        gain: drop in the squared residuals, in units of the fit's noise.
        share: the gain over all squared residuals of the chains in which the effect can be.
        rank: how many components the data determine.
        noise: variance of one whitened row when the effect is taken into account.
        design: how much more scores vary than those of independent rows; at least 1.
        p_single: p-value of this effect alone.
        p_value: the same for all effects and windows that were tried (Bonferroni).
        moves: (p,) how far the parameters of the fit move with it.
        tried: how many effects and windows were tried.
    """

    effect: Effect
    window: int | None
    size: FloatArray
    covariance: FloatArray
    gain: float
    share: float
    rank: int
    noise: float
    design: float
    p_single: float
    p_value: float
    moves: FloatArray
    tried: int = 1

    @property
    def std(self) -> FloatArray:
        """(k,) standard deviation of each component."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def length(self, components: slice = slice(None)) -> tuple[float, float]:
        """Length of some components of the size as a vector, and its standard deviation."""
        return length_of(self.size[components], self.covariance[components, components])

    @property
    def strength(self) -> tuple[float, float]:
        """To compare the windows of one effect: larger is better."""
        return -self.p_single, self.gain

    def explained(self, fit: LinearFit) -> FloatArray:
        """(m,) by which the residuals of its fit change when it is taken into account."""
        columns = self.effect.columns_in(self.window)
        return np.asarray(columns @ self.size + fit.jacobian @ self.moves)

    @property
    def significance(self) -> float:
        """How many standard deviations the size is away from zero, as a vector."""
        # Of components with different units the length depends on the units, this does not.
        return math.sqrt(max(self.gain / self.noise / self.design / max(self.rank, 1), 0.0))

    def criterion(self, rows: float) -> float:
        """Schwarz's criterion among so many independent rows: larger is better.

        It compares effects with different numbers of components, and with different numbers of
        alternatives that they were chosen from.
        """
        penalty = self.rank * math.log(max(rows, 2.0)) + 2.0 * self._log_choices
        return self.gain / self.noise / self.design - penalty

    @property
    def _log_choices(self) -> float:
        windows = 1 if self.effect.windows is None else len(self.effect.windows)
        return math.log(windows) + self.effect.log_choices

    @property
    def share_beyond_choice(self) -> float:
        """`share` less what the best of so many alternatives explains by chance."""
        chance = 2.0 * self._log_choices * self.noise * self.design
        return self.share * max(1.0 - chance / max(self.gain, 1e-300), 0.0)

    def supported(self, rule: Rule = Rule()) -> bool:
        """Whether it is reported."""
        return (
            self.p_value < rule.false_alarm
            and self.share > rule.share
            and self.significance > rule.times_std
        )


def length_of(vector: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """Length of a vector (k,), and its standard deviation."""
    length = float(np.linalg.norm(vector))
    along = vector / max(length, 1e-300)
    return length, math.sqrt(max(float(along @ covariance @ along), 0.0))


def log_ways(count: int, chosen: int) -> float:
    """Logarithm of the number of ways to choose some of ``count``."""
    return math.lgamma(count + 1) - math.lgamma(chosen + 1) - math.lgamma(count - chosen + 1)


def weigh_effects(fit: LinearFit, effects: Iterable[Effect]) -> list[Evidence]:
    """Test every effect, strongest first (Schwarz's criterion); of windows the best one.

    Args:
        fit: a converged one.
        effects: each is tested alone beside the fit, and all parameters follow.

    Returns:
        Evidence on all effects that the data can tell from the parameters.
    """
    effects = list(effects)
    if not effects:
        return []
    trials = _trials(fit, effects)
    tests = [test for test in trials if test.rank]
    design, tried = _design_effect(fit, tests), sum(test.tried for test in tests)
    best: dict[int, Evidence] = {}
    for test in tests:
        evidence = test.evidence(fit, design, tried)
        before = best.get(id(test.effect))
        # Where all p-values are zero by underflow the gain decides.
        if evidence is not None and (before is None or evidence.strength > before.strength):
            best[id(test.effect)] = evidence
    return sorted(best.values(), key=lambda evidence: -evidence.criterion(fit.rows))


def supported_effects(
    fit: LinearFit, effects: Iterable[Effect], rule: Rule = Rule()
) -> list[Evidence]:
    """Effects that the data support, strongest first: `weigh_effects` by a `Rule`."""
    return [evidence for evidence in weigh_effects(fit, effects) if evidence.supported(rule)]


@dataclass(frozen=True, eq=False)
class _Trial:
    """An effect in one window.

    Attributes:
        effect, window: which.
        moves: (p, k) how all parameters follow.
        axes: (k, rank) directions of the size that the data determine, N = 1 along each.
        score: (rank,) along them.
        tried: of so many windows it is the best.
    """

    effect: Effect
    window: int | None
    moves: FloatArray
    axes: FloatArray
    score: FloatArray
    tried: int = 1

    def columns(self, fit: LinearFit) -> FloatArray:
        """(m, k) that all parameters have followed."""
        return self.effect.columns_in(self.window) + fit.jacobian @ self.moves

    @property
    def rank(self) -> int:
        return int(self.axes.shape[1])

    @property
    def gain(self) -> float:
        return float(self.score @ self.score)

    def evidence(self, fit: LinearFit, design: float, tried: int) -> Evidence | None:
        if fit.noise_freedom is not None:
            noise, freedom = 1.0, fit.noise_freedom
        else:
            freedom = fit.rows - fit.spent - self.rank
            if freedom < 1.0:
                return None
            noise = max(fit.squares - self.gain, 1e-12 * fit.squares, 1e-300) / freedom
        # What is left of the squares sums over all rows, of which only some are independent.
        ratio = self.gain / self.rank / noise / design
        p = float(fdtrc(self.rank, freedom, ratio))
        p = max(p, self._p_by_cluster(fit)) if p * tried < SUPPORTED else p
        size = -self.axes @ self.score
        return Evidence(
            self.effect,
            self.window,
            size,
            noise * design * self.axes @ self.axes.T,
            self.gain,
            self.gain / max(fit.squares_where(self.effect.columns_in(self.window)), 1e-300),
            self.rank,
            noise,
            design,
            p,
            min(1.0, p * tried),
            self.moves @ size,
            tried,
        )

    def _p_by_cluster(self, fit: LinearFit) -> float:
        """0 where the effect is supported by clusters, else its p-value by them.

        It guards against one cluster that makes all of the effect: then the ratio is 1. How many
        unknowns the fit has is no matter here.
        """
        if fit.clusters is None:
            return 0.0
        variance = fit.score_variance(self.columns(fit) @ self.axes, fit.settled)
        ratio = float(self.score @ np.linalg.pinv(variance, hermitian=True) @ self.score)
        freedom = max(fit.cluster_count - self.rank, 1)
        p = float(fdtrc(self.rank, freedom, max(ratio, 0.0) / self.rank))
        return p if p > SUPPORTED else 0.0


def _trials(fit: LinearFit, effects: Sequence[Effect]) -> list[_Trial]:
    """All effects in all windows, with what the parameters cannot imitate."""
    everywhere = [effect for effect in effects if effect.windows is None]
    trials = list[_Trial]()
    # One product for all that are in all rows; of the windows of one effect the columns of all
    # together would need much memory.
    moves = fit.moves(np.hstack([effect.columns for effect in everywhere])) if everywhere else None
    first = 0
    for effect in effects:
        windows: Iterable[int | None] = (None,)
        windows = windows if effect.windows is None else range(len(effect.windows))
        tried = 1
        if isinstance(effect.windows, Stretches):
            likeliest, tried = _likeliest(fit, effect, effect.windows)
            windows = () if likeliest is None else (likeliest,)
        for window in windows:
            columns = effect.columns_in(window)
            if window is None and moves is not None:
                end = first + columns.shape[1]
                follows, first = moves[:, first:end], end
            else:
                follows = fit.moves(columns)
            weighted = columns * fit.weights[:, None]
            curvature = weighted.T @ columns + (weighted.T @ fit.jacobian) @ follows
            alone = np.einsum("mk,mk->k", weighted, columns)
            scale, eigenvalues, axes = _determined(fit, effect, curvature, alone)
            determined = eigenvalues > 0
            axes = scale[:, None] * axes[:, determined] / np.sqrt(eigenvalues[determined])
            score = axes.T @ (weighted.T @ fit.settled)
            trials.append(_Trial(effect, window, follows, axes, score, tried))
    return trials


def _determined(
    fit: LinearFit, effect: Effect, curvature: FloatArray, alone: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Scale (..., k) of an effect's components, eigenvalues of the scaled curvature, directions.

    By its curvature (..., k, k) when the parameters follow, and its diagonal when they do not; an
    eigenvalue is 0 where the data do not determine the direction.
    """
    if effect.plausible is None:
        # Part of a column's squares that must remain when the parameters follow, where no plausible
        # size is stated: less is rounding.
        independent = 1e-6
        scale, least = 1.0 / np.sqrt(np.maximum(alone, 1e-300)), independent
    else:
        stated = fit.noise_freedom is not None
        noise = 1.0 if stated else fit.squares / max(fit.rows - fit.spent, 1.0)
        scale = np.broadcast_to(effect.plausible, alone.shape)
        least = noise / TELLING**2
    scaled = curvature * scale[..., :, None] * scale[..., None, :]
    eigenvalues, axes = np.linalg.eigh(scaled)
    return scale, np.where(eigenvalues > max(least, 1e-300), eigenvalues, 0.0), axes


def _likeliest(fit: LinearFit, effect: Effect, windows: Stretches) -> tuple[int | None, int]:
    """The window whose effect is least likely by chance, and how many could be tested."""
    width = effect.columns.shape[1]
    weighted = effect.columns * fit.weights[:, None]
    beside = np.hstack([effect.columns, fit.settled[:, None], fit.jacobian])
    sums = windows.sums(weighted, beside)
    square, score, cross = np.split(sums, [width, width + 1], axis=2)
    curvature = square - cross @ fit.inverse @ np.swapaxes(cross, 1, 2)
    alone = np.einsum("wkk->wk", square)
    scale, eigenvalues, axes = _determined(fit, effect, curvature, alone)
    determined = eigenvalues > 0
    along = np.einsum("wkr,wk->wr", axes, scale * score[:, :, 0])
    root = np.sqrt(np.where(determined, eigenvalues, 1.0))
    gain = np.sum(np.where(determined, along / root, 0.0) ** 2, axis=1)
    rank = np.sum(determined, axis=1)
    best: tuple[float, float, int] | None = None
    for k in np.unique(rank[rank > 0]).tolist():
        # Of equal ranks the largest gain is the least likely.
        at = int(np.argmax(np.where(rank == k, gain, -np.inf)))
        freedom = fit.rows - fit.spent - k
        if freedom < 1.0:
            continue
        left = max(fit.squares - float(gain[at]), 1e-12 * fit.squares, 1e-300)
        p = float(fdtrc(k, freedom, float(gain[at]) / k / (left / freedom)))
        if best is None or (p, -gain[at]) < best[:2]:
            best = p, -float(gain[at]), at
    return None if best is None else best[2], int(np.sum(rank > 0))


def _design_effect(fit: LinearFit, tests: Sequence[_Trial]) -> float:
    """How much more the scores vary than those of independent rows, on average over all tests.

    A single effect's own would be unsure where touches are few. The strongest effect is taken from
    the residuals first: what it explains is no noise.
    """
    if fit.clusters is None or not tests:
        return 1.0
    best = max(tests, key=lambda test: test.gain)
    residual = fit.settled - best.columns(fit) @ (best.axes @ best.score)
    freedom = max(fit.rows - fit.spent - best.rank, 1.0)
    noise = max(fit.squares - best.gain, 1e-12 * fit.squares, 1e-300) / freedom
    axes = np.hstack([test.columns(fit) @ test.axes for test in tests])
    variance = np.diag(fit.score_variance(axes, residual)) * fit.rows / freedom
    return max(1.0, float(np.mean(variance)) / noise)
