"""A camera sees a board: reprojection of its corners, with the camera's own errors if wanted."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Level
from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.geometry.lens import CENTRE, FOCAL, Lens
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.measurements import (
    Board,
    Camera,
    Chessboard,
    Corners,
    Markers,
    SampleColumns,
    YamlSection,
    corners_of,
    read_corners,
)
from suta_calib.measurements.fields import Field, Fields, mapping
from suta_calib.measurements.marker_axes import markers_as_seen
from suta_calib.model.parameters import Parameter
from suta_calib.terms.block import LEARNT, Block, Noise
from suta_calib.terms.board_pictures import BoardPictures
from suta_calib.terms.board_sight import BoardSight, OnePoint
from suta_calib.terms.camera_row import CAMERA_FILES, CAMERA_KEYS, read_camera_row, with_corners
from suta_calib.terms.camera_start import PLANAR
from suta_calib.terms.external_frame import (
    ExternalFrame,
    labelled,
    pose_named,
    pose_parameters,
    pose_values,
)
from suta_calib.terms.eye_term import BoardEyeTerm
from suta_calib.terms.hand_eye_start import (
    EYE_IN_HAND,
    EYE_TO_HAND,
    FEWEST,
    Poses,
    agreeing_hand_eye,
    as_eye_in_hand,
    inverse_poses,
    some_poses,
)
from suta_calib.terms.intrinsics import UNCALIBRATED, camera_at, intrinsic_parameters, prior_beside
from suta_calib.terms.length_scale import stretch_factors, stretch_parameters
from suta_calib.terms.lens_choice import LensChoice, camera_alone
from suta_calib.terms.line_delay import LINE_DELAY, LineDelay, rolled
from suta_calib.terms.marker_survey import surveyed
from suta_calib.terms.misread_pictures import check_files, doubts, otherwise_read
from suta_calib.terms.observed import Observed, Resimulation
from suta_calib.terms.poses import ArmPoses, PoseSource
from suta_calib.terms.reprojection import reprojection
from suta_calib.terms.sample_errors import HandError, SampleErrors
from suta_calib.terms.setup import Setup
from suta_calib.terms.surveyed_markers import SurveyedMarkers
from suta_calib.terms.term import Term

HAND_ERROR: Final = Field(
    "hand_error",
    mapping(HandError),
    "How far the hand is from where the joints say, anew in every picture, as play leaves it: all "
    "corners of a picture move together.",
)
# What a kind that nobody has set up looks at, and with what: a board and a camera as they are.
_BOARD: Final = Chessboard(7, 5, 0.03)
_CAMERA: Final = Camera(1280, 960, np.array([1000.0, 1000.0, 639.5, 479.5, 0, 0, 0, 0, 0]))


@dataclass(frozen=True, eq=False, repr=False)
class CameraView(BoardEyeTerm):
    """``π((T_base_hand,i X)⁻¹ Z p_k) - u_ik`` for every corner k that is seen in picture i.

    π is the camera with its lens; X = ``T_hand_eye`` and Z = ``T_base_board`` are unknown. With
    the camera beside the arm X = ``T_base_eye``, Z = ``T_hand_board``, and the board's point in the
    eye ``X⁻¹ T_base_hand,i Z p_k``.

    Errors are in pixels; so that they stand beside other kinds' lengths, a pixel counts as what it
    covers at the typical distance of the board: a constant factor. Corners of one picture share
    where the arm really was: they are one cluster.

    Attributes:
        poses: samples, one for each picture, with the corners seen in it.
        board: whose points are seen.
        camera: its intrinsics as they are known, and how well.
        free: whether the intrinsics are estimated too, from what is known of them as prior.
        pixel: length that a pixel covers at the board, m.
        noise: scatter and robustness of a corner, m at the board.
        prior: of the intrinsics (n,), standard deviations.
        lens_choice: how the model of the lens was chosen, where no file says it.
        from_file: whether a file has the camera; otherwise it is found from the pictures.
        hand_error: how far the hand is from where the joints say, anew in every picture; None where
            that is less than what corners scatter.
        line_delay: how long a row of the picture takes, of a camera with a rolling shutter; None
            where all rows are of one moment.

    Raises:
        SamplesError: no corner in any picture, or corners of another board.
    """

    kind = "camera_view"
    order = 9
    about = (
        "a camera on the tip saw a board (or a camera beside the arm saw a board on the tip, with "
        "setup: eye-to-hand): the corners in the pictures, as suta-calib detect finds them; "
        "intrinsics: free also corrects the camera"
    )
    columns = SampleColumns(
        labels=("image",), pixels=True, about={"image": "The picture that was taken there."}
    )
    keys = (*CAMERA_KEYS, HAND_ERROR, LINE_DELAY)
    measured_keys = (*("corners", "intrinsics", "target", "sigma_px", "huber_px", HAND_ERROR.name),)
    unit = "px"
    files: ClassVar[Mapping[str, str]] = CAMERA_FILES
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {"image": ("image",)}
    assumptions_key = "intrinsics: free"

    board: Board = _BOARD
    camera: Camera = _CAMERA
    free: bool = False
    pixel: float = 1e-3
    noise: Noise = LEARNT
    prior: FloatArray | None = None
    line_delay: LineDelay | None = None
    hand_error: HandError | None = None
    lens_choice: LensChoice | None = None
    from_file: bool = True

    @property
    def of_clock(self) -> tuple[Parameter, ...]:
        """The unknowns of the camera's clock, and of its shutter."""
        offset = super().of_clock
        if not offset or self.line_delay is None:
            return offset
        return (*offset, self.line_delay.parameter(self.sees))

    @property
    def clock_reach(self) -> float:
        """How far from the time of a row the end of the picture may have been taken, s."""
        longest = 0.0 if self.line_delay is None else self.line_delay.longest
        return super().clock_reach + self.camera.height * longest

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> CameraView:
        """Build it from a row of a job file.

        Raises:
            InputError: corners that cannot be used, or that belong to no sample.
        """
        given = dict(setup.settings)
        noise, corners = given.pop("noise", None), given.pop("corners", None)
        attributes: dict[str, Any] = {"noise": setup.noise, "label": setup.label, **given}
        board = given.get("board")
        if corners is None and isinstance(board, Markers) and board.unplaced:
            places = "the place of each marker, where pictures are simulated"
            raise cls.refuse("markers of unknown places", places)
        term = (
            cls(poses, **attributes)
            if corners is None
            else cls.of_corners(poses, read_corners(corners), **attributes)
        )
        return term.at_its_distance(noise, given.get("pixel"))

    @classmethod
    def over_arrays(cls, poses: PoseSource, given: Mapping[str, Any]) -> Self:
        """Build it from arrays, as from files: ``noise`` is in px; no camera means to find one."""
        board, noise = given.get("board"), given.get("noise")
        if board is None:
            raise cls.refuse("no board", "the key board: the file of the board that was seen")
        pixels, images = poses.samples.pixels, poses.samples.labels["image"]
        assert pixels is not None
        if pixels.shape[1] != len(board.points):
            expected = f"{len(board.points)}, as the board has"
            raise SamplesError(f"{pixels.shape[1]} points", expected, where=f"{cls.kind}: pixels")
        picture, point = np.nonzero(np.isfinite(pixels).all(axis=2))
        numbers = np.array([*board.points])
        corners = corners_of(images[picture], numbers[point], pixels[picture, point])
        more = {"free": "camera" not in given} | {n: v for n, v in given.items() if n != "noise"}
        term = cls.of_corners(poses, corners, **more)
        term.check_given()
        return term.at_its_distance(noise, given.get("pixel"))

    @classmethod
    def of_corners(
        cls,
        poses: PoseSource,
        corners: Corners,
        board: Board,
        camera: Camera | None = None,
        lens: Lens | None = None,
        **more: Any,
    ) -> Self:
        """Over the poses of pictures in which corners were found, the board numbered from one end.

        Args:
            poses: with the label ``image``.
            corners: of any pictures.
            board: whose points they are.
            camera: that saw it; without one it is found from the corners.
            lens: its model, where no camera is given; by default that which predicts best.
            more: attributes.

        Raises:
            SamplesError: corners that cannot be used, or that belong to no sample.
        """
        corners.check(board, camera)
        board, turned = markers_as_seen(board, corners)
        if turned:
            warnings.warn(f"{corners.path or 'corners'}: {turned}", SutaCalibWarning, stacklevel=2)
        if isinstance(board, Markers) and board.unplaced:
            if camera is None:
                raise cls.refuse(
                    "markers of unknown places, and no camera",
                    "the file of a calibrated camera",
                    "calibrate the camera first (suta-calib detect), and name its file",
                )
            hand = as_eye_in_hand(poses.at({}), more.get("setup", EYE_IN_HAND))
            names = poses.samples.labels["image"].tolist()
            by_picture = dict(zip(names, zip(*hand, strict=True), strict=True))
            of_arm = isinstance(poses, ArmPoses)
            board = surveyed(board, corners, camera, by_picture, exact_hand=not of_arm)
            board = board.with_reference() if of_arm else board
            corners = corners.take(np.isin(corners.point, list(board.points)))
        poses, prior = with_corners(poses, corners, board), None
        if camera is None:
            camera, more["lens_choice"] = camera_alone(corners, board, lens)
            prior, more["from_file"] = UNCALIBRATED.stds(camera), False
        elif camera.corners:
            prior = prior_beside(camera, corners)
        return cls(poses, board, camera, prior=prior, **more).numbered_alike(corners.path)

    @classmethod
    def read_settings(cls, row: YamlSection) -> dict[str, Any]:
        """Board, camera, where it is, and the noise in pixels; the corners' file as it is named."""
        return read_camera_row(row) | Fields(HAND_ERROR, LINE_DELAY).values(row)

    @property
    def settings(self) -> Mapping[str, Any]:
        """Board, camera and where it is."""
        names = ("board", "camera", "setup", "free", "pixel", "target", "prior")
        more = ("line_delay", "hand_error", "lens_choice", "from_file")
        return {name: getattr(self, name) for name in (*names, *more)}

    @property
    def board_seen(self) -> Board | None:
        """The board, once there are pictures of it; none whose markers the arm measures."""
        if isinstance(self.board, SurveyedMarkers) and not self.board.carries_scale:
            return None
        return None if self.poses.samples.pixels is None else self.board

    @property
    def notes(self) -> tuple[str, ...]:
        """Which lens the pictures were taken with, where no file says it; what markers show."""
        lens = () if self.lens_choice is None else (self.lens_choice.sentence,)
        return (*lens, *self.board.notes) if isinstance(self.board, SurveyedMarkers) else lens

    def at_its_distance(self, noise: Noise | None = None, pixel: float | None = None) -> Self:
        """The same with the length that a pixel covers, and with a noise in px.

        Args:
            noise: in px; that which it has by default.
            pixel: length that a pixel covers, m; that at the typical distance of the board by
                default.
        """
        if pixel is None:
            has_pixels = self.poses.samples.pixels is not None
            pixel = (self.pictures.pixel if has_pixels else None) or self.pixel
        if noise is not None:
            sigma = None if noise.sigma is None else noise.sigma * pixel
            noise = Noise(sigma, noise.huber * pixel, noise.fixed)
        return replace(self, pixel=pixel, noise=noise or self.noise)

    def numbered_alike(self, source: Path | None) -> Self:
        """The same with the board numbered from one end in all pictures (`BoardPictures`)."""
        return self._with_pixels(
            self.pictures.numbered_alike(self.poses.at({}), self._names, source)
        )

    def beside(self, terms: Sequence[Term]) -> Self:
        """The same where other rows see its board, or share its camera.

        A board that looks the same after half a turn is numbered from one end in all of them; and
        corners that their camera was calibrated from are counted once, whichever row has them. A
        camera without a file has one lens in all rows.
        """
        views = [other for other in terms if isinstance(other, CameraView)]
        once = (
            other.prior
            for other in views
            if other.owners[2] == self.owners[2]
            and other.camera.corners
            and other.prior is not None
        )
        term = replace(self, prior=next(once, None)) if self.prior is None else self
        shared = next((o for o in views if o.owners[2] == self.owners[2]), self)
        if self.lens_choice is not None and shared.camera.lens is not self.camera.lens:
            term = replace(term, camera=shared.camera, prior=shared.prior, lens_choice=None)
        shutters = (o.line_delay for o in views if o.owners[2] == self.owners[2] and o.line_delay)
        if term.line_delay is None and term.time_offset is not None:
            term = replace(term, line_delay=next(shutters, None))
        if self._surveyed is not None:
            boards = (o.board for o in views if o.owners[1] == self.owners[1])
            surveyed_board = next(b for b in boards if isinstance(b, SurveyedMarkers))
            term = term._seeing(surveyed_board)
        same_mount = (o for o in views if (o.owners[1], o.setup) == (self.owners[1], self.setup))
        first = next(same_mount, self)
        if first is self or not self.board.symmetric or self.poses.samples.pixels is None:
            return term
        hands = self._to_board, first._to_board
        same = self.owners[2] == first.owners[2]
        return term._with_pixels(
            self.pictures.numbered_as(first.pictures, hands, self._names, same=same)
        )

    def _seeing(self, board: SurveyedMarkers) -> Self:
        """The same with the markers that another row found, about where that has them."""
        if board is self.board:
            return self
        column = {number: k for k, number in enumerate(self.board.points)}
        table = np.full((len(self.poses), len(board.points), 2), np.nan)
        for k, number in enumerate(board.points):
            if number in column:
                table[:, k] = self.pixels[:, column[number]]
        there = np.isfinite(table).any(axis=(1, 2))
        if not there.any():
            raise self.refuse(
                "no marker that the first row of this board found",
                "pictures of the same markers",
                "give the row another target, if it is another board",
            )
        poses = self.poses.with_samples(replace(self.poses.samples, pixels=table)).take(there)
        return replace(self, poses=poses, board=board)

    def _with_pixels(self, pixels: FloatArray) -> Self:
        if pixels is self.pixels:
            return self
        samples = replace(self.poses.samples, pixels=pixels)
        return replace(self, poses=self.poses.with_samples(samples))

    @property
    def _to_board(self) -> Poses:
        """A of ``A X B = Z``, arm at nominal."""
        return as_eye_in_hand(self.poses.at({}), self.setup)

    @property
    def owners(self) -> tuple[str, str, str]:
        """Owners of the camera's pose, of the board's, and of the intrinsics."""
        eye, board = self.frame_names
        return eye, board, labelled("camera", self.sees)

    @property
    def outside(self) -> tuple[ExternalFrame, ...]:
        """Camera and board: one of them in the base, the other in the tip."""
        return self.eye_outside, self.board_outside

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """Poses of camera and board, and the intrinsics and the board's stretch where free."""
        eye, board, camera = self.owners
        poses = (*pose_parameters(eye), *pose_parameters(board))
        if self.free:
            poses = (*poses, *intrinsic_parameters(camera, self.camera, self.prior))
        if isinstance(self.board, SurveyedMarkers):
            return (*poses, *self.board.parameters(self.sees_board))
        return (*poses, *stretch_parameters(board, self.stretch))

    @property
    def _surveyed(self) -> SurveyedMarkers | None:
        """The board, where places of its markers are estimated."""
        return self.board if isinstance(self.board, SurveyedMarkers) else None

    @property
    def stretch(self) -> float | None:
        """None of markers whose places are estimated."""
        return super().stretch if self._surveyed is None else None

    @property
    def with_assumptions_estimated(self) -> Self | None:
        """The same with focal lengths and principal point estimated.

        Distortion stays: it would take much of what a principal point does upon itself.
        """
        if self.free:
            return None
        prior = UNCALIBRATED.stds(self.camera)
        prior[len(FOCAL) + len(CENTRE) :] = 0.0
        return replace(self, free=True, prior=prior)

    @cached_property
    def pixels(self) -> FloatArray:
        """(n, points, 2) of the samples; the origin for samples that nobody has looked at."""
        pixels = self.poses.samples.pixels
        count = len(self.board.points)
        if pixels is None:
            return np.zeros((len(self.poses), count, 2))
        if pixels.shape[1] != count:
            raise self.refuse(f"pixels of {pixels.shape[1]} points", f"of the board's {count}")
        return pixels

    @cached_property
    def pictures(self) -> BoardPictures:
        """What the corners tell without the poses of any hand."""
        return BoardPictures(self.board, self.camera, self.pixels, self.from_file)

    @property
    def seen_poses(self) -> Poses:
        """``T_eye_board`` of every picture, by its own corners; NaN where they do not tell it."""
        return self.pictures.poses

    @cached_property
    def detected(self) -> tuple[IntArray, IntArray]:
        """Picture and place in `points` of every corner that was found, (k,) each."""
        picture, point = np.nonzero(np.isfinite(self.pixels).all(axis=2))
        return picture, point

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Reprojection errors, one row for each corner in each picture."""
        sample, point = self.detected
        if not (n := len(sample)):
            raise self.refuse("no corner in any picture", "corners of the board")
        numbers, names = [*self.board.points], self._names
        points, markers, unknowns = self.pictures.points[point], self._surveyed, self.own_parameters
        own_columns = np.tile(np.arange(len(unknowns)), (n, 1))
        corner = np.zeros((n, 0))
        if markers is not None:
            columns = {p.name: k for k, p in enumerate(unknowns)}
            which = np.array(numbers, dtype=np.intp)[point]
            points, corner, of_marker = markers.rows(which, columns, self.sees_board)
            before = len(unknowns) - len(markers.parameters(self.sees_board))
            own_columns = np.hstack([own_columns[:, :before], of_marker])
        data = [self.pixels[sample, point], points, np.full((n, 1), self.pixel)]
        if not self.free:
            data.append(np.tile(self.camera.intrinsics, (n, 1)))
        data.append(corner)
        residual = reprojection(
            *(self.setup, self.camera.lens, self.free, self.stretch is not None),
            surveyed=markers is not None,
        )
        labels = [
            f"{names[i]} corner {numbers[k]}"
            for i, k in zip(sample.tolist(), point.tolist(), strict=True)
        ]
        block = Block.per_sample(
            "reprojection", "m", 2, residual, own_columns, np.hstack(data), self.noise, labels
        )
        lag = None if len(self.of_clock) < 2 else self.pixels[sample, point, 1]
        errors = None
        if self.hand_error is not None and lag is None and markers is None:
            errors = SampleErrors.of(self._by_hand_error(sample, point), sample)
        block = replace(block, samples=sample[:, None], sample_errors=errors)
        return (replace(block, pixel=self.pixel, lag=lag),)

    def _by_hand_error(self, sample: IntArray, point: IntArray) -> FloatArray:
        """(n, 2, 6) how far a hand off by `hand_error` moves corners, in units of their scatter."""
        assert self.hand_error is not None
        sizes = np.repeat([self.hand_error.shift, self.hand_error.turn], 3)
        return np.asarray(self._by_hand[sample, point] * sizes / self.pictures.scatter)

    @property
    def _by_hand(self) -> FloatArray:
        """(n, points, 2, 6) how corners move with the hand, px per m and rad.

        It turns about the camera on it, or about the middle of the board in it.
        """
        middle = self.pictures.points.mean(axis=0)
        return self.pictures.by_motion(0.0 if self.setup == EYE_IN_HAND else middle)

    @property
    def _names(self) -> Sequence[str]:
        """Of the pictures."""
        samples = self.poses.samples
        return samples.labels["image"].tolist() if "image" in samples.labels else samples.origin

    def readings(self, block: Block) -> IntArray:
        """A corner that is seen again at the same rest is the same reading."""
        del block
        sample, point = self.detected
        return np.column_stack([self.poses.rests[sample], point])

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The board in the camera, and its corners in the picture where they would be found."""
        sight = self._sight(values, poses)
        pixels = self._rolled(values, poses, lambda sight: sight.pixels)
        return Observed(sight.position, sight.rotation, pixels, sight.camera)

    def _rolled(
        self,
        values: Mapping[str, float],
        poses: PoseSource,
        pixels: Callable[[BoardSight], FloatArray],
    ) -> FloatArray:
        """(n, points, 2) pixels, of a shutter that may roll."""
        delay = sum(values.get(p.name, 0.0) for p in self.of_clock[1:])

        def after(time: float) -> FloatArray:
            later = values.get(poses.clock, 0.0) + time
            return pixels(self._sight({**values, poses.clock: later}, poses))

        return rolled(after, delay, self.camera.height)

    def _sight(self, values: Mapping[str, float], poses: PoseSource) -> BoardSight:
        """The board before the camera at these poses."""
        eye, board, intrinsics = self.owners
        (R_eye, p_eye), (R_board, p_board) = pose_named(values, eye), pose_named(values, board)
        hand = poses.at(values)
        rotation, position = hand if self.setup == EYE_TO_HAND else inverse_poses(hand)
        turn, shift = R_eye.T @ rotation @ R_board, (rotation @ p_board + position - p_eye) @ R_eye
        camera = camera_at(self.camera, intrinsics, values)
        made = self.board
        if isinstance(made, SurveyedMarkers):
            made = made.at(self.sees_board, values)
        if self.stretch is not None:
            made = made.stretched(stretch_factors(self.own_parameters, values))
        return BoardSight(made, camera, turn, shift)

    def resimulated(
        self, values: Mapping[str, float], noise: Sequence[float], again: Resimulation
    ) -> Self:
        """The same corners of the same pictures, or those that are in sight where none were."""
        ideal = self.observed(values, self.poses)
        pixels, measured = ideal.pixels, self.poses.samples.pixels
        assert pixels is not None
        if measured is not None:
            everywhere = self._rolled(values, self.poses, lambda sight: sight.everywhere)
            pixels = np.where(np.isfinite(measured), everywhere, np.nan)
        if self.hand_error is not None:
            # Of a small standard deviation, vectors of turns are of that of each component.
            straight, sizes = np.tile(np.eye(3), (len(self.poses), 1, 1)), self.hand_error
            off = [again.turned(straight, size) for size in (sizes.shift, sizes.turn)]
            moved = self._by_hand @ np.hstack([*map(vector_from_rotation, off)])[:, None, :, None]
            pixels = pixels + moved[..., 0]
        ideal = replace(ideal, pixels=pixels)
        sigma = {"pixels": noise[0] / self.pixel}
        return self.over_poses(again.observed(self.poses, ideal, sigma, self.blocks[0].relative))

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Poses of the board by every picture, and the closed form of those that agree."""
        located = self.pictures.posed
        hand = as_eye_in_hand((rotation, position), self.setup)
        X, Z = agreeing_hand_eye(some_poses(hand, located), some_poses(self.seen_poses, located))
        values = [pose_values(*X), pose_values(*Z)]
        if self.free:
            values.append(self.camera.intrinsics)
        count = sum(map(len, values))
        return np.concatenate([*values, [p.nominal for p in self.own_parameters[count:]]])

    def single_touches(self) -> CameraView:
        """The board's middle in every picture, where the picture's own pose of the board has it."""
        samples = replace(self.poses.samples, pixels=self.pictures.middles[:, None])
        middle = OnePoint(self.pictures.points.mean(axis=0))
        return replace(self, poses=self.poses.with_samples(samples), board=middle)

    def check_enough(self) -> None:
        """Three pictures at least of which each tells where the board is, of this very board."""
        located = int(self.pictures.posed.sum())
        if located < FEWEST:
            raise self.refuse(
                f"{located} pictures from which the pose of the board follows",
                f"at least {FEWEST}, each with {PLANAR} corners or more that are not on a line",
            )
        check_files(self.pictures)

    @property
    def stated(self) -> Mapping[tuple[str, str, str], object]:
        """With the camera and its clock."""
        of_camera: dict[str, object] = {"intrinsics": "free" if self.free else "fixed"}
        if self.line_delay is not None:
            of_camera["line_delay"] = self.line_delay
        # What is found from a row's own corners differs from row to row.
        if self.prior is None or self.camera.corners:
            of_camera["camera"] = self.camera.values
        return {**super().stated, **{(k, "label", self.sees): v for k, v in of_camera.items()}}

    def check_given(self) -> None:
        """Refuse given poses that cannot be, and a rolling shutter of a camera without times."""
        super().check_given()
        if self.line_delay is not None and self.time_offset is None:
            hint = "if the camera has the clock of the joints, give it a small prior"
            raise self.refuse(
                "line_delay_us without a time offset", "time_offset_ms beside it", hint
            )

    @property
    def misread(self) -> Iterator[tuple[str, Self]]:
        """With pixels counted in another way, and the board numbered from one end again."""
        if self.poses.samples.pixels is None:
            return
        for sentence, pixels in otherwise_read(self.pictures):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SutaCalibWarning)
                yield sentence, self._with_pixels(pixels).numbered_alike(None)

    @property
    def doubts(self) -> Mapping[str, Level]:
        """Corners numbered mirrored or from the other end; a camera's file of another size."""
        robust = bool(np.isfinite(self.noise.huber))
        return doubts(self.pictures, self._names, self._to_board, robust=robust)
