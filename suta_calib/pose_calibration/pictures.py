"""Hand-eye calibration from pictures of a board: reprojection, with the camera's own errors.

The closed problem of `hand_eye` on the board's pose by every picture tells which pictures agree and
where to start; what is minimised then are reprojection errors, of all cameras at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.assessment import Assessment, Level
from suta_calib.distributions import chi2
from suta_calib.errors import InputError, SamplesError
from suta_calib.geometry.numbers import (
    homogeneous,
    rms_length,
    rpy_from_rotation,
    tangent_of_vector,
    vector_from_rotation,
)
from suta_calib.geometry.pinhole import INTRINSICS
from suta_calib.measurements import Board, Camera, Corners, Samples
from suta_calib.measurements.pose_files import HandPoses
from suta_calib.model.parameters import PLACEMENT
from suta_calib.pose_calibration.consensus import FALSE_ALARM
from suta_calib.pose_calibration.hand_eye import (
    ENOUGH,
    FEW_PAIRS,
    UNSURE,
    UNSURE_TURN,
    Model,
    Setup,
    calibrate_hand_eye,
)
from suta_calib.pose_calibration.inputs import error_context
from suta_calib.pose_calibration.picture_noise import (
    FINEST,
    WAYS,
    PictureNoise,
    Weighed,
    weigh_pictures,
)
from suta_calib.pose_calibration.robust_fit import MANY_OUTLIERS, exchanged
from suta_calib.solver.losses import huber_threshold
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import CameraView, MeasuredPoses, Noise
from suta_calib.terms.camera_view import CALIBRATED, UNCALIBRATED, closed_form_camera, with_corners
from suta_calib.terms.hand_eye_start import (
    Poses,
    inverse_poses,
    loop_closures,
    quaternion_hand_eye,
)
from suta_calib.terms.outside import pose_named
from suta_calib.units import deg, mm
from suta_calib.words import listed

Intrinsics = Literal["fixed", "free"]
ROUNDS: Final = 8
# Relative change of the scatter that is none.
SETTLED: Final = 0.02
# Numbers that the error of a picture is worth where it is judged by the others: its worst turns
# decide, so that it scatters more than the mean of all ways would.
WORST: Final = 2
# Norm of two unit normal components that half of them exceed.
_MIDDLE: Final = float(np.sqrt(chi2.median(2)))
# Times what the camera alone leaves from where on it is the robot that leaves the rest.
ROBOTS: Final = 2.0
# Relative departure of a focal length that no calibration of the same pictures has.
OTHER_PICTURES: Final = 0.1
# Ratio of two sizes that no measuring error explains.
OTHER_SIZE: Final = 1.3
# Pictures that a sentence names.
QUOTED: Final = 5


@dataclass(frozen=True, eq=False)
class View:
    """What one camera saw.

    Attributes:
        label: of the camera.
        corners: in its pictures.
        board: that it saw.
        camera: as it was calibrated; None where nobody did.
        target: label of the board.
    """

    label: str
    corners: Corners
    board: Board
    camera: Camera | None = None
    target: str = "default"


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenCamera:
    """One camera of the answer.

    Attributes:
        label: its name.
        X: (4, 4), ``T_hand_eye``, or ``T_base_eye`` for eye-to-hand; m.
        Z: (4, 4), ``T_base_board``, or ``T_hand_board`` for eye-to-hand; m.
        covariance: (12, 12) of X and Z: displacement (m, outer frame's axes) and small turn (rad,
            axes of the eye and of the board) of each.
        camera: intrinsics as they were found, with their covariance; without it where they were
            held.
        given: as they were given, or None.
        told: as the pictures alone tell them, with covariance; None where they were held.
        images: (n,) names of its pictures.
        rows: (n,) their rows in the file of poses.
        inliers: (n,) which were fitted.
        picture_rms: (n,) root mean square reprojection error of each, px.
        alone: the same of all fitted ones, px, if every picture may have a pose of its own: what
            the camera and the finding of corners leave.
        slides, turns: (n, 3) of ``A_i X B_i`` against Z, with the board's pose B by every picture
            alone, m and rad.
        corners: (m, 7) of every corner: picture, point, u, v, and error in u, in v (px), and
            whether its picture was fitted.
        behind: whether the board is seen from behind, which its numbering alone decides.
        turned: pictures that fit with the board turned by half a turn.
    """

    label: str
    X: FloatArray
    Z: FloatArray
    covariance: FloatArray
    camera: Camera
    given: Camera | None
    told: Camera | None
    images: tuple[str, ...]
    rows: IntArray
    inliers: BoolArray
    picture_rms: FloatArray
    alone: float
    slides: FloatArray
    turns: FloatArray
    corners: FloatArray
    behind: bool
    turned: tuple[str, ...]

    @property
    def std(self) -> dict[str, FloatArray]:
        """Standard deviations (6,) of X and of Z: displacement, m, and turn, rad."""
        std = np.sqrt(np.diag(self.covariance))
        return {"X": std[:6], "Z": std[6:]}

    @property
    def rms(self) -> float:
        """Root mean square reprojection error of the corners of fitted pictures, px."""
        return rms_length(self.corners[self.corners[:, 6] > 0, 4:6])

    @property
    def strange(self) -> list[str]:
        """Names of the pictures that were not fitted."""
        return [name for name, good in zip(self.images, self.inliers, strict=True) if not good]


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureCalibration:
    """Where the cameras are, and the board, from pictures.

    Attributes:
        setup: ``eye-in-hand`` or ``eye-to-hand``.
        model: ``AX=XB`` or ``AX=ZB``: whether Z is asked for.
        cameras: one or more.
        solution: of the solver, over the fitted pictures as it weighs them: where `noise` began.
        noise: what scatters; the pictures are weighed by it.
        notes: what the files give to think about, one sentence each.
    """

    setup: Setup
    model: Model
    cameras: tuple[SeenCamera, ...]
    solution: Solution
    noise: PictureNoise
    notes: tuple[str, ...] = ()

    @property
    def unknowns(self) -> tuple[Literal["X", "Z"], ...]:
        """Which of X and Z the model asks for."""
        return ("X", "Z") if self.model == "AX=ZB" else ("X",)

    @property
    def rms(self) -> float:
        """Root mean square reprojection error of all fitted corners, px."""
        every = np.concatenate([seen.corners for seen in self.cameras])
        return rms_length(every[every[:, 6] > 0, 4:6])

    @property
    def outliers(self) -> tuple[int, ...]:
        """Rows of the file of poses whose picture was judged an outlier, from 0."""
        rows = [seen.rows[~seen.inliers] for seen in self.cameras]
        return tuple(sorted({int(row) for row in np.concatenate(rows)}))

    @cached_property
    def assessment(self) -> Assessment:
        """How far to trust every X."""
        bad, care, known = list[str](), list[str](), list[str]()
        if not self.solution.converged:
            bad.append(f"The solver did not converge: {self.solution.sentence}.")
        for seen in self.cameras:
            which = f"Camera {seen.label}: " if len(self.cameras) > 1 else ""
            more_bad, more_care = _judged(seen, self.setup)
            bad += [which + sentence for sentence in more_bad]
            care += [which + sentence for sentence in more_care]
            said, level = _against_the_file(seen)
            if said:
                (care if level == "care" else known).append(which + said)
        return Assessment.of(bad=bad, care=[*care, *self.notes], known=known)


def _against_the_file(seen: SeenCamera) -> tuple[str, Level]:
    """What the pictures say against the camera's file, and whether it calls for care.

    Pictures that put the principal point elsewhere by more than chance are told; care is asked for
    where what is known of the file's own errors does not explain it either.
    """
    told, given = seen.told, seen.given
    if told is None or told.covariance is None or given is None:
        return "", "good"
    change = told.intrinsics - given.intrinsics
    stated = np.zeros((len(INTRINSICS),) * 2) if given.covariance is None else given.covariance
    prior = given.stds if given.stds is not None else CALIBRATED.stds(given)
    expected = stated if given.covariance is not None else np.diag(prior**2)
    for pair in (slice(0, 2), slice(2, 4)):
        if _significant(change[pair], (told.covariance + expected)[pair, pair]):
            return _contradiction(seen, given), "care"
    if not _significant(change[2:4], (told.covariance + stated)[2:4, 2:4]):
        return "", "good"
    (u, v), (by_u, by_v) = told.intrinsics[2:4], np.sqrt(np.diag(told.covariance)[2:4])
    return (
        f"The pictures put the principal point at ({u:.2f} ± {by_u:.2f}, {v:.2f} ± {by_v:.2f}) px, "
        f"the camera's file at ({given.intrinsics[2]:.2f}, {given.intrinsics[3]:.2f}) px: X "
        "follows the pictures. Pixels are counted from 0 at the centre of the first one.",
        "good",
    )


def _significant(change: FloatArray, covariance: FloatArray) -> bool:
    """Whether chance does not explain a change."""
    squared = float(change @ np.linalg.solve(covariance, change))
    return squared > float(chi2.isf(FALSE_ALARM, len(change)))


def _contradiction(seen: SeenCamera, given: Camera) -> str:
    changes, other = [], False
    for key in ("fx", "fy", "cx", "cy"):
        before, after = given.values[key], seen.camera.values[key]
        changes.append(f"{key} {before:.1f} → {after:.1f}")
        other |= key[0] == "f" and abs(after / before - 1.0) > OTHER_PICTURES
    what = "is the file of pictures of another size?" if other else "X follows the pictures."
    return f"The pictures contradict the camera's file ({', '.join(changes)} px): {what}"


def _judged(seen: SeenCamera, setup: Setup) -> tuple[list[str], list[str]]:
    """Why a camera's X must not be used, and what must be known to use it."""
    bad, care = list[str](), list[str]()
    fitted, count = int(seen.inliers.sum()), len(seen.inliers)
    if count - fitted > MANY_OUTLIERS * count:
        bad.append(f"{count - fitted} of {count} pictures do not agree with the rest.")
    if fitted < ENOUGH:
        care.append(
            f"Only {fitted} pictures: the standard deviations are guesses themselves, and a wrong "
            "picture may not show; take a dozen or more."
        )
    displaced, turned = np.linalg.norm(seen.std["X"].reshape(2, 3), axis=1).tolist()
    if displaced > UNSURE or turned > UNSURE_TURN:
        care.append(
            f"X is known to ± {mm(displaced):.1f} mm and ± {deg(turned):.2f}° only (one sigma): "
            "add pictures, turned by 30° or more about different axes, near and far."
        )
    if seen.turned:
        care.append(
            f"In {listed(list(seen.turned), QUOTED)} the board is turned by half a turn: its "
            "corners are numbered from the other end. They are left out."
        )
    if seen.behind:
        care.append(
            "The board is seen from behind: its corners are numbered mirrored (columns and rows "
            "exchanged, or y upwards). X does not depend on it; Z does."
        )
    level = _exchanged(seen, setup)
    if level != "good":
        lengths = [mm(float(np.linalg.norm(T[:3, 3]))) for T in (seen.X, seen.Z)]
        place, turn = mm(seen.Z[:3, 3]), deg(rpy_from_rotation(seen.Z[:3, :3]))
        (bad if level == "bad" else care).append(
            f"X is {lengths[0]:.0f} mm long and Z {lengths[1]:.0f} mm: what is on the hand lies "
            "farther off than what stands. Are the poses of the hand inverted, or is the camera "
            f"{'beside the robot' if setup == 'eye-in-hand' else 'on the hand'}? Then X would be "
            f"({', '.join(f'{v:.1f}' for v in place)}) mm, roll pitch yaw "
            f"({', '.join(f'{v:.2f}' for v in turn)})° of the board."
        )
    return bad, care


