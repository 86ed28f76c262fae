"""A stereo pair, or a rig: fixed poses between cameras, from pictures of a board alone.

The cameras take their pictures at the same instants; nobody needs to know where the board is or how
the rig moves. Pairs of cameras that saw the board together tell where to start, and reprojection
errors of all pictures are minimised at once (`rig_fit`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import PurePath
from typing import Final

import numpy as np
from scipy.special import chdtri

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import homogeneous, rms_length, skew, vector_from_rotation
from suta_calib.measurements import Camera
from suta_calib.pose_calibration.consensus import FALSE_ALARM
from suta_calib.pose_calibration.exchanged_files import refuse_exchanged_files
from suta_calib.pose_calibration.eye_poses import ENOUGH, PoseBetween, relative_pose
from suta_calib.pose_calibration.inputs import error_context
from suta_calib.pose_calibration.pictures import Intrinsics, View
from suta_calib.pose_calibration.rig_fit import RigProblem, RigState
from suta_calib.terms.board_pictures import BoardPictures
from suta_calib.terms.hand_eye_start import HALF_TURN, Poses
from suta_calib.terms.intrinsics import CALIBRATED, HELD, prior_beside
from suta_calib.terms.misread_pictures import check_files
from suta_calib.trust.uncertainty_budget import KnownScatter, pose_budgets
from suta_calib.words import listed

# Pictures that a sentence names.
NAMED: Final = 5


@dataclass(frozen=True, eq=False)
class RigCamera:
    """A camera of a rig.

    Attributes:
        name: its label.
        camera: as it is used, with covariance where the pictures corrected it.
        given: as its file has it.
        shown: as the pictures show it, though it may be held as its file has it.
        T_first: (4, 4) its pose in the first camera, m.
        pictures: number of its pictures that were fitted.
        rms: their root mean square reprojection error, px.
        alone: the same if every picture had a pose of the board of its own.
        left_out: names of its pictures that do not agree with the others.
    """

    name: str
    camera: Camera
    given: Camera
    shown: Camera
    T_first: FloatArray
    pictures: int
    rms: float
    alone: float
    left_out: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class RigCalibration:
    """Cameras on one body.

    Attributes:
        cameras: in order; the first one's frame is that of the rig.
        covariance: (6 c, 6 c) of the cameras' poses in the first: displacement (m, axes of the
            first) and turn (rad, own axes) of each, without that of the scale.
        scale: relative standard deviation of all lengths, which the board carries.
        instants: number of instants at which two cameras or more saw the board.
        freedom: degrees of freedom of the scatter behind the covariance.
    """

    cameras: tuple[RigCamera, ...]
    covariance: FloatArray
    scale: float
    instants: int
    freedom: float = math.inf

    @property
    def rms(self) -> float:
        """Root mean square reprojection error over the cameras, px."""
        return float(np.sqrt(np.mean([camera.rms**2 for camera in self.cameras])))

    def between(self, first: str, second: str) -> PoseBetween:
        """``T_first_second`` of two cameras, by their names."""
        names = [camera.name for camera in self.cameras]
        a, b = names.index(first), names.index(second)
        rows = np.concatenate([6 * camera + np.arange(6) for camera in (a, b)])
        poses = self.cameras[a].T_first, self.cameras[b].T_first
        pose, covariance = relative_pose(*poses, self.covariance[np.ix_(rows, rows)])
        by_scale = np.pad(self.scale * pose[:3, 3], (0, 3))
        covariance, scaled = covariance + np.outer(by_scale, by_scale), np.outer(by_scale, by_scale)
        budgets = pose_budgets(
            f"camera {second}",
            covariance,
            KnownScatter(self.freedom),
            {f"size of the board ({1e6 * self.scale:,.0f} ppm)": scaled},
        )
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return PoseBetween(second, first, pose, std, budgets)

    @cached_property
    def others(self) -> tuple[PoseBetween, ...]:
        """Every other camera in the first one."""
        first, *rest = (camera.name for camera in self.cameras)
        return tuple(self.between(first, other) for other in rest)

    @cached_property
    @judged
    def assessment(self) -> Assessment:
        """How far to trust the poses."""
        bad, care = list[str](), list[str]()
        for camera in self.cameras:
            lost = listed(camera.left_out, NAMED)
            if camera.left_out:
                care.append(
                    f"Pictures of camera {camera.name} do not agree with those of the others, and "
                    f"are left out: {lost}. Was the board moving, or is it another instant?"
                )
            # Errors of the rig, in those of each picture by itself, that a board which is a little
            # bent leaves; and those that are visible, px.
            if camera.rms > max(2.0 * camera.alone, 0.3):
                (bad if camera.rms > 5.0 * camera.alone else care).append(
                    f"Camera {camera.name}: reprojection errors are {camera.rms:.2f} px RMS, but "
                    f"{camera.alone:.2f} px if each picture has a pose of the board of its own. "
                    "Pictures of one name are not of one instant (let the board rest, or trigger "
                    "the cameras), or a camera was moved."
                )
            if contradiction := _against_the_file(camera):
                # Held as the file has it, no ± holds the error of the file.
                (care if camera.camera is camera.shown else bad).append(contradiction)
        if self.instants < ENOUGH:
            care.append(
                f"Two cameras saw the board at {self.instants} instants only: the standard "
                "deviations are uncertain. Take a dozen or more."
            )
        care += [
            f"{unsure}. Take pictures of the board near the edges of both pictures, near and far, "
            "tilted by 30° or more."
            for other in self.others
            if (unsure := other.unsure(f"Camera {other.name} in camera {other.inside}"))
        ]
        facts = [
            f"The board carries the scale: if it is 1 % too long, so are the distances between the "
            f"cameras, and no residual shows it. Every ± includes {1e6 * self.scale:,.0f} ppm."
        ]
        sentence = "; ".join(
            f"camera {one.name} in camera {one.inside} is known to {one.within}"
            for one in self.others
        )
        sentence = f"{sentence[0].upper()}{sentence[1:]} (one standard deviation, 3-D), by "
        sentence += f"{self.instants} instants; corners agree to {self.rms:.2f} px RMS"
        return Assessment.of(sentence, bad=bad, care=care, facts=facts)


def rig_from_pictures(
    views: Sequence[View], *, intrinsics: Intrinsics = "free", robust: bool = True
) -> RigCalibration:
    """Poses of cameras in the first one, by pictures of one board that they took together.

    Args:
        views: of two cameras or more, each with its file; pictures of one instant have one name, or
            one number.
        intrinsics: whether they are estimated too, from the camera's file as prior.
        robust: False for least squares over all corners.

    Raises:
        SamplesError: too few pictures in common, or corners that contradict the files.
    """
    _check(views)
    board = views[0].board
    names, keys = _instants(views)
    tables = []
    for view, at in zip(views, keys, strict=True):
        table = np.full((len(names), len(board.points), 2), np.nan)
        table[at] = view.corners.table(board.points)
        tables.append(table)
        view.corners.check(board, view.camera)
    cameras = [_given(view) for view in views]
    pictures = [
        BoardPictures(board, camera, table) for camera, table in zip(cameras, tables, strict=True)
    ]
    refuse_exchanged_files([view.label for view in views], pictures)
    for view, one in zip(views, pictures, strict=True):
        with error_context(view.corners.path):
            check_files(replace(one, pixels=one.pixels[np.isfinite(one.pixels).any(axis=(1, 2))]))
    pictures, in_first = _linked(pictures, [view.label for view in views])
    state, usable = _start(pictures, in_first, cameras)
    every = RigProblem(
        pictures[0].points,
        np.stack([one.pixels[usable] for one in pictures]),
        [camera.lens for camera in cameras],
        state,
        [_information(view) for view in views],
        robust,
    )
    if intrinsics == "fixed":
        problem, state, lost = _agreeing(replace(every, priors=[None] * len(views)))
    else:
        problem, state, lost = _agreeing(every)
    errors = problem.errors(state)
    if errors is None:
        raise SamplesError("pictures that agree with no poses of the cameras", "one rig of cameras")
    covariance = problem.covariance(state)
    T = np.array([homogeneous(R.T, -R.T @ t) for R, t in zip(state.turn, state.shift, strict=True)])
    images = np.array(names)[usable]
    estimated = shown = _found(problem, state, cameras, covariance)
    if intrinsics == "fixed":
        freed, freely, _ = _agreeing(replace(every, start=state))
        shown = _found(freed, freely, cameras, freed.covariance(freely))
    return RigCalibration(
        tuple(
            RigCamera(
                view.label,
                camera,
                _given(view),
                shown[k],
                T[k],
                int(problem.there[k].any(axis=1).sum()),
                rms_length(errors[k][problem.there[k]]),
                _alone(BoardPictures(board, camera, problem.pixels[k])),
                tuple(images[lost[k]].tolist()),
            )
            for k, (view, camera) in enumerate(zip(views, estimated, strict=True))
        ),
        _of_poses(problem, state, covariance),
        board.length_scale.std,
        int((problem.there.any(axis=2).sum(axis=0) > 1).sum()),
        problem.freedom,
    )


def _first(cameras: Sequence[Camera]) -> tuple[FloatArray, ...]:
    return tuple(camera.intrinsics for camera in cameras)


def _check(views: Sequence[View]) -> None:
    """One board, and a file of every camera."""
    if len(views) < 2:
        raise SamplesError("one camera", "two cameras or more", where="--corners")
    first = views[0].board.row()
    for view in views:
        if view.board.row() != first:
            raise SamplesError("two boards", "one board that all cameras see", where="--board")
        if view.camera is None:
            raise SamplesError(
                f"no file of camera {view.label}",
                "the file of every camera",
                where="--camera",
                hint="calibrate each by its own pictures first: suta-calib detect --camera-out",
            )


def _given(view: View) -> Camera:
    assert view.camera is not None
    return view.camera


def _instants(views: Sequence[View]) -> tuple[list[str], list[list[int]]]:
    """Names of all instants, and of each camera the instants of its pictures.

    Pictures of one name are of one instant. Where cameras share no name, those of one number are,
    as in left_07.png and right_07.png.
    """
    labels = [view.corners.images for view in views]
    if len(set().union(*labels)) == sum(map(len, labels)):
        numbers = [[_number(name) for name in names] for names in labels]
        if any("" in one or len(set(one)) < len(one) for one in numbers):
            raise SamplesError(
                f"pictures {labels[0][0]} and {labels[1][0]}, of which no names are the same",
                "one name, or one number, for the pictures of one instant",
                file=views[1].corners.path,
            )
        labels = numbers
    instants = list(dict.fromkeys(name for names in labels for name in names))
    place = {name: k for k, name in enumerate(instants)}
    return instants, [[place[name] for name in names] for names in labels]


def _number(name: str) -> str:
    """The last number in the name of a picture, without zeros before it."""
    digits = re.findall(r"\d+", PurePath(name).stem)
    return digits[-1].lstrip("0") or "0" if digits else ""


def _information(view: View) -> FloatArray:
    """Inverse covariance of the intrinsics, as the camera's file tells them."""
    camera = _given(view)
    prior = prior_beside(camera, view.corners) if camera.corners else None
    if prior is None and camera.covariance is not None:
        covariance = camera.covariance + HELD**2 * np.eye(len(camera.intrinsics))
        unit = np.sqrt(np.diag(covariance))
        return np.asarray(np.linalg.pinv(covariance / np.outer(unit, unit)) / np.outer(unit, unit))
    stds = CALIBRATED.stds(camera) if prior is None else prior
    return np.asarray(np.diag(1.0 / np.maximum(stds, HELD) ** 2))


