"""A depth camera, from planes or points that it saw and the poses of the hand."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, Final, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Assessment, Level, judged
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError, SamplesError, SutaCalibWarning
from suta_calib.geometry.numbers import (
    extent,
    homogeneous,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from suta_calib.measurements import Board
from suta_calib.measurements.pose_files import FAR, HandPoses
from suta_calib.measurements.samples import Samples
from suta_calib.measurements.scale import GRADES, PPM
from suta_calib.measurements.seen_points import SeenPoints
from suta_calib.pose_calibration.eye_poses import ENOUGH, AccuracyOfX, placed_points
from suta_calib.pose_calibration.inputs import checked_poses, error_context
from suta_calib.pose_calibration.robust_answer import (
    MANY_OUTLIERS,
    FittedRows,
    exchanged,
    set_aside,
)
from suta_calib.pose_calibration.undetermined import axes_that_stand
from suta_calib.terms.depth_fit import DepthFit, fit_depth, middle_off
from suta_calib.terms.depth_rows import (
    EXACT,
    SCALE,
    SHARED,
    BoardMarks,
    DepthRows,
    PlaneMarks,
    PointMarks,
    State,
    seen_terms,
)
from suta_calib.terms.depth_term import DepthTerm
from suta_calib.terms.hand_eye_start import (
    EYE_IN_HAND,
    EYE_TO_HAND,
    FEWEST,
    EyeSetup,
    Poses,
    as_eye_in_hand,
    inverse_poses,
)
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.trust.uncertainty_budget import (
    AS_STATED,
    KnownScatter,
    UncertaintyBudget,
    pose_budgets,
)
from suta_calib.units import from_deg, mm, text
from suta_calib.words import enumerated, listed

# Of the camera's lengths, as of a print: 5,000 ppm.
SCALE_PPM: Final = GRADES["printed"] / PPM
# Standard deviations of X from which on it is not known at all, m and rad.
_OPEN: Final = 50e-3, from_deg(10.0)
# What is known beforehand, as `State.priors` has it.
_ASSUMED: Final = (
    "scale of the camera's lengths, as assumed beforehand",
    "size of the board, as its file states it",
)
_CAUSES: Final = (
    "does each picture belong to the pose with its name, is the quaternion's order x y z w, is the "
    "setup right, and do the poses map from the hand to the base?"
)
_ADVICE: Final = (
    "turn the hand by 20° or more about all three axes, at different distances, or add a plane "
    "that is square to the first"
)


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenThing(Displayable):
    """A plane, a point or a board that a depth camera saw; outside what carries the camera.

    Attributes:
        kind: ``plane``, ``point`` or ``board``.
        name: of it; empty of a board.
        place: (3,) where the point or the board is; of a plane its point next to the origin, m.
        std: of the place (3,), m; of a board also of its turn about its own axes (6,), rad.
        normal: (3,) of a plane.
        tilt_std: of a plane's normal, the larger of both, rad.
        distance_std: of a plane from the origin, m.
        pose: (4, 4) of a board, m.
    """

    kind: str
    name: str
    place: FloatArray
    std: FloatArray
    normal: FloatArray | None = None
    tilt_std: float = 0.0
    distance_std: float = 0.0
    pose: FloatArray | None = None


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class DepthCameraCalibration(Displayable, AccuracyOfX, FittedRows):
    """Pose X of a depth camera on the hand or beside it, and what it saw.

    The covariance (6, 6) is of X: displacement (m, outer axes) and small turn (rad, camera's axes);
    residuals are of every picture: by how much its points are off, on average.

    Attributes:
        setup: ``eye-in-hand`` or ``eye-to-hand``.
        X: (4, 4), ``T_hand_eye``, or ``T_base_eye`` for eye-to-hand; m.
        things: what it saw.
        images: (n,) names of the pictures.
        hand_noise: what the hand seems to err by, one standard deviation, m per axis.
        hand_turn_noise: the same of its turn, rad per axis.
        camera_noise: what the camera errs by, over what is stated.
        scale: by which part the camera's lengths are too long; X allows for it.
        scale_std: its standard deviation.
        scale_by_data: both as the pictures alone have them, whatever is assumed.
        points: (k, 3) everything that was seen, outside what carries the camera, m.
        thing_of: (k,) which of the things each point is of.
        wrong: why X must not be used, one sentence each.
        scatter: how well the scatter behind the covariance is known.
        by_prior: (6, 6) parts of the covariance, by what is assumed beforehand.
    """

    setup: EyeSetup
    X: FloatArray
    things: tuple[SeenThing, ...]
    images: NDArray[np.str_]
    hand_noise: float
    hand_turn_noise: float
    camera_noise: float
    scale: float
    scale_std: float
    scale_by_data: tuple[float, float]
    points: FloatArray
    thing_of: IntArray
    wrong: tuple[str, ...] = ()
    scatter: KnownScatter = AS_STATED
    by_prior: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def budgets(self) -> tuple[UncertaintyBudget, ...]:
        """What the uncertainty of X is made of: its place, and its turn."""
        return pose_budgets("X", self.covariance, self.scatter, self.by_prior)

    @property
    def in_a_line(self) -> str:
        """How well the pictures agree."""
        return f"RMS {text(self.rms, 'm')} mm over {int(self.inliers.sum())} pictures"

    def in_base(self, hand: ArrayLike | None, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Points (k, 3) of the camera in the base, m, and their standard deviations.

        These are by how well X is known.

        Args:
            hand: (4, 4) ``T_base_hand``, m; None for a camera beside the arm.
            points: in the camera, m.
        """
        if self.setup == EYE_IN_HAND and hand is None:
            raise ParameterError("no pose of the hand", "T_base_hand (4, 4)", where="hand")
        carrier = np.eye(4) if self.setup == EYE_TO_HAND else np.asarray(hand, dtype=float)
        return placed_points(carrier, self.X, self.covariance, np.asarray(points, dtype=float))

    @property
    def inverted(self) -> Level:
        """Whether the poses seem to be inverted, which exchanges X and what was seen."""
        seen = [thing for thing in self.things if thing.kind != "plane"]
        if not seen:
            return "good"
        place, std = seen[0].place, np.concatenate([self.std[:3], seen[0].std[:3]])
        ends = [self.X[:3, 3], place]
        held, standing = ends if self.setup == EYE_IN_HAND else ends[::-1]
        return exchanged(held, standing, float(np.linalg.norm(std)))

    @property
    def scale_sentence(self) -> str:
        """That the camera's lengths are off, where the pictures tell so; else empty."""
        found, std = self.scale_by_data
        # The camera's scale is named where the pictures tell it by so many standard deviations, and
        # where it is 1 mm at a metre: less is no matter with a depth camera.
        if abs(found) < max(4.0 * std, 1e-3):
            return ""
        longer = "long" if found > 0 else "short"
        away = 1e3 * abs(found)
        return (
            f"The camera's lengths are {abs(found):.2%} ± {std:.2%} too {longer} against what the "
            f"hand moves, which is {away:.3g} mm at 1 m. X allows for it. Correct the scale of the "
            "depth, or the unit of its steps, before you use the camera's points with X."
        )

    @property
    @judged
    def assessment(self) -> Assessment:
        """How far to trust X."""
        care, bad, count = list[str](), list(self.wrong), int(self.inliers.sum())
        if (share := 1.0 - float(self.inliers.mean())) > MANY_OUTLIERS:
            bad.append(f"{share:.0%} of the pictures do not agree with the others.")
        if self.inverted != "good":
            both = bad if self.inverted == "bad" else care
            both.append(
                "What is on the hand lies farther from it than what stands from the base: are the "
                "poses inverted, or is the setup the other one?"
            )
        if count < ENOUGH:
            care.append(
                f"Only {count} pictures: the standard deviations are uncertain, and a wrong "
                "picture may stay unnoticed. Take a dozen or more."
            )
        if self.unsure():
            care.append(f"{self.unsure()}. To improve it, {_ADVICE}.")
        if self.scale_sentence:
            care.append(self.scale_sentence)
        statement = f"X is known to {self.within} (one standard deviation, 3-D)"
        return Assessment.of(
            "" if bad else f"{statement}; {self.agreed('pictures')}",
            bad=bad,
            care=[*care, *self.notes, *set_aside("pictures", self.inliers)],
        )


def calibrate_depth_camera(
    hand: tuple[ArrayLike, ArrayLike],
    images: Sequence[str],
    *,
    planes: SeenPoints | None = None,
    points: SeenPoints | None = None,
    board: Board | None = None,
    setup: EyeSetup = EYE_IN_HAND,
    scale_ppm: float = SCALE_PPM,
    robust: bool = True,
) -> DepthCameraCalibration:
    """X of a depth camera on the hand or beside it, from planes or points that it saw.

    Planes and points may stand anywhere: they are found too. Everything in a picture shares the
    hand's error, whose size is learnt (`fit_depth`).

    Args:
        hand: ``T_base_hand`` of every picture: rotations (n, 3, 3) and positions (n, 3), m.
        images: (n,) names of the pictures.
        planes: three points or more of each plane in each picture, as command ``planes`` finds.
        points: of balls, or the corners of a board.
        board: whose corners the points are.
        setup: where the camera is.
        scale_ppm: standard deviation of one factor on all lengths of the camera, 1e-6.
        robust: False for least squares over all pictures.

    Raises:
        SamplesError: too few pictures; points in another unit; poses that agree with the points
            only if they are read in another way; or pictures that do not determine X, with the
            directions.
    """
    if setup not in get_args(EyeSetup):
        raise ParameterError(f"setup {setup!r}", f"one of {', '.join(get_args(EyeSetup))}")
    if planes is None and points is None:
        raise ParameterError("neither planes nor points", "one of them, or both")
    rotation, position = checked_poses(*hand, "hand")
    names = np.array(images, dtype=np.str_)
    if len(names) != len(position) or len(set(names.tolist())) != len(names):
        found = f"{len(set(names.tolist()))} names of {len(position)} poses"
        raise SamplesError(found, "a name for each pose, and each only once", where="images")
    away = float(np.median(np.linalg.norm(position, axis=1)))
    if away > FAR:
        raise SamplesError(
            f"poses of the hand about {away:.4g} m from its base",
            "lengths in m",
            where="hand",
            hint="they look like mm: name their columns x_mm, y_mm, z_mm",
        )
    samples = Samples.from_arrays([], np.zeros((len(names), 0)), labels={"image": names})
    poses = MeasuredPoses(rotation, position, samples)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SutaCalibWarning)
        terms = seen_terms(poses, planes, points, board, setup)
    notes = [f"{each.message}." for each in caught]
    rows, numbers = _rows_of(terms, (rotation, position), names, setup, scale_ppm * PPM)
    if len(rows) < FEWEST + 1:
        raise SamplesError(
            f"{len(rows)} pictures that show something",
            f"at least {FEWEST + 1}",
            where="images",
            hint=f"take a dozen or more: {_ADVICE}",
        )
    for term in terms:
        term.check_enough()
    fit = fit_depth(rows, robust=robust)
    _refuse_misread(fit)
    _refuse_open(fit)
    shown, wrong = names[numbers], list[str]()
    judging = fit if robust else fit_depth(rows)
    if not robust and not judging.inliers.all():
        named = listed(shown[~judging.inliers].tolist())
        wrong.append(f"Of the pictures, {named} contradict the others. Solve without --no-robust.")
    notes += _exchanged(judging, shown)
    for term, picture in zip(terms, rows.picture, strict=True):
        fitted = term.take(judging.inliers[picture])
        for sentence, level in fitted.doubts.items():
            # What the camera's scale does to a board is said with what the hand says of it.
            if "sees the board" not in sentence:
                (wrong if level == "bad" else notes).append(sentence)
    return _answer(fit, shown, numbers, tuple(notes), tuple(wrong))