def _exchanged(seen: SeenCamera, setup: Setup) -> Level:
    places = [seen.X[:3, 3], seen.Z[:3, 3]]
    held, standing = places if setup == "eye-in-hand" else places[::-1]
    std = np.concatenate([seen.std["X"][:3], seen.std["Z"][:3]])
    return exchanged(held, standing, float(np.linalg.norm(std)))


def hand_eye_from_pictures(
    hand: HandPoses,
    views: Sequence[View],
    *,
    setup: Setup = "eye-in-hand",
    model: Model = "AX=XB",
    intrinsics: Intrinsics = "free",
    robust: bool = True,
    seed: int = 0,
) -> PictureCalibration:
    """X of every camera, and Z, by reprojection over measured poses of the hand.

    Args:
        hand: ``T_base_hand`` with the name of the picture taken there.
        views: of one camera or several; pictures belong to the poses by name.
        setup: where the cameras are; the board is on the other.
        model: which of X and Z are asked for.
        intrinsics: whether they are estimated too, from the camera's file as prior.
        robust: False for least squares over all pictures.
        seed: of the minimal samples.

    Raises:
        SamplesError: names that do not match, too few pictures, pictures that agree with no X, or
            motions that do not determine it.
    """
    terms = [_term(hand, view, setup, intrinsics) for view in views]
    believed = []
    for view, term in zip(views, terms, strict=True):
        with error_context(view.corners.path):
            term.check_enough()
            believed.append(_agreeing(term, view, robust, seed))
    solution, believed = _settled(terms, believed, robust)
    weighed = weigh_pictures(solution, *_hands(solution))
    cameras = tuple(
        _seen(view, term, good, weighed, hand, setup)
        for view, term, good in zip(views, terms, believed, strict=True)
    )
    return PictureCalibration(
        setup=setup,
        model=model,
        cameras=cameras,
        solution=solution,
        noise=weighed.noise,
        notes=hand.unit_notes,
    )


