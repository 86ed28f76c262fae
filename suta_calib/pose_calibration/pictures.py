"""Hand-eye calibration from pictures of a board: reprojection, with the camera's own errors.

The closed problem of `hand_eye` on the board's pose by every picture tells which pictures agree and
where to start; what is minimised then are reprojection errors, of all cameras at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy.special import chdtri, expit

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.lens import CENTRE, FOCAL, Lens
from suta_calib.geometry.numbers import (
    homogeneous,
    rms_length,
    rotation_from_vector,
    tangent_of_poses,
    vector_from_rotation,
)
from suta_calib.measurements import Board, Camera, Corners, Samples
from suta_calib.measurements.pose_files import HandPoses
from suta_calib.model.parameters import PLACEMENT
from suta_calib.pose_calibration.consensus import FALSE_ALARM
from suta_calib.pose_calibration.correlation import DIRECTIONS, NOWHERE, embedded, shared_errors
from suta_calib.pose_calibration.exchanged_files import refuse_exchanged_files
from suta_calib.pose_calibration.eye_poses import Model, PoseBetween, relative_pose
from suta_calib.pose_calibration.hand_eye import calibrate_hand_eye
from suta_calib.pose_calibration.inputs import error_context
from suta_calib.pose_calibration.loop_fit import ADVICE, refuse_exchanged_labels
from suta_calib.pose_calibration.loop_start import FEW_PAIRS
from suta_calib.pose_calibration.measured_markers import against_stated_sizes, measured_markers
from suta_calib.pose_calibration.picture_answer import (
    CameraEstimate,
    HeldIntrinsics,
    PictureCalibration,
    chance_of_held,
)
from suta_calib.pose_calibration.picture_causes import (
    cause_of_disagreement,
    loose,
    moved_between_pictures,
    usable_poses,
)
from suta_calib.pose_calibration.picture_noise import (
    Hands,
    Weighed,
    sizes_of_boards,
    weigh_pictures,
)
from suta_calib.pose_calibration.picture_rows import (
    FINEST,
    LensPictures,
    PictureErrors,
    picture_errors,
)
from suta_calib.pose_calibration.sight import Sight
from suta_calib.pose_calibration.undetermined import (
    NotFound,
    Role,
    UndeterminedError,
    refuse_undetermined,
)
from suta_calib.solver.losses import huber_threshold
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.solver.weights import Learned
from suta_calib.terms import CameraView, MeasuredPoses, Noise
from suta_calib.terms.camera_alone import CameraState, PicturesSeen, refined
from suta_calib.terms.external_frame import pose_named
from suta_calib.terms.hand_eye_start import (
    EYE_IN_HAND,
    FEWEST,
    EyeSetup,
    Poses,
    after,
    as_eye_in_hand,
    inverse_poses,
    loop_closures,
    some_poses,
)
from suta_calib.terms.intrinsics import CALIBRATED, HELD, ideal
from suta_calib.terms.misread_pictures import other_size
from suta_calib.terms.surveyed_markers import SurveyedMarkers
from suta_calib.trust.hypotheses.moved_at_a_row import Moved

Intrinsics = Literal["fixed", "free"]
# How well an ideal camera is known, in the ± of one that somebody calibrated: 0.06 px of a picture
# that is 2000 px wide. A renderer has it exactly. Of four rendered cameras X was 0.20 to 0.79 mm
# off with it, and 0.40 to 0.83 mm without.
EXACT: Final = 0.03


@dataclass(frozen=True, eq=False)
class View(Displayable):
    """What one camera saw.

    Attributes:
        label: of the camera.
        corners: in its pictures.
        board: that it saw.
        camera: as it was calibrated; None where nobody did.
        target: label of the board.
        lens: model of the camera's lens, where no file says it; chosen by the pictures by default.
    """

    label: str
    corners: Corners
    board: Board
    camera: Camera | None = None
    target: str = "default"
    lens: Lens | None = None


def hand_eye_from_pictures(
    hand: HandPoses,
    views: Sequence[View],
    *,
    setup: EyeSetup = EYE_IN_HAND,
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
            motions that determine none; of several cameras those with an X keep it.
    """
    terms = [_term(hand, v, setup, intrinsics, several=len(views) > 1) for v in views]
    views, terms, left_out = _enough(views, terms)
    terms = [term.beside(terms).at_its_distance() for term in terms]
    if len(terms) > 1:
        filed = [k for k, view in enumerate(views) if view.camera is not None]
        refuse_exchanged_files([views[k].label for k in filed], [terms[k].pictures for k in filed])
        with error_context(hand.path):
            _refuse_exchanged(terms, views, hand.image.tolist(), seed if robust else None)
    agreeing, refusals = list[_Agreeing | UndeterminedError](), list[SamplesError]()
    for view, term in zip(views, terms, strict=True):
        try:
            with error_context(view.corners.path):
                term.check_enough()
                agreeing.append(_agreeing(term, view, robust, seed, alone=len(terms) == 1))
        except SamplesError as refused:
            if not isinstance(refused.__cause__, UndeterminedError):
                raise
            agreeing.append(refused.__cause__)
            refusals.append(refused)
    if len(refusals) == len(terms):
        raise refusals[0]
    not_found, more_left_out = _not_found(views, agreeing)
    determined = [k for k, good in enumerate(agreeing) if not isinstance(good, UndeterminedError)]
    views, terms = [views[k] for k in determined], [terms[k] for k in determined]
    found = [one for one in agreeing if not isinstance(one, UndeterminedError)]
    solution, believed = _settled(terms, [one.pictures for one in found], robust)
    for term in terms:
        refuse_undetermined(solution, term.owners[0], "X", ADVICE)
    hands = _hands(
        solution, [_of_lens(*each, solution) for each in zip(terms, believed, strict=True)]
    )
    weighed = weigh_pictures(solution.problem, solution.x, solution.free, hands)
    chances = [
        _chance_of_exact(term, view, weighed) for term, view in zip(terms, views, strict=True)
    ]
    exact = [chance > 0.5 for chance in chances]
    if any(exact):
        owners = [term.owners[2] for term, sure in zip(terms, exact, strict=True) if sure]
        sure = np.isin([p.owner for p in solution.problem.parameters.values()], owners)
        priors = np.where(sure, EXACT, 1.0)
        doubted = weighed
        weighed = weigh_pictures(solution.problem, doubted.x, solution.free, hands, priors)
        all_exact = np.prod([chance for chance in chances if chance > 0.5])
        weighed = weighed.or_else(doubted, float(all_exact))
    problem, freed = solution.problem, weighed
    if intrinsics == "fixed":
        problem, freed = _freed(solution, weighed, hands)
    sizes = sizes_of_boards(problem, freed)
    cameras = tuple(
        _camera_estimate(view, term, good, sure, weighed, freed, sizes[view.target], hand, moved)
        for view, term, good, sure, moved in zip(
            views, terms, believed, exact, [one.moved for one in found], strict=True
        )
    )
    return PictureCalibration(
        setup=setup,
        model=model,
        cameras=cameras,
        solution=solution,
        noise=weighed.noise,
        error_model=weighed.chosen.model,
        errors=weighed.chosen.errors,
        between=_between(views, terms, weighed),
        not_found=not_found,
        notes=(*hand.unit_notes, *left_out, *more_left_out),
    )