def depth_camera_from_files(
    poses: HandPoses,
    *,
    planes: Sequence[SeenPoints] = (),
    points: Sequence[SeenPoints] = (),
    **options: Any,
) -> DepthCameraCalibration:
    """`calibrate_depth_camera` of files: errors name them, so do notes on their units."""
    files = [*planes, *points]
    with error_context(files[0].path if files else poses.path):
        answer = calibrate_depth_camera(
            *(poses.pose, poses.image.tolist()),
            planes=_together(planes),
            points=_together(points),
            **options,
        )
    return replace(answer, wrong=(*answer.wrong, *poses.unit_notes))


def _together(files: Sequence[SeenPoints]) -> SeenPoints | None:
    """What several files have, as of one."""
    if len(files) < 2:
        return files[0] if files else None
    stated = [one.sigma is not None for one in files]
    if any(stated) and not all(stated):
        raise SamplesError(
            "standard deviations in some of the files",
            "columns sigma_x, sigma_y, sigma_z in all of them, or in none",
            file=files[stated.index(False)].path,
        )
    sigmas = [one.sigma for one in files if one.sigma is not None]
    return SeenPoints(
        np.concatenate([one.image for one in files]),
        np.concatenate([one.point for one in files]),
        np.concatenate([one.position for one in files]),
        np.concatenate(sigmas) if sigmas else None,
    )


