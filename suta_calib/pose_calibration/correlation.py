"""Errors that similar rows share, and their part in an estimate's covariance.

A robot errs alike in neighbouring poses, a camera alike where it sees the target in the same place,
and a tracker alike a moment later. Least squares takes every row for a cluster of its own, so its ±
is too small. How much the errors of neighbours have in common, and how near they must be for it, is
asked of the residuals: a part w of their variance with a correlation that falls with the distance
in some space. Its restricted likelihood (Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545)
allows for what the fit took up. Places and turns are asked apart, because a hand may turn wrongly
in a smooth way where its places only scatter. Few rows tell little of it, so the covariance is the
mean over all that might be, each weighed by its likelihood.

An arm whose lengths, angles and encoders are off errs by smooth functions of its posture. Where the
joints are not known the pose takes their place: errors, in the base's axes, are a Gaussian process
over poses with the correlation of Matérn with ν = 3/2, which is smooth but of no particular wave
length (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, section 4.2). Its
first principal components are functions of the pose (Nyström's approximation, section 8.1); what
the others would add is noise of each pose.

The first joints turn and shift all poses about the base, and the last ones all in the hand. No
picture shows that: X and Z follow it. So it stands in their ±, as a part of what neighbours share.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import rms_length, skew
from suta_calib.terms.block import summed
from suta_calib.trust.serial_correlation import correlation_length

# Singular value, of columns of unit length, that is none.
DEPENDENT: Final = 1e-5
# Extent, m, of poses that are all at one place.
NOWHERE: Final = 1e-9
# Directions and turns of a pose.
DIRECTIONS: Final = 3
WAYS: Final = 2 * DIRECTIONS


def common_covariance(
    jacobian: FloatArray,
    residual: FloatArray,
    weight: FloatArray,
    bread: FloatArray,
    neighbourhoods: Sequence[FloatArray],
    order: IntArray,
    rests: IntArray,
    sizes: Sequence[int],
    frames: Sequence[FloatArray] = (),
) -> FloatArray:
    """Covariance (p, p) of an estimate beyond that of rows that err independently.

    Args:
        jacobian: (n, d, p) in units of the residuals' scatter.
        residual: (n, d) in units of their scatter.
        weight: (d,) of each component in the fit, over what its scatter deserves.
        bread: (p, p) inverse of the fit's curvature.
        neighbourhoods: spaces (n, k) in which rows that are near each other may err alike; 1 is
            far.
        order: (n,) place of each row in its series.
        rests: (n,) rows of one rest or posture, from 0, which say once what they say.
        sizes: of the groups of components, d in all, whose errors have nothing in common: a hand's
            turns may be alike where its places scatter.
        frames: of each group, if given, the rotations (n, size, size) into another frame in which
            they may be alike instead: a hand errs alike in the base's frame, an eye in its own.
    """
    if not len(bread):
        return np.zeros_like(bread)
    expected, white = np.zeros_like(bread), np.zeros_like(bread)
    ends = np.cumsum(sizes)
    for k, (size, end) in enumerate(zip(sizes, ends.tolist(), strict=True)):
        part, turn = slice(end - size, end), frames[k] if frames else None
        group = jacobian[:, part], residual[:, part], weight[part]
        mine = _variances(*group, turn, neighbourhoods, order, rests)
        if mine is not None:
            expected += mine[0]
            white += mine[1]
    return bread @ _positive(expected - white, white) @ bread


def _variances(
    jacobian: FloatArray,
    residual: FloatArray,
    weight: FloatArray,
    turn: FloatArray | None,
    neighbourhoods: Sequence[FloatArray],
    order: IntArray,
    rests: IntArray,
) -> tuple[FloatArray, FloatArray] | None:
    """Variance (p, p) of one group's pull, and of independent rows'; None where nothing is left."""
    n, size, unknowns = jacobian.shape
    count = np.bincount(rests).astype(float)
    groups = len(count)
    first = np.unique(rests, return_index=True)[1]

    def of_rests(rows: FloatArray) -> FloatArray:
        total = summed(rows.reshape(n, -1), rests, groups) / count[:, None]
        return np.asarray(total.reshape(groups, *rows.shape[1:]))

    def view(residual: FloatArray, jacobian: FloatArray) -> tuple[FloatArray, ...]:
        slope = of_rests(jacobian)
        return of_rests(residual), slope, slope * (count[:, None, None] * weight[:, None])

    views = [view(residual, jacobian)]
    if turn is not None:
        views.append(view(_turned(turn, residual), _turned(turn, jacobian)))
    mean, followed = views[0][0], _rank(jacobian)
    inside = float(np.sum((residual - mean[rests]) ** 2)) / max(size * (n - groups), 1)
    between = float(np.sum(mean**2)) / max(size * groups - followed, 1)
    if between == 0.0:
        return None
    # Of a group's mean: what its readings have for themselves, and what they share.
    single = inside / count
    # Least variance of a group's mean, as part of all, that is no rounding.
    shared = between if groups == n else max(between - float(single.mean()), 1e-6 * between)
    if groups == n:
        single = np.zeros(groups)
    white = np.einsum("ndp,ndq->pq", jacobian * weight[:, None] ** 2, jacobian)
    white *= float(np.sum(residual**2)) / max(size * n - followed, 1)
    spaces = [space[first] for space in neighbourhoods]
    # The order of rows is a reason only where neighbours in it are seen to be alike.
    series = (
        order[first].astype(float) if correlation_length(mean[np.argsort(first)]) > 1.0 else None
    )
    # Rows of which the likelihood is asked: what is intensive, so many tell it.
    sampled = np.unique(np.linspace(0, groups - 1, min(groups, 200)).astype(np.intp))
    means, slopes, pulls = (np.array(item) for item in zip(*views, strict=True))
    pulls = pulls.reshape(len(views), groups, size * unknowns)

    def of_pulls(rows: FloatArray) -> FloatArray:
        """(views, p, p) of their products with what a covariance makes of them."""
        left, right = (parts.reshape(len(views), -1, unknowns) for parts in (pulls, rows))
        return np.asarray(left.transpose(0, 2, 1) @ right)

    alone, by_itself = of_pulls(single[:, None] * pulls), of_pulls(pulls)
    likelihoods, variances = list[FloatArray](), list[FloatArray]()
    for prior, shape, parts in kernels(spaces, series, groups):
        part = np.array(parts)[:, None, None]
        kernel = (1.0 - part) * np.eye(len(sampled)) + part * shape[np.ix_(sampled, sampled)]
        log_likelihood, scale = _restricted(
            np.diag(single[sampled]) + shared * kernel, slopes[:, sampled], means[:, sampled]
        )
        part = part[..., None]
        common = (1.0 - part) * by_itself + part * of_pulls(shape @ pulls)
        variances.append(
            (scale[..., None, None] * (alone + shared * common)).reshape(-1, *white.shape)
        )
        likelihoods.append(np.log(prior / len(views)) + log_likelihood.ravel())
    likelihood = np.concatenate(likelihoods)
    if not np.isfinite(likelihood).any():
        return None
    belief = np.exp(likelihood - likelihood.max())
    expected = np.tensordot(belief / belief.sum(), np.concatenate(variances), axes=1)
    return expected, white


def _turned(rotation: FloatArray, rows: FloatArray) -> FloatArray:
    """Rows (n, d) or (n, d, p), each in another frame."""
    return np.asarray(np.einsum("nij,nj...->ni...", rotation, rows))


def _rank(jacobian: FloatArray) -> int:
    """How many unknowns rows (n, d, p) follow: turns say nothing of a displacement."""
    flat = jacobian.reshape(-1, jacobian.shape[2])
    length = np.linalg.norm(flat, axis=0)
    return int(np.linalg.matrix_rank(flat / np.where(length > 0.0, length, 1.0), DEPENDENT))


def embedded(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """Poses as points (n, 12) of a space, whose distances are those of places and turns, rad.

    Positions are in units of the extent, so that 1 is far.
    """
    return np.hstack([position, rotation.reshape(-1, 9) / np.sqrt(2.0)])


def kernels(
    spaces: Sequence[FloatArray], series: FloatArray | None, count: int
) -> Iterator[tuple[float, FloatArray, Sequence[float]]]:
    """What neighbours may share (count, count), by which parts, and how probable each part is."""
    # Part of the variance that neighbours may share. An arm repeats some fifteen times better than
    # it is accurate: what its neighbouring poses do not share may be that little.
    parts = (0.3, 0.6, 0.9, 0.98, 0.996)
    # Prior probability that the errors of rows are independent.
    independent = 0.8
    yield independent, np.eye(count), (0.0,)
    shapes = list[FloatArray]()
    if series is not None:
        steps = np.abs(series[:, None] - series[None])
        # The same in rows, one after the other.
        lags = (1.5, 5.0, 15.0, 50.0)
        shapes += [np.exp(-steps / lag) for lag in lags]
    # How far apart rows are that share about half of it, in the space in which 1 is far. What
    # reaches farther than the rows is mostly in X, and shows only by the part that is not.
    reaches = (0.1, 0.3, 0.9, 2.7)
    for space in spaces:
        distances = np.linalg.norm(space[:, None] - space[None], axis=2)
        shapes += [_matern(distances, reach) for reach in reaches]
    for shape in shapes:
        yield (1.0 - independent) / (len(shapes) * len(parts)), shape, parts


def _restricted(
    covariance: FloatArray, slope: FloatArray, mean: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Restricted log-likelihood (k, v) of rows, seen in v ways, and the factor on their covariance.

    Covariances are (k, n, n), slopes (v, n, d, p), means (v, n, d).
    """
    views, n, size, unknowns = slope.shape
    # NumPy's for all of it: to import SciPy's triangular solver takes longer than it would save.
    factor = np.linalg.cholesky(covariance)
    columns = np.concatenate([slope.reshape(views, n, -1), mean], axis=2)
    # One matrix for all of them: NumPy before 2 takes (n, v) beside (k, n, n) for vectors.
    solved = np.linalg.solve(covariance, columns.transpose(1, 0, 2).reshape(1, n, -1))
    solved = solved.reshape(len(covariance), n, *columns.shape[::2]).transpose(0, 2, 1, 3)
    ends = size * unknowns
    solved_slope = solved[..., :ends].reshape(len(covariance), views, n * size, unknowns)
    information = slope.reshape(views, n * size, unknowns).transpose(0, 2, 1) @ solved_slope
    diagonal = np.diagonal(information, axis1=2, axis2=3)
    unit = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
    values, vectors = np.linalg.eigh(information * unit[..., None] * unit[..., None, :])
    # Unknowns of which these rows say nothing take nothing from them.
    determined = values > DEPENDENT**2 * values.max(axis=2, keepdims=True)
    values = np.where(determined, values, 1.0)
    freedom = n * size - determined.sum(axis=2)
    pull = unit * np.einsum("kvnp,vn->kvp", solved_slope, mean.reshape(views, -1))
    sums = np.einsum("kvpq,kvp->kvq", vectors, pull)
    power = np.einsum("kvnd,vnd->kv", solved[..., ends:], mean)
    power -= np.sum(np.where(determined, sums**2 / values, 0.0), axis=2)
    scale = np.maximum(power, 1e-300) / np.maximum(freedom, 1)
    log_determinant = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)[:, None]
    # An undetermined unknown has no unit.
    lengths = np.log(np.where(unit < 1e149, unit, 1.0)).sum(axis=2)
    fitted = np.log(values).sum(axis=2) - 2.0 * lengths
    likelihood = -size * log_determinant - 0.5 * (fitted + freedom * np.log(scale))
    return np.where(freedom < 1, -np.inf, likelihood), scale