def _linked(
    pictures: list[BoardPictures], names: Sequence[str]
) -> tuple[list[BoardPictures], list[Poses]]:
    """Pictures, a symmetric board numbered from one end; ``T_first_camera`` of every camera.

    Each camera is joined to the one that it saw the board with most often (a spanning tree).
    """
    posed = np.array([one.posed for one in pictures])
    together = posed.astype(int) @ posed.T.astype(int)
    in_first: dict[int, Poses] = {0: (np.eye(3), np.zeros(3))}
    while len(in_first) < len(pictures):
        links = [
            (together[a, b], a, b)
            for a in in_first
            for b in range(len(pictures))
            if b not in in_first
        ]
        count, a, b = max(links)
        # Instants that tell a pose between two cameras and one more by which it can be judged.
        if count < 3:
            lone = listed([name for k, name in enumerate(names) if k not in in_first])
            raise SamplesError(
                f"{count} instants at which camera {lone} saw the board together with another",
                "at least 3, better a dozen",
                hint="pictures of one instant have one name, or one number, in all folders",
            )
        pictures[b], (R, p) = _joined(pictures[a], pictures[b])
        R_a, p_a = in_first[a]
        in_first[b] = R_a @ R, R_a @ p + p_a
    return pictures, [in_first[k] for k in range(len(pictures))]