def _rows_of(
    terms: tuple[DepthTerm, ...],
    hand: Poses,
    names: NDArray[np.str_],
    setup: EyeSetup,
    scale_std: float,
) -> tuple[DepthRows, IntArray]:
    """The numbers of all pictures that show something, and which of the poses these are of."""
    number = {name: k for k, name in enumerate(names.tolist())}
    images = [[str(i) for i in term.poses.samples.labels["image"]] for term in terms]
    shown = np.unique([number[name] for of_term in images for name in of_term])
    place = {int(k): row for row, k in enumerate(shown)}
    picture = tuple(
        np.array([place[number[name]] for name in of_term], dtype=np.intp) for of_term in images
    )
    carrier = as_eye_in_hand((hand[0][shown], hand[1][shown]), setup)
    return DepthRows(terms, carrier, picture, setup, max(scale_std, EXACT)), shown


# ── what is refused, or named ────────────────────────────────────────────────────────────────────
def _refuse_misread(fit: DepthFit) -> None:
    """Refuse pictures that agree with the poses only if these are read in another way."""
    rows, size = fit.rows, extent(fit.rows.carrier[1])
    middle = float(np.median(np.linalg.norm(fit.sums.off, axis=1)))
    # Part of the extent by which a hand errs no more, if it is read as it is.
    suspicious = 0.01
    if middle < suspicious * size:
        return
    tried = [(middle_off(read), words) for words, read in _readings(rows)]
    best, words = min(tried, key=lambda one: one[0])
    # What fits so many times better is no chance.
    if 5.0 * best < middle and best < suspicious * size:
        raise SamplesError(
            f"pictures that differ from where the hand has them by {mm(middle):.3g} mm, and by "
            f"{mm(best):.3g} mm {words}",
            "poses and pictures that belong together",
            hint="correct the files, and solve again",
        )
    # A tenth of the way that the hand moves is no error of a hand.
    if middle > 10.0 * suspicious * size:
        raise SamplesError(
            f"pictures that differ from where the hand has them by {mm(middle):.3g} mm, whatever X",
            "poses and pictures that belong together",
            hint=_CAUSES,
        )