def _between(
    views: Sequence[View], terms: Sequence[CameraView], weighed: Weighed
) -> tuple[PoseBetween, ...]:
    """Every other camera in the first one."""
    owners = {view.label: term.owners[0] for view, term in zip(views, terms, strict=True)}
    first, *rest = owners
    poses = []
    for other in rest:
        both = owners[first], owners[other]
        at = [weighed.names.index(f"{owner}.{key}") for owner in both for key in PLACEMENT]
        jacobian = tangent_of_poses(weighed.x[at])
        covariance = jacobian @ weighed.covariance[np.ix_(at, at)] @ jacobian.T
        X = [homogeneous(*pose_named(weighed.values, owner)) for owner in both]
        pose, spread = relative_pose(X[0], X[1], covariance)
        std = np.sqrt(np.maximum(np.diag(spread), 0.0))
        poses.append(PoseBetween(other, first, pose, std))
    return tuple(poses)


def _not_found(
    views: Sequence[View], agreeing: Sequence[_Agreeing | UndeterminedError]
) -> tuple[tuple[NotFound, ...], list[str]]:
    """Cameras whose pictures leave X open; notes on boards that one camera of several saw so."""
    both = [*zip(views, agreeing, strict=True)]
    determined = {view.label for view, good in both if not isinstance(good, UndeterminedError)}
    lost, notes = dict[str, NotFound](), list[str]()
    for view, opened in both:
        if not isinstance(opened, UndeterminedError):
            continue
        count = len(view.corners.images)
        if view.label in determined:
            notes.append(
                f"The {count} pictures that camera {view.label} took of target {view.target} are "
                f"left out: they leave X open, which may {' and '.join(opened.directions)}."
            )
        else:
            lost[view.label] = NotFound("camera", view.label, count, opened.directions)
    return tuple(lost.values()), notes