def _positive(matrix: FloatArray, scale: FloatArray) -> FloatArray:
    """The positive part of a symmetric matrix, whatever the units of its rows."""
    unit = np.sqrt(np.maximum(np.diag(scale), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(unit, unit))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(unit, unit))


def shared_errors(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """What poses of a hand are off by, (n, 6, k) per unit of each coefficient, in the base's axes.

    Coefficients come in sixes, three displacements and three turns, each of which gives errors of
    about unit variance; none of few poses, or of poses of which something is not known.
    """
    # Part of the variance of what neighbours share that all poses have in common in the hand, and
    # as much about the base: that of two joints of six.
    common = 1.0 / 3.0
    n = len(position)
    # Poses from which on neighbours tell what they share: six figures each, for as many of X and Z.
    if n < 8 or not (np.isfinite(position).all() and np.isfinite(rotation).all()):
        return np.zeros((n, WAYS, 0))
    distance = max(rms_length(position), NOWHERE)
    smooth = _components(embedded(rotation, position / distance))
    of_pose = np.einsum("nk,cd->nckd", smooth, np.eye(WAYS)).reshape(n, WAYS, -1)
    turned = slice(DIRECTIONS, WAYS)
    in_hand, about_base = np.zeros((2, n, WAYS, WAYS))
    in_hand[:, :DIRECTIONS, :DIRECTIONS] = in_hand[:, turned, turned] = rotation
    about_base += np.eye(WAYS)
    about_base[:, :DIRECTIONS, turned] = -skew(position)
    return np.concatenate([of_pose, *np.sqrt(common) * np.stack([in_hand, about_base])], axis=2)


def _components(space: FloatArray) -> FloatArray:
    """(n, k) smooth functions of poses that are points (n, d) of a space in which 1 is far."""
    # More poses make no difference to the components.
    n = len(space)
    sampled = space[np.unique(np.linspace(0, n - 1, min(n, 150)).astype(np.intp))]
    values, vectors = np.linalg.eigh(_correlation(sampled, sampled))
    values, vectors = values[::-1], vectors[:, ::-1]
    # Most components, and the part of the variance that they should have at least.
    k = min(int(np.searchsorted(np.cumsum(values), 0.99 * values.sum())) + 1, 10)
    return np.asarray(_correlation(space, sampled) @ vectors[:, :k] / np.sqrt(values[:k]))


def _correlation(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, m) between the errors of two sets of poses."""
    # How far apart poses are that share about half of their errors, where 1 is a turn by a radian
    # or a way as long as from the base to the hand. Simulated arms with wrong lengths and angles
    # (0.5 mm, 0.13°) or eccentric joints have X nearest to the truth with 2; with 1 its ± is too
    # small, as what all poses have in common is taken for little, and with 4 it is too large.
    return _matern(np.linalg.norm(a[:, None] - b[None], axis=2), reach=2.0)


def _matern(distances: FloatArray, reach: float) -> FloatArray:
    """Matérn's correlation with ν = 3/2: smooth errors, of no particular wave length."""
    far = np.sqrt(3.0) * distances / reach
    return np.asarray((1.0 + far) * np.exp(-far))