def _joined(first: BoardPictures, second: BoardPictures) -> tuple[BoardPictures, Poses]:
    """The second camera's pictures, numbered as the first one's, and its pose in the first."""
    rows = np.flatnonzero(first.posed & second.posed)
    middle = first.points.mean(axis=0)
    (R_a, p_a), (R_b, p_b) = ((one.poses[0][rows], one.poses[1][rows]) for one in (first, second))
    ways = [(R_b, p_b)]
    if first.board.symmetric:
        ways.append((R_b @ HALF_TURN, p_b + R_b @ (middle - HALF_TURN @ middle)))
    poses = [(R_a @ np.swapaxes(R, 1, 2), p_a) for R, p in ways]
    poses = [
        (R, p - np.einsum("nij,nj->ni", R, way[1])) for (R, p), way in zip(poses, ways, strict=True)
    ]
    size = float(np.linalg.norm(p_a, axis=1).mean())

    def off(turn: FloatArray, shift: FloatArray) -> FloatArray:
        """(ways, n) how far every instant's poses are from one, in turns and distances."""
        return np.stack(
            [
                np.linalg.norm(vector_from_rotation(turn.T @ R), axis=1)
                + np.linalg.norm(p - shift, axis=1) / size
                for R, p in poses
            ]
        )

    # So many instants are asked; the middle one of the distances judges.
    asked = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), 100)).astype(np.intp))
    candidates = [(R[k], p[k]) for R, p in poses for k in asked]
    best = min(candidates, key=lambda one: float(np.median(off(*one).min(axis=0))))
    turned = np.zeros(len(second.pixels), dtype=np.bool_)
    turned[rows] = off(*best).argmin(axis=0) == 1
    pixels = np.where(turned[:, None, None], second.pixels[:, ::-1], second.pixels)
    return (replace(second, pixels=pixels) if turned.any() else second), best