def _enough(
    views: Sequence[View], terms: Sequence[CameraView]
) -> tuple[list[View], list[CameraView], list[str]]:
    """Those with enough pictures, where their camera has others; notes on what is left out."""
    located = [int(term.pictures.posed.sum()) for term in terms]
    usable, notes = list[int](), list[str]()
    for k, view in enumerate(views):
        same_camera = (located[m] >= FEWEST for m, v in enumerate(views) if v.label == view.label)
        if located[k] >= FEWEST or not any(same_camera):
            usable.append(k)
            continue
        notes.append(
            f"Camera {view.label} saw target {view.target} in {located[k]} usable pictures: they "
            f"are left out, because {FEWEST} are needed."
        )
    return [views[k] for k in usable], [terms[k] for k in usable], notes


def _refuse_exchanged(
    terms: Sequence[CameraView], views: Sequence[View], images: Sequence[str], seed: int | None
) -> None:
    """Refuse labels of cameras or boards that are exchanged from some picture on."""
    posed = [usable_poses(term) for term in terms]
    rows = [
        np.array([int(o) for o in term.poses.samples.origin], dtype=np.intp)[there]
        for term, (there, *_) in zip(terms, posed, strict=True)
    ]
    numbers = np.concatenate(rows)
    order = np.argsort(numbers, kind="stable")

    def joined(parts: Iterable[FloatArray]) -> FloatArray:
        return np.concatenate([*parts])[order]

    hand, board = ((joined(p[k][0] for p in posed), joined(p[k][1] for p in posed)) for k in (1, 2))
    of_view = np.repeat(np.arange(len(views)), [len(r) for r in rows])[order]
    eye = np.array([view.label for view in views])[of_view]
    target = np.array([view.target for view in views])[of_view]
    sight = Sight.of(len(order), eye, target)

    def seen_exchanged(role: Role, a: int, b: int) -> Poses:
        """The board's poses with the pictures of two cameras read as the other's."""
        if role != "eye":
            return board
        cameras = {view.label: term.camera for view, term in zip(views, terms, strict=True)}
        names = sight.eyes[a], sight.eyes[b]
        of_other = dict(zip(names, names[::-1], strict=True))
        read = [
            _read_with(term, cameras[of_other[view.label]], pose)
            if view.label in of_other
            else pose[2]
            for term, view, pose in zip(terms, views, posed, strict=True)
        ]
        return joined(p[0] for p in read), joined(p[1] for p in read)

    setup, rows_in_order = terms[0].setup, numbers[order]
    refuse_exchanged_labels(hand, board, sight, setup, seed, rows_in_order, seen_exchanged, images)


