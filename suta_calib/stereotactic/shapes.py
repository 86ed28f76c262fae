"""Checks whether rigid bodies have their shape in every frame, compared with their scatter.

What the markers of a body miss its shape by in the same way in all frames is no noise: noise has no
memory. Nor is what a few of them miss it by, far beyond what the others scatter.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import chdtri

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import extent, register_points, rms_length, skew
from suta_calib.pose_calibration.consensus import DIMENSION, outlier_limit
from suta_calib.pose_calibration.rigid_fit import ENOUGH_TO_JUDGE
from suta_calib.stereotactic.distortion import smooth_distortion
from suta_calib.stereotactic.marker_cloud import OF_A_POSE, BodyPoses, MarkerCloud, ObservedBody
from suta_calib.trust.evidence import Effect, weigh_effects
from suta_calib.trust.linear_fit import LinearFit
from suta_calib.units import mm
from suta_calib.words import listed

# Misfit of rigid markers that no noise makes, as part of their extent: another unit or order.
MISSHAPEN: Final = 0.02
# m, standard deviation of a coordinate that is written with two decimals of a millimetre, and a
# misfit that is worth a word.
ROUNDED: Final = 0.01e-3 / np.sqrt(12.0)
WORTH_A_WORD: Final = 0.03e-3
# Chance of what is said, where nothing is wrong.
CHANCE: Final = 1e-6
# Standard deviations that are not exceeded by chance, of what an answer states too.
SEVERAL: Final = 4.0
# Part of an error that its explanation leaves at most.
EXPLAINED: Final = 0.5
# Frames that are named.
MOST_FRAMES: Final = 3


@dataclass(frozen=True, eq=False)
class GivenShape:
    """A body whose shape calbody gives, as one file shows it.

    Attributes:
        file: with the frames.
        letter: of the markers in it.
        body: as it was seen.
        where: (m, 3) places in the body that are told by its poses, m.
        what: those are.
        answer: what is answered there with a standard deviation.
        stated: that (3-D), m; None where none is stated.
        bent: whether a field bends single frames, so that only what all have in common is judged.
    """

    file: str
    letter: str
    body: ObservedBody
    where: FloatArray
    what: str
    answer: str
    stated: float | None
    bent: bool = False

    @property
    def markers(self) -> str:
        """What its markers are called."""
        return f"{self.file}: the {self.letter} markers"


@dataclass(frozen=True, eq=False)
class _Deviation:
    """What all frames have in common of what they miss a given shape by, and why.

    Attributes:
        common: (n, 3) mean over frames, in the body, m.
        scatter: of one coordinate about it, m.
        significant: whether it is more than the scatter makes, and worth a word.
        factor: the markers lie so many times as far apart as they should, and its standard
            deviation; None where that does not explain it.
        marker: the one that explains it, and how far that is off, m; None where none does.
        effect: what the places that it tells are off by for it, RMS, about, m.
    """

    common: FloatArray
    scatter: float
    significant: bool
    factor: tuple[float, float] | None = None
    marker: tuple[int, float] | None = None
    effect: float = 0.0


def on_given_shapes(shapes: Sequence[GivenShape], *, robust: bool) -> tuple[list[str], list[str]]:
    """Bodies that do not look as calbody says, and markers in a few frames: bad, care."""
    bad, care = list[str](), list[str]()
    deviations = list[tuple[GivenShape, _Deviation]]()
    for shape in shapes:
        if not shape.bent and (misshapen := _misshapen(shape)):
            bad.append(misshapen)
            continue
        deviation = _deviation(shape)
        deviations.append((shape, deviation))
        care += [] if shape.bent else _standing_out(shape, deviation, robust)
    for shape, deviation in deviations:
        if not deviation.significant:
            continue
        sentence = (
            f"{shape.markers} {_deviation_sentence(shape, deviation)} "
            f"{_beside(shape, deviation, deviations)} "
        )
        sentence += f"It moves {shape.what} by about {mm(deviation.effect):.2f} mm"
        if shape.stated is not None and deviation.effect > SEVERAL * shape.stated:
            bad.append(f"{sentence}; {shape.answer} states ± {mm(shape.stated):.3f} mm.")
        else:
            care.append(f"{sentence}, which no ± includes.")
    return bad, care


def _misshapen(shape: GivenShape) -> str:
    """Notes on markers in another unit or order; empty if there are none."""
    body = shape.body
    # Where half of the markers are left out, it is they that may be right.
    everything = body.used.mean() < EXPLAINED
    rms = (body.against(body.cloud, np.ones_like(body.used)) if everything else body).misfit
    if rms.max() <= MISSHAPEN * extent(body.cloud.markers):
        return ""
    return (
        f"{shape.file}: {shape.letter} markers of frame {int(np.argmax(rms)) + 1} are "
        f"{mm(rms.max()):.2f} mm RMS from calbody's. Look for another unit or order, or for a "
        "wrong marker."
    )


def _deviation(shape: GivenShape) -> _Deviation:
    residuals, used = shape.body.residuals, shape.body.used
    frames, n = used.shape
    counts = used.sum(axis=0)
    common = np.nansum(residuals, axis=0) / np.maximum(counts, 1)[:, None]
    scatter, chance = _in_common(shape.body)
    size = rms_length(common[counts > 0])
    # Fewer frames show no scatter.
    if frames < 3 or size <= WORTH_A_WORD or chance >= CHANCE:
        return _Deviation(common, scatter, False)
    factor, left = _scale(shape.body)
    by_scale = rms_length((common - left)[counts > 0])
    marker, by_marker, moved = _one_marker(shape, common, counts > 0)
    if min(by_scale, by_marker) > EXPLAINED * size:
        levers = [shape.body.cloud.amplified(place) ** 2 for place in shape.where]
        lever = float(np.sqrt(np.mean(levers)))
        return _Deviation(common, scatter, True, effect=lever * size / np.sqrt(max(n - 2, 1)))
    if by_marker < by_scale:
        return _Deviation(common, scatter, True, marker=marker, effect=moved)
    # Of a body that was written in another scale the origin moves too.
    effect = abs(factor[0] - 1.0) * float(np.linalg.norm(shape.body.cloud.markers.mean(axis=0)))
    return _Deviation(common, scatter, True, factor, effect=effect)


def _in_common(body: ObservedBody) -> tuple[float, float]:
    """Scatter of a coordinate about what all frames share, m, and the p-value of that.

    All places of the markers in the body are added to a fit whose parameters move it as a whole.
    """
    frames, n = body.used.shape
    motions = np.concatenate([np.tile(np.eye(3), (n, 1, 1)), -skew(body.cloud.markers)], axis=2)
    used_rows = np.repeat(body.used.ravel(), DIMENSION)
    # A frame's own pose takes six numbers of its markers'.
    left = (DIMENSION * n - OF_A_POSE) / (DIMENSION * n)
    fit = LinearFit(
        np.tile(motions.reshape(-1, OF_A_POSE), (frames, 1))[used_rows],
        body.residuals[body.used].ravel(),
        independent_rows=DIMENSION * int(body.used.sum()) * left + OF_A_POSE,
    )
    places = Effect("places", np.tile(np.eye(DIMENSION * n), (frames, 1))[used_rows])
    for evidence in weigh_effects(fit, [places]):
        return max(float(np.sqrt(evidence.noise)), ROUNDED), evidence.p_single
    return ROUNDED, 1.0


def _scale(body: ObservedBody) -> tuple[tuple[float, float], FloatArray]:
    """How many times as far apart markers lie as they should, its std; what that makes (n, 3)."""
    used = body.used[..., None]
    centre = np.sum(used * body.cloud.markers, axis=1, keepdims=True) / used.sum(axis=1)[:, None]
    arms = used * (body.cloud.markers - centre)
    squares = np.sum(arms**2, axis=(1, 2))
    by_frame = np.nansum(body.residuals * arms, axis=(1, 2)) / squares
    scale, std = float(by_frame.mean()), float(by_frame.std(ddof=1)) / np.sqrt(len(by_frame))
    # Frames that are the same are rounded alike.
    std = max(std, float(ROUNDED / np.sqrt(squares.mean())))
    return (1.0 + scale, std), scale * (body.cloud.markers - body.cloud.markers.mean(axis=0))


def _one_marker(
    shape: GivenShape, common: FloatArray, observed: BoolArray
) -> tuple[tuple[int, float] | None, float, float]:
    """The marker without which the others have their shape best, and how far it is off, m.

    Also the RMS that stays of the others, and what the places are moved by for it, RMS, m.
    """
    given = shape.body.cloud.markers
    shown, candidates = given + common, list[tuple[float, int, float, float]]()
    if observed.sum() < ENOUGH_TO_JUDGE:
        return None, float("inf"), 0.0
    for marker in map(int, np.flatnonzero(observed)):
        remaining = observed & (np.arange(len(given)) != marker)
        R, p = register_points(given[remaining], shown[remaining])
        difference = given @ R.T + p - shown
        moved = rms_length(shape.where @ R.T + p - shape.where)
        off = float(np.linalg.norm(difference[marker]))
        candidates.append((rms_length(difference[remaining]), marker, off, moved))
    left, marker, off, moved = min(candidates)
    return (marker, off), left, moved


def _deviation_sentence(shape: GivenShape, deviation: _Deviation) -> str:
    if deviation.factor is not None:
        factor, std = deviation.factor
        if shape.bent:  # A correction that was fitted to them follows a part of it.
            return f"lie {factor:.4f} times as far apart as in calbody, corrected."
        return f"lie {factor:.6f} ± {std:.6f} times as far apart as in calbody."
    scatter = f"they scatter by {mm(deviation.scatter * np.sqrt(DIMENSION)):.3f} mm RMS"
    if deviation.marker is not None:
        marker, off = deviation.marker
        return (
            f"do not have calbody's shape, the same in all frames: marker {marker + 1} is "
            f"{mm(off):.2f} mm from the place that the others predict, and {scatter}."
        )
    rms = mm(rms_length(deviation.common))
    return f"are {rms:.2f} mm RMS from calbody's shape, the same in all frames, and {scatter}."


def _beside(
    shape: GivenShape, deviation: _Deviation, deviations: Iterable[tuple[GivenShape, _Deviation]]
) -> str:
    """What another file says of the same body: which of the two is to be doubted."""
    for other, its in deviations:
        if other is shape or other.letter != shape.letter:
            continue
        if rms_length(deviation.common - its.common) < EXPLAINED * rms_length(deviation.common):
            return f"The same is true in {other.file}: look for a mistake in calbody."
        how = "have yet another shape" if its.significant else "have calbody's shape"
        return f"In {other.file} they {how}: a marker was moved, or is read wrongly."
    if shape.bent and deviation.factor is None and deviation.marker is None:
        return "Look for a mistake in calbody, or for frames in which something else was moved."
    return "Look for a mistake in calbody, or for a marker that was moved."


def _standing_out(shape: GivenShape, deviation: _Deviation, robust: bool) -> list[str]:
    """Markers of a few frames far off where they usually are in the body."""
    used = shape.body.used
    difference = np.nan_to_num(shape.body.residuals - deviation.common)
    sizes = np.linalg.norm(difference, axis=-1)
    sigma = float(np.median(sizes[used])) / np.sqrt(chdtri(DIMENSION, 0.5))
    # What markers of normal errors are not off by, times this: instruments have longer tails.
    limit = 2.0 * np.sqrt(outlier_limit(sizes.size, 1)) * max(sigma, ROUNDED)
    far = sizes > limit + WORTH_A_WORD
    if not far.any():
        return []
    frames = [str(frame + 1) for frame in np.flatnonzero(far.any(axis=1))]
    leave = "" if robust or sizes.shape[1] < ENOUGH_TO_JUDGE else " --robust leaves them out."
    return [
        f"{shape.file}: {shape.letter} markers are up to {mm(sizes.max()):.2f} mm from their "
        f"places in the body in other frames (frame {listed(frames, MOST_FRAMES)}), where "
        f"{mm(sigma * np.sqrt(DIMENSION)):.3f} mm RMS are usual. The poses in these frames are "
        f"wrong by a part of that.{leave}"
    ]


@dataclass(frozen=True, eq=False)
class ObservedProbe:
    """The EM probe, corrected, in every file that has frames of it.

    Attributes:
        bodies: by file; the first is its pivot.
        bent: whether a distortion is not corrected.
        outside: (N_frames,) what the correction errs for frames outside where it was fitted, by
            file, m.
        tip: (3,) in the probe, m.
        stated: (N_frames,) standard deviations (3-D) of tips that stand each for itself, by file.
    """

    bodies: Mapping[str, ObservedBody]
    bent: bool
    outside: Mapping[str, FloatArray]
    tip: FloatArray
    stated: Mapping[str, FloatArray]


def on_probe(probe: ObservedProbe) -> tuple[list[str], list[str]]:
    """Frames in which the EM probe's shape differs from that in the pivot: reasons bad, and care.

    A pivot, and a registration, notice a frame that does not fit the others; a tip that is only
    looked for has none. What is usual the same files tell, of the pivot and of all others.
    """
    pivot, bad, care = next(iter(probe.bodies)), list[str](), list[str]()
    shape = _usual_shape(probe.bodies[pivot])
    misfit = {kind: body.against(shape).misfit for kind, body in probe.bodies.items()}
    rest = [rms for kind, rms in misfit.items() if kind != pivot] or [misfit[pivot]]
    usual = max(float(np.median(misfit[pivot])), float(np.median(np.concatenate(rest))))
    size, n = extent(shape.markers), len(shape.markers)
    lever = shape.amplified(probe.tip) / np.sqrt(max(n - 2, 1))
    freedom = max(DIMENSION * n - OF_A_POSE, 1)
    frames = sum(map(len, misfit.values()))
    unlike = np.sqrt(chdtri(freedom, CHANCE / frames) / (chdtri(freedom, 0.5)))
    # In units of what frames usually miss the shape by, that is no noise; and no distortion, where
    # it is not corrected.
    unlike = max(unlike, 5.0 if probe.bent else 3.0)
    for kind, rms in misfit.items():
        limit = unlike * np.hypot(usual, probe.outside.get(kind, 0.0)) + WORTH_A_WORD
        if not (rms > limit).any():
            continue
        frame = int(np.argmax(np.where(rms > limit, rms, 0.0)))
        sentence = (
            f"{kind}: the probe's markers of frame {frame + 1} are {mm(rms[frame]):.2f} mm RMS "
            f"from their shape in {pivot}, where {mm(usual):.3f} mm are usual. Look for another "
            "unit or order, or for a wrong marker."
        )
        effect, stated = lever * rms, probe.stated.get(kind)
        beyond = stated is not None and bool(np.any((rms > limit) & (effect > SEVERAL * stated)))
        (bad if beyond or rms[frame] > MISSHAPEN * size else care).append(sentence)
    return bad, care


def _usual_shape(pivot: ObservedBody) -> MarkerCloud:
    """The shape that a body has in most of its frames, in its own axes."""
    for _ in range(5):
        # A marker that is left out in every frame stays where it is.
        observed = np.asarray(pivot.used.any(axis=0))
        residuals = np.where(observed[:, None], pivot.residuals, 0.0)
        usual = np.nanmedian(residuals, axis=0)
        pivot = pivot.against(MarkerCloud(pivot.cloud.markers + usual))
    return pivot.cloud


def on_late_base(
    base: BodyPoses, placed: BodyPoses, body: FloatArray, measured: FloatArray
) -> tuple[list[str], list[str]]:
    """Whether the EM tracker's base was read a frame later, or earlier, than the object: bad, care.

    Then the EM readings of a frame err together, as its neighbours in place do not, and by just
    what the base moved by from frame to frame.
    """
    rows, nothing = np.arange(1, len(measured) - 1), (list[str](), list[str]())
    # Fewer frames cannot be sorted into groups.
    if len(rows) < 8:
        return nothing
    em_markers = placed.to_tracker(body)[rows]

    def expected(lag: int) -> FloatArray:
        return base.of(rows + lag).to_body(em_markers)

    def left(places: FloatArray) -> FloatArray:
        """Mean square residual of a smooth distortion, by frame."""
        fit = smooth_distortion(measured[rows], places)
        return np.asarray(np.mean(np.sum(fit.residuals**2, axis=-1), axis=-1))

    now = expected(0)
    moved = {lag: rms_length(expected(lag) - now) for lag in (1, -1)}
    if max(moved.values()) < WORTH_A_WORD:
        return nothing
    try:
        before = left(now)
        # If the base is read late, the error is the motion of the base.
        after = {
            lag: left(expected(lag))
            for lag, by in moved.items()
            if EXPLAINED * by < np.sqrt(before.mean())
        }
    except SamplesError:
        return nothing
    if not after:
        return nothing
    lag = min(after, key=lambda lag: float(after[lag].mean()))
    gain, best, off = before - after[lag], float(after[lag].mean()), moved[lag]
    std = float(gain.std(ddof=1)) / np.sqrt(len(gain))
    if gain.mean() < SEVERAL * std or best > EXPLAINED * before.mean():
        return nothing
    sentence = (
        f"The EM markers agree with the optical tracker to {mm(np.sqrt(best)):.2f} mm RMS, not "
        f"{mm(np.sqrt(before.mean())):.2f} mm, if each frame of calreadings has the D markers of "
        f"the one {'after' if lag > 0 else 'before'} it: they seem to be one frame "
        f"{'late' if lag > 0 else 'early'}. This makes the expected EM markers wrong by "
        f"{mm(off):.2f} mm RMS."
    )
    return ([sentence], []) if off > SEVERAL * np.sqrt(best) else ([], [sentence])