def _start(
    pictures: Sequence[BoardPictures], in_first: Sequence[Poses], cameras: Sequence[Camera]
) -> tuple[RigState, BoolArray]:
    """Where the search begins, and which instants tell where the board is."""
    corners = np.array(
        [
            np.where(one.posed, np.isfinite(one.pixels).all(axis=2).sum(axis=1), 0)
            for one in pictures
        ]
    )
    usable, most = corners.max(axis=0) > 0, corners.argmax(axis=0)
    R, p = (np.stack([one.poses[k] for one in pictures]) for k in (0, 1))
    at = np.arange(len(most))
    turns, shifts = (np.array([pose[k] for pose in in_first]) for k in (0, 1))
    rotation = turns[most] @ R[most, at]
    position = np.einsum("nij,nj->ni", turns[most], p[most, at]) + shifts[most]
    turn = np.swapaxes(turns, 1, 2)
    shift = -np.einsum("cij,cj->ci", turn, shifts)
    state = RigState(_first(cameras), turn, shift, rotation[usable], position[usable])
    return state, np.asarray(usable)


def _by_picture(errors: FloatArray, there: BoolArray) -> FloatArray:
    """(…) root mean square errors (2-D) of pictures (…, k, 2), px; NaN of none."""
    count = there.sum(axis=-1)
    squares = np.sum(errors**2, axis=(-1, -2))
    return np.asarray(np.sqrt(squares / np.where(count > 0, count, np.nan)))