def _read_with(term: CameraView, camera: Camera, posed: tuple[BoolArray, Poses, Poses]) -> Poses:
    """The board's poses in the usable pictures by another camera; by their own, if it has none."""
    there, _, (own_R, own_p) = posed
    R, p = some_poses(replace(term, camera=camera).seen_poses, there)
    told = np.asarray(np.isfinite(p).all(axis=1))
    return np.where(told[:, None, None], R, own_R), np.where(told[:, None], p, own_p)


def _of_lens(term: CameraView, good: BoolArray, solution: Solution) -> LensPictures | None:
    """The pictures that were left out for their hand; their corners are as good as others.

    Of a fisheye they may be the only ones near the edge of the picture.
    """
    out = term.pictures.posed & ~good
    if not out.any() or not term.free or isinstance(term.board, SurveyedMarkers):
        return None
    pixels = term.pixels[out]
    there = np.asarray(np.isfinite(pixels).all(axis=2))
    shown = np.where(there[..., None], pixels, 0.0)
    seen = PicturesSeen(np.array(list(term.board.points.values())), shown, there, term.camera.lens)
    R, p = term.seen_poses
    held = np.full(len(term.camera.intrinsics), HELD)
    state = refined(seen, CameraState(term.camera.intrinsics, R[out], p[out]), held, robust=False)
    errors = seen.errors(state)
    if errors is None:
        return None
    rms = np.sqrt(np.sum(errors**2, axis=(1, 2)) / there.sum(axis=1))
    # So many times those of the other pictures: of one that is mirrored, or shows something else.
    usual = picture_errors(term, solution.values).alone(good)
    sound = rms <= 3.0 * max(usual, FINEST)
    if not sound.any():
        return None
    return LensPictures(term.owners[2], seen.take(sound), state.take(sound))


def _hands(solution: Solution, lenses: Sequence[LensPictures | None]) -> Hands:
    """Poses of the hand of every fitted picture.

    They are near each other by the hand, and where one camera saw the board, by the board in it.
    """
    terms = [term for term in solution.problem.terms if isinstance(term, CameraView)]
    rows = [int(row) for term in terms for row in term.poses.samples.origin]
    _, first, hands = np.unique(rows, return_index=True, return_inverse=True)
    every = [term.poses.at({}) for term in terms]
    R, p = (np.concatenate(parts)[first] for parts in zip(*every, strict=True))
    poses = [(R, p)]
    if len(terms) == 1:
        poses.append(terms[0].seen_poses)
    spaces = [
        embedded(turn, shift / max(rms_length(shift - shift.mean(axis=0)), NOWHERE))
        for turn, shift in poses
        if np.isfinite(shift).all()
    ]
    return Hands(hands.reshape(-1), spaces, shared_errors(R, p), lenses)


def _chance_of_exact(term: CameraView, view: View, weighed: Weighed) -> float:
    """That a camera is ideal as its file says, and no real one of which the file knows no better.

    By Bayes' factor (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572): pictures that tell
    nothing of the camera leave both equally likely.
    """
    if not term.free or view.camera is None or term.prior is not None or not ideal(view.camera):
        return 0.0
    by_pictures = _by_pictures(term, weighed)
    assert by_pictures.covariance is not None
    lens, prior = slice(0, 4), CALIBRATED.stds(view.camera)
    told = by_pictures.covariance[lens, lens]
    change = (by_pictures.intrinsics - view.camera.intrinsics)[lens]

    def surprise(scale: float) -> float:
        """-2 log of the likelihood, with the file off by so much of its prior."""
        spread = told + np.diag(scale * prior[lens]) ** 2
        return float(np.linalg.slogdet(spread)[1] + change @ np.linalg.solve(spread, change))

    return float(expit((surprise(1.0) - surprise(EXACT)) / 2.0))