def _hands(solution: Solution) -> tuple[IntArray, list[FloatArray]]:
    """Pose of the hand of every fitted picture, from 0, and where poses are near each other.

    These are of the hand, and where one camera saw the board, of the board in it.
    """
    terms = [term for term in solution.problem.terms if isinstance(term, CameraView)]
    rows = [int(row) for term in terms for row in term.poses.samples.origin]
    _, first, hands = np.unique(rows, return_index=True, return_inverse=True)
    every = [term.poses.at({}) for term in terms]
    R, p = (np.concatenate(parts)[first] for parts in zip(*every, strict=True))
    spaces = [_embedded(R, p)]
    if len(terms) == 1:
        spaces.append(_embedded(*terms[0].seen_poses))
    return hands.reshape(-1), [space for space in spaces if np.isfinite(space).all()]


def _embedded(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """Poses (n, 12) whose distances are those of places, in units of the extent, and turns, rad."""
    extent = max(rms_length(position - position.mean(axis=0)), 1e-9)
    return np.hstack([position / extent, rotation.reshape(-1, 9) / np.sqrt(2.0)])


def _term(hand: HandPoses, view: View, setup: Setup, intrinsics: Intrinsics) -> CameraView:
    view.corners.check(view.board, view.camera)
    n = len(hand.image)
    samples = Samples.from_arrays(
        [], np.zeros((n, 0)), labels={"image": hand.image}, origin=[str(row) for row in range(n)]
    )
    poses = with_corners(MeasuredPoses(*hand.pose, samples), view.corners, view.board)
    camera, prior, free = view.camera, None, intrinsics == "free"
    if camera is None:
        if not free:
            raise SamplesError(
                "no camera", "a camera's file for fixed intrinsics", where="--intrinsics"
            )
        camera = closed_form_camera(view.corners, view.board)
        prior = UNCALIBRATED.stds(camera)
    term = CameraView(
        poses,
        view.board,
        camera,
        setup,
        free,
        label=view.label,
        target=view.target,
        prior=prior,
    )
    return term.at_its_distance()


def _agreeing(term: CameraView, view: View, robust: bool, seed: int) -> BoolArray:
    """(n,) pictures whose boards agree with one X; refuses what no X explains, by its cause."""
    told = np.isfinite(term.seen_poses[1][:, 0])
    hand, seen = _told(term, told)
    try:
        found = calibrate_hand_eye(hand, seen, setup=term.setup, robust=robust, seed=seed)
    except SamplesError as problem:
        found_instead, hint = _cause(term, view, seed)
        if not hint:
            raise
        raise SamplesError(found_instead, "pictures and poses that agree", hint=hint) from problem
    believed = np.zeros(len(told), dtype=np.bool_)
    believed[told] = found.inliers
    return believed if robust else np.ones_like(believed)


def _told(term: CameraView, told: BoolArray) -> tuple[Poses, Poses]:
    """Poses of the hand, and of the board in the eye, of some pictures."""
    hand, seen = term.poses.at({}), term.seen_poses
    return (hand[0][told], hand[1][told]), (seen[0][told], seen[1][told])


def _cause(term: CameraView, view: View, seed: int) -> tuple[str, str]:
    """What is wrong with pictures that agree with no X, and what to do; nothing if unknown."""
    told = np.isfinite(term.seen_poses[1][:, 0])
    hand, seen = _told(term, told)
    scale = _scale(inverse_poses(hand) if term.setup == "eye-to-hand" else hand, seen)
    if scale > 0 and abs(np.log(scale)) > np.log(OTHER_SIZE):
        larger = (hand, (seen[0], seen[1] * scale))
        if _agrees(*larger, term.setup, seed):
            return (
                f"a hand that moves {scale:.{0 if scale > 5 else 2}f} times as far as the pictures "
                "show by the size of the board",
                "columns a_x, a_y, a_z are in m (a_x_mm: mm), and lengths in board.yaml in mm",
            )
    width = 2.0 * term.camera.intrinsics[2]
    mirrored = term.pixels * [-1.0, 1.0] + [width, 0.0]
    samples = replace(term.poses.samples, pixels=mirrored)
    if _agrees(*_told(term.over_poses(term.poses.with_samples(samples)), told), term.setup, seed):
        return (
            "pictures that agree with the poses if left and right are exchanged in them",
            "take them without mirroring",
        )
    if view.camera is None:
        return "", ""
    try:
        own = closed_form_camera(view.corners, view.board)
    except InputError:
        return "", ""
    if _agrees(*_told(replace(term, camera=own), told), term.setup, seed):
        before, after = view.camera.values["fx"], own.values["fx"]
        return (
            f"pictures of a focal length of some {after:.0f} px, where the camera's file says "
            f"{before:.0f} px",
            "the file must be of this camera, focus and size of picture",
        )
    return "", ""


def _scale(hand: Poses, seen: Poses) -> float:
    """How much farther the hand moves than the eye sees, with X found beside it.

    ``(R_A - I) t_X + t_A = s R_X t_B`` for motions between any two pictures, by least squares.
    """
    turn, _ = quaternion_hand_eye(hand, seen)
    (R, p), (Rb, pb) = hand, seen
    # Motions of the hand A = A_j⁻¹ A_i and of the board in the eye B = B_j B_i⁻¹.
    i, j = np.triu_indices(len(p), k=1)
    A = np.swapaxes(R[j], 1, 2) @ R[i]
    a = np.einsum("nji,nj->ni", R[j], p[i] - p[j])
    b = pb[j] - np.einsum("nij,nj->ni", Rb[j] @ np.swapaxes(Rb[i], 1, 2), pb[i])
    rows = np.concatenate([A - np.eye(3), -(b @ turn.T)[:, :, None]], axis=2).reshape(-1, 4)
    return float(np.linalg.lstsq(rows, -a.ravel(), rcond=None)[0][3])


def _agrees(hand: Poses, seen: Poses, setup: Setup, seed: int) -> bool:
    """Whether poses determine an X that most of them agree with."""
    if not (np.isfinite(hand[1]).all() and np.isfinite(seen[1]).all()):
        return False
    try:
        found = calibrate_hand_eye(hand, seen, setup=setup, seed=seed)
    except SamplesError:
        return False
    return bool(found.inliers.mean() > 1.0 - MANY_OUTLIERS)


def _settled(
    terms: Sequence[CameraView], believed: list[BoolArray], robust: bool
) -> tuple[Solution, list[BoolArray]]:
    """Solve, judge the pictures by the others, solve again until nothing changes."""
    values: dict[str, float] = {}
    for term, good in zip(terms, believed, strict=True):
        values = term.take(good).start_values({}) | values
    scatter = [_scatter(term, values, good) for term, good in zip(terms, believed, strict=True)]
    for _ in range(ROUNDS):
        fitted = [
            term.take(good).with_noise(
                Noise(level, huber_threshold(2) * level) if robust else Noise(level)
            )
            for term, good, level in zip(terms, believed, scatter, strict=True)
        ]
        solution = solve(Problem(fitted))
        values = solution.values
        levels = [_scatter(t, values, good) for t, good in zip(terms, believed, strict=True)]
        agreeing = [
            _like_the_others(_by_picture(term, values), good) if robust else good
            for term, good in zip(terms, believed, strict=True)
        ]
        same = all(map(np.array_equal, agreeing, believed))
        if (same and np.allclose(levels, scatter, SETTLED, 0)) or not solution.converged:
            break
        believed, scatter = agreeing, levels
    return solution, believed


def _residuals(term: CameraView, values: dict[str, float]) -> tuple[FloatArray, IntArray]:
    """Reprojection errors (m, 2) of all corners, px, and the picture of each."""
    problem = Problem([term])
    x = np.array([values[name] for name in problem.names])
    (line,) = problem.linearise(x, problem.assumed_sigmas())
    return line.residual / term.pixel, term.blocks[0].samples[:, 0]


def _scatter(term: CameraView, values: dict[str, float], good: BoolArray) -> float:
    """Of one component, px, by the middle one of the errors in the fitted pictures."""
    residual, picture = _residuals(term, values)
    middle = float(np.median(np.linalg.norm(residual[good[picture]], axis=1)))
    return max(middle / _MIDDLE, FINEST)


def _by_picture(term: CameraView, values: dict[str, float]) -> FloatArray:
    """(n,) root mean square error of the corners of each, px."""
    residual, picture = _residuals(term, values)
    squared = np.sum(residual**2, axis=1)
    count = np.bincount(picture, minlength=len(term.poses))
    return np.asarray(np.sqrt(np.bincount(picture, squared, len(term.poses)) / count))


def _like_the_others(rms: FloatArray, good: BoolArray) -> BoolArray:
    """Pictures whose errors chance explains, by the middle one of those that were believed."""
    if len(rms) < FEW_PAIRS:
        return good
    expected = float(np.median(rms[good])) ** 2 / float(chi2.median(WORST))
    limit = float(chi2.isf(FALSE_ALARM / len(rms), WORST))
    agreeing = rms**2 <= max(expected * limit, FINEST**2)
    return agreeing if agreeing.sum() >= FEW_PAIRS else good


def _seen(
    view: View,
    term: CameraView,
    good: BoolArray,
    weighed: Weighed,
    hand: HandPoses,
    setup: Setup,
) -> SeenCamera:
    """A camera of the answer."""
    values, parameters = weighed.values, list(weighed.values)
    eye, board, owner = term.owners
    names = [f"{frame}.{key}" for frame in (eye, board) for key in PLACEMENT]
    at = [parameters.index(name) for name in names]
    covariance = weighed.covariance
    jacobian = np.eye(12)
    for k, frame in enumerate((eye, board)):
        turn = np.array([values[f"{frame}.{key}"] for key in PLACEMENT[3:]])
        turned = slice(6 * k + 3, 6 * k + 6)
        jacobian[turned, turned] = tangent_of_vector(turn)
    found, told_alone = term.camera, None
    if term.free:
        of = [parameters.index(f"{owner}.{key}") for key in INTRINSICS]
        found = replace(
            found, intrinsics=weighed.x[of].copy(), covariance=covariance[np.ix_(of, of)]
        )
        told_alone = replace(
            found,
            intrinsics=weighed.told[of].copy(),
            covariance=weighed.told_covariance[np.ix_(of, of)],
        )
    X, Z = pose_named(values, eye), pose_named(values, board)
    refined = replace(term, camera=found)
    A = hand.pose if setup == "eye-in-hand" else inverse_poses(hand.pose)
    rows = np.array([int(origin) for origin in term.poses.samples.origin], dtype=np.intp)
    R, p = loop_closures((A[0][rows], A[1][rows]), X, refined.seen_poses)
    told = np.isfinite(p[:, 0])
    turns = np.full(p.shape, np.nan)
    turns[told] = vector_from_rotation(Z[0].T @ R[told])
    residual, picture = _residuals(term, values)
    points = np.array(list(view.board.points))
    sample, point = np.nonzero(np.isfinite(term.pixels).all(axis=2))
    corners = np.column_stack(
        [picture, points[point], term.pixels[sample, point], residual, good[picture]]
    )
    rms = _by_picture(term, values)
    images = tuple(term.poses.samples.labels["image"].tolist())
    rotation, position = refined.seen_poses
    facing = np.einsum("ni,ni->n", rotation[:, :, 2], position)[good & told]
    flat = np.ptp(term.points[:, 2]) == 0
    return SeenCamera(
        label=view.label,
        X=homogeneous(*X),
        Z=homogeneous(*Z),
        covariance=jacobian @ covariance[np.ix_(at, at)] @ jacobian.T,
        camera=found,
        given=view.camera,
        told=told_alone,
        images=images,
        rows=rows,
        inliers=good,
        picture_rms=rms,
        alone=_alone(term, values, good),
        slides=p - Z[1],
        turns=turns,
        corners=corners,
        behind=bool(flat and len(facing) and np.median(facing) < 0),
        turned=_half_turned(term, values, good, images),
    )


def _alone(term: CameraView, values: dict[str, float], good: BoolArray) -> float:
    """What is left, px, where every picture may have a pose of its own, to first order."""
    problem = Problem([term])
    x = np.array([values[name] for name in problem.names])
    (line,) = problem.linearise(x, problem.assumed_sigmas())
    picture, left, freedom = term.blocks[0].samples[:, 0], 0.0, 0
    for k in np.flatnonzero(good):
        mine = picture == k
        residual, by_pose = line.residual[mine].ravel(), line.by_pose[mine]
        matrix = by_pose.reshape(len(residual), -1)
        rest = residual - matrix @ np.linalg.lstsq(matrix, residual, rcond=None)[0]
        left += float(rest @ rest)
        freedom += max(len(residual) - WAYS, 0)
    return float(np.sqrt(2.0 * left / freedom)) / term.pixel if freedom else float("nan")


def _half_turned(
    term: CameraView, values: dict[str, float], good: BoolArray, images: Sequence[str]
) -> tuple[str, ...]:
    """Pictures that were left out, and fit as well as the others with the board turned about."""
    if good.all() or np.ptp(term.points[:, 2]) > 0:
        return ()
    # A grid that is turned by half a turn numbers its points from the other end.
    turned = term.points[::-1]
    if not np.allclose(turned + term.points, term.points[0] + term.points[-1]):
        return ()
    samples = replace(term.poses.samples, pixels=np.ascontiguousarray(term.pixels[:, ::-1]))
    other = _by_picture(term.over_poses(term.poses.with_samples(samples)), values)
    straight = _by_picture(term, values)
    fits: BoolArray = _like_the_others(np.where(good, straight, other), good) & ~good
    return tuple(name for name, about in zip(images, fits, strict=True) if about)
