"""What pictures of a board tell of cameras and hands, and how far to trust it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.special import chdtrc, stdtrit

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.assessment import Assessment, Level, judged
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import rms_length, vector_from_rotation
from suta_calib.measurements import Camera
from suta_calib.measurements.board import Markers
from suta_calib.pose_calibration.consensus import FALSE_ALARM
from suta_calib.pose_calibration.correlation import WAYS
from suta_calib.pose_calibration.eye_poses import (
    ENOUGH,
    EyePoses,
    Model,
    PoseBetween,
    Unknown,
    unknowns_of,
)
from suta_calib.pose_calibration.optimality import PictureOptimality
from suta_calib.pose_calibration.picture_models import ErrorModel, ReprojectionError
from suta_calib.pose_calibration.picture_noise import PictureNoise
from suta_calib.pose_calibration.robust_answer import MANY_OUTLIERS, set_aside
from suta_calib.pose_calibration.undetermined import NotFound
from suta_calib.solver.solution import Solution
from suta_calib.solver.weights import Learned
from suta_calib.terms.board_pictures import QUOTED, TURNED
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EyeSetup
from suta_calib.terms.intrinsics import CALIBRATED
from suta_calib.terms.lens_choice import LensChoice
from suta_calib.trust.uncertainty_budget import KnownScatter, UncertaintyBudget, pose_budgets
from suta_calib.units import std_text
from suta_calib.words import listed

# Times what the camera alone leaves from where on it is the robot that leaves the rest.
ROBOTS: Final = 2.0
# Focal lengths and principal point among the intrinsics.
PAIRS: Final = (slice(0, 2), slice(2, 4))
# Chance of a contradiction below which an answer that follows held intrinsics must not be used:
# hardly a sound one may be refused.
SURE: Final = 1e-3
TAKEN_AS_EXACT: Final = (
    "The camera's file is of an ideal camera, as a renderer has it (fx = fy, the axis through the "
    "middle of the picture, no distortion), and the pictures agree with it. It is taken to be "
    "exact, and every ± includes the chance that it is not. If a real camera took the pictures, "
    "calibrate it."
)
COUNTED: Final = "Pixels are counted from 0 at the centre of the first one."


@dataclass(frozen=True, eq=False)
class HeldIntrinsics:
    """X (4, 4) with the intrinsics held at what the camera's file says; `std` as in `EyePoses`."""

    X: FloatArray
    std: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraEstimate(Displayable, EyePoses):
    """One camera of the answer.

    Attributes:
        label: its name.
        target: label of the board that it saw.
        setup, X, Z, covariance: as in `EyePoses`; the target is the board.
        by_file: (12, 12) the part of the covariance that the ± of the camera's file makes.
        camera: intrinsics as they were found, with their covariance; without it where they were
            held.
        given: as they were given, or None.
        same_corners: whether they were calibrated from these very corners, which count once.
        if_held: X with the intrinsics held at the file's; None where it says no ± of its own, or
            they were held.
        by_pictures: as the pictures alone tell them, with covariance; where they were held, focal
            lengths and principal point beside the distortion of the file.
        X_by_pictures: X with these.
        chance_held: that pictures contradict intrinsics as much which are held at the file's, and
            right.
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
        numbered_otherwise: how its corners are numbered if not as usual, in a sentence or empty,
            and what an answer is worth for it.
        board_size: how many times as large as its file says the board would be, for all that the
            hand's motions tell.
        other_size: what in the camera's file denies the size of picture that it says, in a
            sentence, or empty.
        moved: what was moved while its pictures were taken, in a sentence, or empty.
        exact: whether its file is of an ideal camera, which the pictures do not contradict: it was
            taken to be exact.
        lens_choice: how the model of the lens was chosen, where no file says it.
        markers: of a board whose markers nobody measured, as they were found; None of another.
        marker_notes: what was found about them, one sentence each.
        turned: pictures that were left out and agree with the others once the ``board`` or the
            ``picture`` is turned by half a turn.
    """

    label: str
    target: str
    setup: EyeSetup
    X: FloatArray
    Z: FloatArray
    covariance: FloatArray
    by_file: FloatArray
    camera: Camera
    given: Camera | None
    same_corners: bool
    if_held: HeldIntrinsics | None
    by_pictures: Camera
    X_by_pictures: FloatArray
    chance_held: float
    images: tuple[str, ...]
    rows: IntArray
    inliers: BoolArray
    picture_rms: FloatArray
    alone: float
    slides: FloatArray
    turns: FloatArray
    corners: FloatArray
    numbered_otherwise: tuple[str, Level]
    board_size: Learned
    other_size: str
    moved: str
    exact: bool
    lens_choice: LensChoice | None
    markers: Markers | None
    marker_notes: tuple[str, ...]
    turned: Mapping[str, tuple[str, ...]]

    def budgets(self, name: str) -> tuple[UncertaintyBudget, ...]:
        """What the uncertainty of X, called ``name``, is made of: its place, and its turn."""
        stated = {"intrinsics, as the camera's file states them": self.by_file[:6, :6]}
        # Poses of X and Z; what their noise may be is in the covariance.
        freedom = WAYS * int(self.inliers.sum()) - 12
        scatter = KnownScatter(float(max(freedom, 1)), student=True)
        return pose_budgets(name, self.covariance[:6, :6], scatter, stated)

    @property
    def rms(self) -> float:
        """Root mean square reprojection error of the corners of fitted pictures, px."""
        return rms_length(self.corners[self.corners[:, 6] > 0, 4:6])

    @property
    def held(self) -> bool:
        """Whether the intrinsics were held at what the file says."""
        return self.camera.covariance is None

    @property
    def moved_by_intrinsics(self) -> tuple[float, float]:
        """How far X would be from here with the intrinsics of the pictures, m and rad."""
        shift = self.X_by_pictures[:3, 3] - self.X[:3, 3]
        turn = vector_from_rotation(self.X[:3, :3].T @ self.X_by_pictures[:3, :3])
        return float(np.linalg.norm(shift)), float(np.linalg.norm(turn))

    @property
    def board_scale(self) -> float:
        """How many times as large the board must be, or as far the hand must move; 1 if by chance.

        Student's t, for the few turns and places of a few pictures.
        """
        size = self.board_size
        # Poses of X and Z, and the size of the board.
        freedom = WAYS * int(self.inliers.sum()) - 13
        # Errors of an arm's lengths are smaller.
        if freedom < 1 or abs(size.value - 1.0) < 0.01:
            return 1.0
        limit = float(-stdtrit(freedom, FALSE_ALARM / 2.0))
        return size.value if abs(np.log(size.value)) > limit * size.log_std else 1.0

    @property
    def strange(self) -> list[str]:
        """Names of the pictures that were not fitted."""
        return [name for name, good in zip(self.images, self.inliers, strict=True) if not good]


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureCalibration(Displayable):
    """Where the cameras are, and the board, from pictures.

    Attributes:
        setup: ``eye-in-hand`` or ``eye-to-hand``.
        model: ``AX=XB`` or ``AX=ZB``: whether Z is asked for.
        cameras: one or more.
        solution: of the solver, over the fitted pictures as it weighs them: where `noise` began.
        noise: what scatters; the pictures are weighed by it.
        error_model: how the hand's errors are taken (`picture_models`).
        errors: of the corners, by model; empty of few pictures.
        between: where every other camera is in the first one.
        notes: what the files give to think about, one sentence each.
        optimality: what is proven of it, where that was asked.
        not_found: further cameras, whose pictures leave X open.
    """

    setup: EyeSetup
    model: Model
    cameras: tuple[CameraEstimate, ...]
    solution: Solution
    noise: PictureNoise
    error_model: ErrorModel
    errors: Mapping[ErrorModel, ReprojectionError]
    between: tuple[PoseBetween, ...] = ()
    notes: tuple[str, ...] = ()
    optimality: PictureOptimality | None = None
    not_found: tuple[NotFound, ...] = ()

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Which of X and Z the model asks for."""
        return unknowns_of(self.model)

    @property
    def rms(self) -> float:
        """Root mean square reprojection error of all fitted corners, px."""
        every = np.concatenate([camera.corners for camera in self.cameras])
        return rms_length(every[every[:, 6] > 0, 4:6])

    @property
    def left_out(self) -> float | None:
        """Root mean square reprojection error of pictures left out in turn, px; None of few."""
        return self.errors[self.error_model].left_out if self.errors else None

    @property
    def outliers(self) -> tuple[int, ...]:
        """Rows of the file of poses whose picture was judged an outlier, from 0."""
        rows = [camera.rows[~camera.inliers] for camera in self.cameras]
        return tuple(sorted({int(row) for row in np.concatenate(rows)}))

    @cached_property
    @judged
    def assessment(self) -> Assessment:
        """How far to trust every X."""
        bad, facts = list[str](), list[str]()
        care = [camera.sentence for camera in self.not_found]
        if not self.solution.converged:
            bad.append(f"The solver did not converge: {self.solution.sentence}.")
        for camera in self.cameras:
            which = self._which("Camera", camera)
            more_bad, more_care = _judged(camera, self.noise)
            bad += [which + sentence for sentence in more_bad]
            care += [which + sentence for sentence in more_care]
            if camera.lens_choice is not None:
                facts.append(which + camera.lens_choice.sentence)
            if camera.given is None:
                facts.append(which + _size_to_be_corrected(camera.camera))
            objection, level = _against_the_file(camera)
            for sentence, worth in ((objection, level), camera.numbered_otherwise):
                if sentence:
                    {"bad": bad, "care": care, "good": facts}[worth].append(which + sentence)
            if camera.exact:
                facts.append(which + TAKEN_AS_EXACT)
            if level == "good" and (better := _better_if_held(camera)):
                facts.append(which + better)
        sentence = "; ".join(
            f"{self._which('camera', camera)}{camera.accuracy_text}, "
            f"by {int(camera.inliers.sum())} of {len(camera.inliers)} pictures"
            for camera in self.cameras
        )
        return Assessment.of(
            "" if bad else f"{sentence}; their corners agree to {self.rms:.2f} px RMS",
            bad=bad,
            care=[*care, *self.notes],
            facts=facts,
        )

    def _which(self, word: str, camera: CameraEstimate) -> str:
        return f"{word} {self.name_of(camera)}: " if len(self.cameras) > 1 else ""

    def name_of(self, camera: CameraEstimate) -> str:
        """Its label, and that of the board where it saw several."""
        same = sum(other.label == camera.label for other in self.cameras)
        return camera.label if same == 1 else f"{camera.label}/{camera.target}"


def _size_to_be_corrected(camera: Camera) -> str:
    """That nothing says how large the pictures are, and what to do before the file is used."""
    return (
        "The size of the pictures is not known without a camera file. The file that is written "
        f"states {camera.width} x {camera.height} px, the least that holds all corners: correct "
        "image_width and image_height in it before another program uses it, or export it with "
        "--picture-size. X does not depend on them."
    )


def _against_the_file(camera: CameraEstimate) -> tuple[str, Level]:
    """What the pictures say against the camera's file, and what an answer is worth for it.

    Care is asked for where what is known of the file's own errors does not explain it either. Where
    X follows such a file and is off by more than its ±, it must not be used.
    """
    by_pictures, given, stds = camera.by_pictures, camera.given, camera.by_pictures.stds
    assert by_pictures.covariance is not None
    assert stds is not None
    if given is None:
        return "", "good"
    if camera.same_corners and not camera.held:
        return (
            "The camera's file was calibrated from these same corners. They count once, and the ± "
            "in the file is not used.",
            "good",
        )
    change = by_pictures.intrinsics - given.intrinsics
    unknown = np.zeros((len(given.intrinsics),) * 2)
    stated = unknown if given.covariance is None else given.covariance
    if camera.held:
        if camera.chance_held > FALSE_ALARM:
            return "", "good"
        shift, turn = camera.moved_by_intrinsics
        away = f"{std_text(shift, 'm')} and {std_text(turn, 'rad')}"
        changes = [
            f"{key} {given.values[key]:.2f} → {by_pictures.values[key]:.2f} ± {std:.2f}"
            for key, std in zip(("fx", "fy", "cx", "cy"), stds, strict=False)
        ]
        sentence = (
            f"The pictures contradict the fixed intrinsics ({', '.join(changes)} px). X follows "
            f"the camera's file. With the intrinsics of the pictures it moves by {away}. Let the "
            "pictures correct the intrinsics (--intrinsics free), or correct the file. "
            f"{COUNTED}"
        )
        displaced, turned = camera.displaced_turned
        # Its ± includes this motion: it is more than all the rest.
        misled = 2.0 * shift**2 > displaced**2 or 2.0 * turn**2 > turned**2
        return sentence, "bad" if misled and camera.chance_held < SURE else "care"
    prior = given.stds if given.stds is not None else CALIBRATED.stds(given)
    expected = stated if given.covariance is not None else np.diag(prior**2)
    for pair in PAIRS:
        if _significant(change[pair], (by_pictures.covariance + expected)[pair, pair]):
            return _contradiction(camera, given), "care"
    if not _significant(change[2:4], (by_pictures.covariance + stated)[2:4, 2:4]):
        return "", "good"
    (u, v), (by_u, by_v) = by_pictures.intrinsics[2:4], stds[2:4]
    return (
        f"The principal point is ({u:.2f} ± {by_u:.2f}, {v:.2f} ± {by_v:.2f}) px by the pictures, "
        f"but ({given.intrinsics[2]:.2f}, {given.intrinsics[3]:.2f}) px in the camera's file. X "
        f"follows the pictures. {COUNTED}",
        "good",
    )


def _better_if_held(camera: CameraEstimate) -> str:
    """How well X would be known with the intrinsics held, where that is worth a word."""
    if camera.if_held is None:
        return ""
    shift, turn = camera.displaced_turned
    held_shift, held_turn = np.linalg.norm(camera.if_held.std.reshape(2, 3), axis=1).tolist()
    # Reported if X is so many times more certain.
    if shift < 1.2 * held_shift and turn < 1.2 * held_turn:
        return ""
    return (
        f"With --intrinsics fixed, X would be known to ± {std_text(held_shift, 'm')} and ± "
        f"{std_text(held_turn, 'rad')} instead of {camera.within}, if the ± "
        "of the intrinsics in the camera's file is right (it is included)."
    )


def chance_of_held(given: Camera, by_pictures: Camera) -> float:
    """Of pictures that contradict held intrinsics as much as these, if the file is right."""
    assert by_pictures.covariance is not None
    spread = by_pictures.covariance + (0.0 if given.covariance is None else given.covariance)
    change = by_pictures.intrinsics - given.intrinsics
    # Of two tests the one that says more.
    least = min(_chance(change[pair], spread[pair, pair]) for pair in PAIRS)
    return min(len(PAIRS) * least, 1.0)


def _chance(change: FloatArray, covariance: FloatArray) -> float:
    """Of so large a change, if nothing changed."""
    return float(chdtrc(len(change), float(change @ np.linalg.solve(covariance, change))))


def _significant(change: FloatArray, covariance: FloatArray) -> bool:
    """Whether chance does not explain a change."""
    return _chance(change, covariance) < FALSE_ALARM


def _contradiction(camera: CameraEstimate, given: Camera) -> str:
    changes, other = [], False
    for key in ("fx", "fy", "cx", "cy"):
        before, after = given.values[key], camera.camera.values[key]
        changes.append(f"{key} {before:.1f} → {after:.1f}")
        # No calibration of the same pictures changes a focal length by as much.
        other |= key[0] == "f" and abs(after / before - 1.0) > 0.1
    what = "is the file for pictures of another size?" if other else "X follows the pictures."
    return f"The pictures contradict the camera's file ({', '.join(changes)} px): {what}"


def _judged(camera: CameraEstimate, noise: PictureNoise) -> tuple[list[str], list[str]]:
    """Why a camera's X must not be used, and what must be known to use it."""
    bad, care = list[str](), list[str]()
    fitted, count = int(camera.inliers.sum()), len(camera.inliers)
    if count - fitted > MANY_OUTLIERS * count:
        bad.append(f"{count - fitted} of {count} pictures do not agree with the others.")
    if camera.board_scale != 1.0:
        by = camera.board_size.value * camera.board_size.log_std
        sentence = (
            f"The hand moves {camera.board_scale:.3f} ± {by:.3f} times as far as the pictures show "
            "with the size of the board. One of the two is wrong, and X by as much, beyond its ±. "
            "Measure the squares or markers as printed (if they are so many times as large, "
            "correct board.yaml), and check the unit and scale of the hand's positions."
        )
        # X is of no use from this share on.
        (bad if abs(camera.board_scale - 1.0) > 0.05 else care).append(sentence)
    if fitted < ENOUGH:
        care.append(
            f"Only {fitted} pictures: the standard deviations are uncertain, and a wrong picture "
            "may stay unnoticed. Take a dozen or more."
        )
    # Where it follows wrong intrinsics, other pictures are no remedy.
    if camera.moved:
        care.append(camera.moved)
    elif camera.chance_held > FALSE_ALARM and (unsure := camera.unsure()):
        remedy = "add pictures, turned by 30° or more about different axes, near and far."
        if noise.shared[0] > noise.position.value or noise.shared[1] > noise.rotation.value:
            remedy = (
                "neighbouring poses of the hand share errors, as with wrong lengths or angles of "
                f"the arm. More pictures do not remove them. Calibrate the arm, and {remedy}"
            )
        care.append(f"{unsure}: {remedy}")
    care += camera.marker_notes
    care += [
        f"In {listed(list(names), QUOTED)} {TURNED[what]} These pictures are left out."
        for what, names in camera.turned.items()
        if names
    ]
    explained = {name for names in camera.turned.values() for name in names}
    strange = [name for name in camera.strange if name not in explained]
    unexplained = np.isin(camera.images, strange)
    care += set_aside("pictures", ~unexplained, listed(strange, QUOTED))
    if camera.other_size:
        care.append(camera.other_size)
    if camera.inverted != "good":
        where = "beside the robot" if camera.setup == EYE_IN_HAND else "on the hand"
        (bad if camera.inverted == "bad" else care).append(
            f"{camera.lengths_told} Are the poses of the hand inverted, or is the camera {where}? "
            f"Then X would be the transform that is called Z here: {camera.Z_told}."
        )
    return bad, care