def _by_pictures(term: CameraView, freed: Weighed) -> Camera:
    """A camera as the pictures alone tell it, where its intrinsics were estimated."""
    of = [freed.names.index(f"{term.owners[2]}.{key}") for key in term.camera.lens.names]
    return replace(
        term.camera,
        intrinsics=freed.free_estimate[of].copy(),
        covariance=freed.told_covariance[np.ix_(of, of)],
    )


def _freed(solution: Solution, held: Weighed, hands: Hands) -> tuple[Problem, Weighed]:
    """The same pictures with focal lengths and principal points estimated too.

    What they say of what was held: distortion stays, which would take much of it upon itself.
    """
    terms = [
        replace(term, free=True) for term in solution.problem.terms if isinstance(term, CameraView)
    ]
    problem, values = Problem(terms), held.values
    parameters = list(problem.parameters.values())
    start = [values.get(p.name, p.nominal) for p in parameters]
    estimated = {held.names[k] for k in held.free}
    free = [
        k
        for k, p in enumerate(parameters)
        if p.name in estimated or (p.name not in values and p.key in (*FOCAL, *CENTRE))
    ]
    return problem, weigh_pictures(problem, np.array(start), np.array(free), hands)


def _term(
    hand: HandPoses, view: View, setup: EyeSetup, intrinsics: Intrinsics, *, several: bool
) -> CameraView:
    if view.camera is None and intrinsics == "fixed":
        expected = "a camera's file for fixed intrinsics"
        raise SamplesError("no camera", expected, where="--intrinsics")
    rows = hand.of_eye(view.label)
    in_pictures = np.isin(hand.image[rows], view.corners.image)
    # Of several cameras and boards not every one is seen everywhere.
    rows = rows[in_pictures] if several and in_pictures.any() else rows
    samples = Samples.from_arrays(
        [],
        np.zeros((len(rows), 0)),
        labels={"image": hand.image[rows]},
        origin=[str(row) for row in rows],
    )
    return CameraView.of_corners(
        # What noise of the hand makes up is judged by pairs, before (`_agreeing`).
        MeasuredPoses(*some_poses(hand.pose, rows), samples, judged=False),
        view.corners,
        view.board,
        view.camera,
        view.lens,
        setup=setup,
        free=intrinsics == "free",
        label=view.label,
        target=view.target,
    )


@dataclass(frozen=True, eq=False)
class _Agreeing:
    """Pictures (n,) whose boards agree with one X, and whether something seems to have moved."""

    pictures: BoolArray
    moved: bool


def _agreeing(term: CameraView, view: View, robust: bool, seed: int, *, alone: bool) -> _Agreeing:
    """Pictures whose boards agree with one X; refuses what no X explains, by its cause."""
    posed, hand, eye = usable_poses(term)
    answer, problem = None, None
    try:
        answer = calibrate_hand_eye(hand, eye, setup=term.setup, robust=robust, seed=seed)
    except SamplesError as refused:
        # Beside others a camera whose motions leave it open needs no further cause.
        if isinstance(refused, UndeterminedError) and not alone:
            raise
        problem = refused
    if answer is None or loose(answer):
        found_instead, hint = cause_of_disagreement(term, view.corners, view.camera, seed)
        if hint:
            raise SamplesError(
                found_instead, "pictures and poses that agree", hint=hint
            ) from problem
    if answer is None:
        assert problem is not None
        raise problem
    believed = np.zeros(len(posed), dtype=np.bool_)
    believed[posed] = answer.inliers
    moved = answer.finding(Moved.name) is not None
    return _Agreeing(believed if robust else np.ones_like(believed), moved)