def _agreeing(problem: RigProblem) -> tuple[RigProblem, RigState, BoolArray]:
    """The state by pictures that agree, and which (c, n) do not."""
    lost = np.zeros(problem.there.shape[:2], dtype=np.bool_)
    first, state = problem.start.intrinsics, problem.solved()
    while problem.robust and (worst := _astray(problem, state)) is not None:
        lost[worst] = True
        # Priors are about where it starts.
        problem = replace(problem.without(lost), start=replace(state, intrinsics=first))
        state = problem.solved()
    return problem, state, lost


def _astray(problem: RigProblem, state: RigState) -> tuple[int, int] | None:
    """Camera and instant of the picture that fits the others worst, if it is no chance."""
    errors = problem.errors(state)
    if errors is None:
        return None
    rms = _by_picture(errors, problem.there)
    middles = np.nanmedian(rms, axis=1, keepdims=True)
    # Errors of a picture, in the middle one's and in px, from which on it is left out, as where a
    # camera is calibrated.
    far = rms / np.maximum(5.0 * middles, 1.0)
    worst = np.unravel_index(int(np.nanargmax(far)), far.shape)
    return (int(worst[0]), int(worst[1])) if far[worst] > 1.0 else None


def _found(
    problem: RigProblem, state: RigState, given: Sequence[Camera], covariance: FloatArray
) -> list[Camera]:
    """The cameras, with covariance where the pictures corrected them."""
    cameras = []
    for camera, prior, values, columns in zip(
        given, problem.priors, state.intrinsics, problem.columns[0], strict=True
    ):
        if prior is None:
            cameras.append(camera)
            continue
        # What no picture may change is no part of the lens, such as a k3 of zero.
        held = np.diag(prior) >= 0.99 / HELD**2
        cameras.append(
            replace(
                camera,
                intrinsics=np.where(held, camera.intrinsics, values),
                covariance=covariance[columns, columns] * np.outer(~held, ~held),
                corners="",
            )
        )
    return cameras


def _alone(pictures: BoardPictures) -> float:
    """Root mean square error of corners about their picture's own pose of the board, px."""
    posed = replace(pictures, pixels=pictures.pixels[pictures.posed])
    errors = posed.errors[np.isfinite(posed.errors).all(axis=2)]
    return rms_length(errors) if len(errors) else 0.0


def _of_poses(problem: RigProblem, state: RigState, covariance: FloatArray) -> FloatArray:
    """Covariance of the cameras' poses in the first one, whose own is none."""
    count = len(state.turn)
    jacobian = np.zeros((6 * count, problem.shared))
    for k, columns in enumerate(problem.columns[1]):
        if columns.stop == columns.start:
            continue
        R, t, first = state.turn[k], state.shift[k], columns.start
        jacobian[6 * k : 6 * k + 3, first : first + 3] = -R.T
        jacobian[6 * k : 6 * k + 3, first + 3 : first + 6] = -R.T @ skew(t)
        jacobian[6 * k + 3 : 6 * k + 6, first + 3 : first + 6] = -np.eye(3)
    return np.asarray(jacobian @ covariance @ jacobian.T)


def _against_the_file(camera: RigCamera) -> str:
    """That the pictures contradict the camera's file by more than either says of itself."""
    corrected, given = camera.shown, camera.given
    if corrected.covariance is None:
        return ""
    stds = CALIBRATED.stds(given) if given.stds is None else given.stds
    assert corrected.stds is not None
    change = (corrected.intrinsics - given.intrinsics)[:4]
    off = change / np.sqrt(stds[:4] ** 2 + corrected.stds[:4] ** 2)
    if np.max(off**2) <= float(chdtri(1, FALSE_ALARM)):
        return ""
    changes = ", ".join(
        f"{name} {given.values[name]:.1f} → {corrected.values[name]:.1f}"
        for name in corrected.lens.names[:4]
    )
    what = (
        "The poses follow the pictures."
        if camera.camera is corrected
        else "Held so, the poses are wrong by more than their ±. Use --intrinsics free."
    )
    return f"The pictures contradict the file of camera {camera.name} ({changes} px). {what}"