def _readings(rows: DepthRows) -> Iterator[tuple[str, DepthRows]]:
    """The same, read in another way: what would have to be so."""
    carrier, count = rows.carrier, len(rows)
    hand = as_eye_in_hand(carrier, rows.setup)
    other = EYE_TO_HAND if rows.setup == EYE_IN_HAND else EYE_IN_HAND

    def of_hand(R: FloatArray, p: FloatArray) -> DepthRows:
        return rows.carried_by(as_eye_in_hand((R, p), rows.setup))

    inverted = rows.carried_by(inverse_poses(carrier))
    yield f"if the poses of the hand are inverted, or if setup is {other}", inverted
    turned = np.roll(quaternion_from_rotation(hand[0]), -1, axis=1)
    w_first = "if the hand's quaternions are w x y z"
    yield w_first, of_hand(rotation_from_quaternion(turned), hand[1])
    transposed = "if the hand's rotations are transposed, its positions not"
    yield transposed, of_hand(np.swapaxes(hand[0], 1, 2), hand[1])
    every = np.arange(count)
    orders = {"if the pictures are in the opposite order": every[::-1]}
    # Up to three rows late: so much pictures are where a program takes them so.
    for late in range(1, 4):
        what = "a row" if late == 1 else f"{late} rows"
        orders[f"if the pictures are {what} late"] = np.roll(every, late)
        orders[f"if the pictures are {what} early"] = np.roll(every, -late)
    for words, order in orders.items():
        yield words, of_hand(hand[0][order], hand[1][order])
    mirrored = [read for term in rows.terms for read in term.misread]
    terms = tuple(term for _, term in mirrored if isinstance(term, DepthTerm))
    if len(terms) == len(rows.terms):
        yield f"if {mirrored[0][0]}", replace(rows, terms=terms)


def _refuse_open(fit: DepthFit) -> None:
    """Refuse pictures that leave X open, and say where it may move."""
    parts = list[str]()
    for first, most in ((3, _OPEN[0]), (0, _OPEN[1])):
        size, axes = np.linalg.eigh(fit.covariance[first : first + 3, first : first + 3])
        open_axes = list(axes.T[~(size <= most**2)])
        if first and not open_axes:
            # A hand that hardly turns tells by its noise alone.
            rotation = fit.rows.carrier[0][fit.inliers]
            open_axes = [*axes_that_stand(rotation, fit.levels.turned)]
        words = "slide along {} of what carries it" if first else "turn about {} of the camera"
        parts += [words.format(_vector(axis)) for axis in open_axes]
    if parts:
        raise SamplesError(
            f"pictures that do not determine X: the camera may {enumerated(parts)}",
            "pictures with the hand turned about different axes",
            hint=_ADVICE,
        )