def _settled(
    terms: Sequence[CameraView], believed: list[BoolArray], robust: bool
) -> tuple[Solution, list[BoolArray]]:
    """Solve, judge the pictures by the others, solve again until nothing changes."""
    values: dict[str, float] = {}
    for term, good in zip(terms, believed, strict=True):
        values = term.take(good).start_values({}) | values
    scatter = [
        picture_errors(term, values).scatter(good)
        for term, good in zip(terms, believed, strict=True)
    ]
    for _ in range(8):
        fitted = [
            term.take(good).at_its_distance(
                Noise(level, huber_threshold(2) * level) if robust else Noise(level), term.pixel
            )
            for term, good, level in zip(terms, believed, scatter, strict=True)
        ]
        solution = solve(Problem(fitted))
        errors = [picture_errors(term, solution.values) for term in terms]
        levels = [e.scatter(good) for e, good in zip(errors, believed, strict=True)]
        agreeing = [
            _like_the_others(e, good) if robust else good
            for e, good in zip(errors, believed, strict=True)
        ]
        same = all(map(np.array_equal, agreeing, believed))
        # Relative change of the scatter that is none.
        if (same and np.allclose(levels, scatter, 0.02, 0)) or not solution.converged:
            break
        believed, scatter = agreeing, levels
    return solution, believed


def _like_the_others(errors: PictureErrors, good: BoolArray) -> BoolArray:
    """Pictures whose errors chance explains, by the middle one of those that were believed.

    A hand that is as far off as the others shows more pixels in a picture from nearby: who is
    left out is farther off in pixels, and in millimetres or degrees.
    """
    rms = errors.rms
    if len(rms) < FEW_PAIRS:
        return good

    def far(sizes: FloatArray, ways: int, finest: float) -> BoolArray:
        expected = float(np.median(sizes[good])) ** 2 / float(chdtri(ways, 0.5))
        limit = float(chdtri(ways, FALSE_ALARM / len(rms)))
        return np.asarray(sizes**2 > max(expected * limit, finest**2))

    off = [far(size, DIRECTIONS, 0.0) for size in errors.by_hand.T]
    # Numbers that the error of a picture is worth where it is judged by the others: its worst turns
    # decide, so that it scatters more than the mean of all ways would.
    agreeing = ~(far(rms, 2, FINEST) & (off[0] | off[1]))
    return agreeing if agreeing.sum() >= FEW_PAIRS else good