def _vector(axis: FloatArray) -> str:
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    return "(" + ", ".join(f"{v + 0.0:.2f}" for v in np.round(axis, 2)) + ")"


def _exchanged(fit: DepthFit, names: NDArray[np.str_]) -> list[str]:
    """Wrong pictures that fit if two of them are exchanged, one sentence each."""
    R, p = fit.rows.carrier
    # Of more nobody exchanged two: something else is wrong.
    left, found = np.flatnonzero(~fit.inliers)[:12].tolist(), list[str]()
    for first, second in combinations(left, 2):
        order = np.arange(len(p))
        order[[first, second]] = second, first
        rows = fit.rows.carried_by((R[order], p[order]))
        apart = np.zeros_like(fit.inliers)
        again = replace(fit, rows=rows, sums=rows.sums(fit.state), inliers=apart).misfit()
        if np.all(again[[first, second]] <= 1.0):
            found.append(
                f"Pictures {names[first]}, {names[second]} fit the others if the two are "
                "exchanged. Check which picture was taken at which pose."
            )
    return found


# ── the answer ───────────────────────────────────────────────────────────────────────────────────
def _answer(
    fit: DepthFit,
    names: NDArray[np.str_],
    numbers: IntArray,
    notes: tuple[str, ...],
    wrong: tuple[str, ...],
) -> DepthCameraCalibration:
    state, order = fit.state, [3, 4, 5, 0, 1, 2]
    eye = state.eye
    points, things, which = list[FloatArray](), list[SeenThing](), list[IntArray]()
    variance = np.diag(fit.covariance)
    places = fit.rows.places(eye)
    for marks, own, at in zip(state.marks, _own_std(state, variance), places, strict=True):
        first = len(things)
        things += _things(marks, own)
        points.append(at)
        which.append(first + marks.which * (len(things) - first > 1))
    return DepthCameraCalibration(
        setup=fit.rows.setup,
        X=homogeneous(eye.rotation, eye.position),
        covariance=fit.covariance[np.ix_(order, order)],
        things=tuple(things),
        images=names,
        residuals=fit.sums.off,
        inliers=fit.inliers,
        suspects=np.zeros_like(fit.inliers),
        numbers=numbers,
        hand_noise=fit.levels.displaced,
        hand_turn_noise=fit.levels.turned,
        camera_noise=fit.levels.camera,
        scale=eye.scale,
        scale_std=float(np.sqrt(variance[SCALE])),
        scale_by_data=fit.scale_by_data,
        points=np.concatenate(points),
        thing_of=np.concatenate(which),
        notes=notes,
        wrong=wrong,
        scatter=KnownScatter(float(fit.freedom), student=True),
        by_prior={_ASSUMED[k]: part[np.ix_(order, order)] for k, part in enumerate(fit.by_prior)},
    )


def _own_std(state: State, variance: FloatArray) -> list[FloatArray]:
    """Standard deviations of the unknowns of what was seen, of each term."""
    ends = np.cumsum([SHARED, *(marks.unknowns for marks in state.marks)])
    return np.split(np.sqrt(variance), ends[:-1])[1:]


def _things(marks: Any, std: FloatArray) -> list[SeenThing]:
    """What a term saw, with what is known of it."""
    if isinstance(marks, BoardMarks):
        pose = homogeneous(marks.rotation, marks.position)
        of_pose = np.concatenate([std[3:6], std[:3]])
        return [SeenThing(kind="board", name="", place=marks.position, std=of_pose, pose=pose)]
    names, parts = marks.term.seen[0], std.reshape(-1, 3)
    if isinstance(marks, PointMarks):
        each = zip(names, marks.places, parts, strict=True)
        return [SeenThing(kind="point", name=n, place=at, std=own) for n, at, own in each]
    assert isinstance(marks, PlaneMarks)
    planes = list[SeenThing]()
    for name, normal, distance, own in zip(names, marks.normal, marks.distance, parts, strict=True):
        # Its normal points up, as that of a plane that is estimated by a job.
        up = -1.0 if normal[2] < 0 else 1.0
        planes.append(
            SeenThing(
                kind="plane",
                name=name,
                place=distance * normal,
                std=np.abs(normal) * own[2],
                normal=up * normal,
                tilt_std=float(own[:2].max()),
                distance_std=float(own[2]),
            )
        )
    return planes