def _camera_estimate(
    view: View,
    term: CameraView,
    good: BoolArray,
    exact: bool,
    weighed: Weighed,
    freed: Weighed,
    size: Learned,
    hand: HandPoses,
    moved: bool,
) -> CameraEstimate:
    """A camera of the answer; ``freed`` is one with its intrinsics estimated."""
    same_corners = view.camera is not None and term.prior is not None
    values = weighed.values
    markers = measured_markers(term, weighed.names, weighed.x, weighed.covariance)
    notes = term.board.notes if isinstance(term.board, SurveyedMarkers) else ()
    eye, board, owner = term.owners
    at = [weighed.names.index(f"{frame}.{key}") for frame in (eye, board) for key in PLACEMENT]
    jacobian = tangent_of_poses(weighed.x[at])
    of = [freed.names.index(f"{owner}.{key}") for key in term.camera.lens.names]
    by_pictures = _by_pictures(term, freed)
    camera = replace(term.camera, covariance=None)
    covariance = weighed.covariance[np.ix_(at, at)]
    if term.free:
        camera = replace(
            camera, intrinsics=freed.x[of].copy(), covariance=freed.covariance[np.ix_(of, of)]
        )
    chance_held, by_file = 1.0, weighed.by_files[np.ix_(at, at)]
    if not term.free and view.camera is not None:
        chance_held = chance_of_held(view.camera, by_pictures)
        at_freed = [freed.names.index(weighed.names[k]) for k in at]
        # X follows the errors of the file, as large as it states them, or as the pictures show.
        if view.camera.covariance is not None:
            slope = _slope(freed.covariance, at_freed, of)
            by_file = slope @ view.camera.covariance @ slope.T
            covariance = covariance + by_file
        if chance_held < FALSE_ALARM:
            away = freed.free_estimate[at_freed] - weighed.x[at]
            covariance = covariance + np.outer(away, away)
    X, Z = pose_named(values, eye), pose_named(values, board)
    by_pictures_alone = dict(zip(freed.names, freed.free_estimate.tolist(), strict=True))
    refined_board = term.board
    if isinstance(refined_board, SurveyedMarkers):
        refined_board = refined_board.at(term.sees_board, values)
    refined = replace(term, camera=camera, board=refined_board)
    A = as_eye_in_hand(hand.pose, term.setup)
    rows = np.array([int(origin) for origin in term.poses.samples.origin], dtype=np.intp)
    A = A[0][rows], A[1][rows]
    expected = after(inverse_poses(after(A, X)), Z)
    R, p = loop_closures(A, X, refined.pictures.poses_near(expected))
    posed = np.isfinite(p[:, 0])
    turns = np.full(p.shape, np.nan)
    turns[posed] = vector_from_rotation(Z[0].T @ R[posed])
    errors = picture_errors(term, values)
    points = np.array(list(term.board.points))
    sample, point = term.detected
    pixels = term.pixels[sample, point]
    corners = np.column_stack([sample, points[point], pixels, errors.residual, good[sample]])
    images = term.poses.samples.labels["image"]
    upside_down = refined.pictures.upside_down(A)
    return CameraEstimate(
        label=view.label,
        target=view.target,
        setup=term.setup,
        X=homogeneous(*X),
        Z=homogeneous(*Z),
        covariance=jacobian @ covariance @ jacobian.T,
        by_file=jacobian @ by_file @ jacobian.T,
        camera=camera,
        given=view.camera,
        same_corners=same_corners,
        if_held=None if same_corners else _if_held(view, weighed, at[:6], of),
        by_pictures=by_pictures,
        chance_held=chance_held,
        X_by_pictures=homogeneous(*pose_named(by_pictures_alone, eye)),
        images=tuple(images.tolist()),
        rows=rows,
        inliers=good,
        picture_rms=errors.rms,
        alone=errors.alone(good),
        slides=p - Z[1],
        turns=turns,
        corners=corners,
        numbered_otherwise=term.pictures.numbered_otherwise,
        board_size=size,
        other_size=other_size(term.pictures),
        moved=moved_between_pictures(refined, good) if moved else "",
        exact=exact,
        lens_choice=term.lens_choice,
        markers=markers,
        marker_notes=(*notes, *filter(None, [against_stated_sizes(term, markers)])),
        turned={what: tuple(images[those & ~good].tolist()) for what, those in upside_down.items()},
    )


def _if_held(
    view: View, weighed: Weighed, eye: Sequence[int], intrinsics: Sequence[int]
) -> HeldIntrinsics | None:
    """X with the intrinsics held at what the camera's file says, whose own ± is counted.

    By the regression of X on the intrinsics, which no prior of these changes; ``eye`` are the six
    parameters of X. None where the file says no ±, or where they were held.
    """
    if view.camera is None or view.camera.covariance is None or intrinsics[0] not in weighed.free:
        return None
    every = weighed.covariance
    slope = _slope(every, eye, intrinsics)
    covariance = every[np.ix_(eye, eye)] - slope @ every[np.ix_(intrinsics, eye)]
    covariance = covariance + slope @ view.camera.covariance @ slope.T
    x = weighed.x[eye] + slope @ (view.camera.intrinsics - weighed.x[intrinsics])
    jacobian = tangent_of_poses(x)
    return HeldIntrinsics(
        homogeneous(rotation_from_vector(x[3:]), x[:3]),
        np.sqrt(np.maximum(np.diag(jacobian @ covariance @ jacobian.T), 0.0)),
    )


def _slope(covariance: FloatArray, of: Sequence[int], by: Sequence[int]) -> FloatArray:
    """(k, n) regression of unknowns (k,) on others (n,), which no prior of these changes."""
    others = covariance[np.ix_(by, by)]
    unit = np.sqrt(np.maximum(np.diag(others), 1e-300))
    scale = np.outer(unit, unit)
    mixed = covariance[np.ix_(of, by)]
    return np.asarray(mixed @ (np.linalg.pinv(others / scale, 1e-9, True) / scale))
