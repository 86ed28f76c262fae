"""Common parts of kinds in which a depth camera sees points in 3-D."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final, Self

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Level
from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.geometry.numbers import extent
from suta_calib.measurements import SampleColumns, YamlSection
from suta_calib.measurements.depth_noise import TYPICAL, DepthNoise, ray_axes
from suta_calib.measurements.fields import FILE, Field, Fields, mapping
from suta_calib.measurements.pose_files import FAR, NEAR
from suta_calib.measurements.seen_points import SeenPoints, read_seen_points
from suta_calib.model.parameters import End
from suta_calib.terms.block import LEARNT, Block, Noise, grouped
from suta_calib.terms.checks import check_unit
from suta_calib.terms.eye_term import EyeTerm
from suta_calib.terms.hand_eye_start import FEWEST
from suta_calib.terms.instrument_terms import SEEN_UNIT
from suta_calib.terms.poses import ArmPoses, PoseSource
from suta_calib.terms.setup import Setup
from suta_calib.terms.term import Term
from suta_calib.units import mm
from suta_calib.words import listed

NOISE_KEY: Final = Field(
    "depth_noise",
    mapping(DepthNoise),
    "Standard deviation of a point by its distance. One factor on it is learnt. Default: "
    "learnt from how the board's points scatter; without a board, that of a typical "
    "depth camera.",
)


def file_key(mark: str) -> Field:
    """The key of the file with what was seen, by the column that names it."""
    about = (
        f"{mark.capitalize()}s in the pictures: {mark}s.csv (image, {mark}, x, y, z). The samples "
        "then have one row for each picture, with its name in a column image."
    )
    return Field(f"{mark}s", FILE, about)


def depth_columns(mark: str, about: str) -> SampleColumns:
    """Positions in the camera, each with what was seen there."""
    return SampleColumns(
        position=True,
        position_sigma=True,
        common_labels=(mark, "image"),
        about={
            "x, y, z": "The point in the camera: x to the right, y down, z ahead.",
            "sigma_x, sigma_y, sigma_z": "Standard deviation of each, or one sigma of all three "
            "(m, or mm with _mm); without them the noise follows from the distance.",
            mark: about,
            "image": "The picture or the cloud it was seen in.",
        },
    )


@dataclass(frozen=True, eq=False, repr=False)
class DepthTerm(EyeTerm):
    """Points in the frame of a depth camera, in pictures or clouds that have names.

    One factor on all noise is learnt. Points of one picture share where the arm really was: they
    are one cluster.

    Attributes:
        once: whether nothing of one name is seen twice in a picture.
        poses: samples with a position in the camera, and the label `mark`; of one thing without it.
        depth_noise: how it scatters by distance; learnt, or else that of a typical camera.
        noise: scatter and robustness, m of a typical residual.
        weights: the noise by distance that is used; rows that are taken keep that of the whole.
        typical_sigma: as of `TrackedPoint`, of the residuals.

    Raises:
        SamplesError: the samples hold no positions.
    """

    once: ClassVar[bool] = True

    depth_noise: DepthNoise | None = None
    noise: Noise = LEARNT
    weights: DepthNoise | None = None
    typical_sigma: float | None = None

    def __post_init__(self) -> None:
        if self.weights is None:
            learnt = self.depth_noise or DepthNoise.learnt(self.of_bodies) or TYPICAL
            object.__setattr__(self, "weights", learnt)
        if self.typical_sigma is None:
            typical = float(np.exp(np.mean(np.log(self.sigmas))))
            object.__setattr__(self, "typical_sigma", typical)
        super().__post_init__()

    # ── from files ────────────────────────────────────────────────────────────────────────────
    @classmethod
    def columns_in(cls, settings: Mapping[str, Any]) -> SampleColumns:
        """One row for each picture where what was seen has a file of its own."""
        if f"{cls.mark}s" not in settings:
            return cls.columns
        return SampleColumns(labels=("image",), about={"image": cls.columns.about["image"]})

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> Self:
        """Build it from a row of a job file, with what was seen in its pictures."""
        given = dict(setup.settings)
        file = given.pop(f"{cls.mark}s", None)
        if file is not None:
            poses = with_seen(poses, read_seen_points(file, cls.mark, once=cls.once), cls.mark)
        return cls(poses, noise=setup.noise, label=setup.label, **given)

    @classmethod
    def read_settings(cls, row: YamlSection) -> dict[str, Any]:
        """Its keys; where the file's key holds poses by name, a simulation reads them by itself."""
        file = f"{cls.mark}s"
        by_name = isinstance(row.data.get(file), dict)
        return Fields(*cls.keys).values(row, without=(file,) if by_name else ())

    @property
    def settings(self) -> Mapping[str, Any]:
        """Where the camera is, and its noise."""
        names = ("setup", "depth_noise", "weights", "typical_sigma")
        return {name: getattr(self, name) for name in names}

    # ── what was seen ─────────────────────────────────────────────────────────────────────────
    @property
    def mark_end(self) -> End:
        """The other end than the camera's."""
        return self.ends[1]

    @cached_property
    def seen(self) -> tuple[list[str], IntArray]:
        """Names of what was seen, and which of them each row saw, (n,); one where none is named."""
        labels = self.poses.samples.labels.get(self.mark)
        return ([""], np.zeros(len(self.poses), np.intp)) if labels is None else grouped(labels)

    @property
    def mark_owners(self) -> list[str]:
        """Owners of the unknowns of each."""
        return [f"{self.mark}[{name}]" if name else self.mark for name in self.seen[0]]

    @property
    def in_eye(self) -> FloatArray:
        """(n, 3) positions in the camera, m."""
        if self.poses.samples.position is None:
            raise self.refuse("no positions", "columns x, y, z in the camera's frame")
        return self.poses.samples.position

    @cached_property
    def picture(self) -> IntArray:
        """(n,) which picture, from 0, each row is of: by its name, or by the rest of the arm."""
        images = self.poses.samples.labels.get("image")
        return self.poses.rests if images is None else grouped(images)[1]

    @property
    def of_bodies(self) -> Iterable[tuple[FloatArray, FloatArray]]:
        """Points on a rigid body and in the camera, by picture, that tell the noise."""
        return ()

    @cached_property
    def scatter(self) -> tuple[FloatArray, FloatArray]:
        """Axes (n, 3, 3) in which coordinates scatter by themselves, and (n, 3) by how much, m."""
        stated, measured = self.poses.samples.position_sigma, self.in_eye
        if stated is not None:
            return np.tile(np.eye(3), (len(measured), 1, 1)), stated
        assert self.weights is not None
        return ray_axes(measured), self.weights.sigmas(measured[:, 2])

    @property
    def sigmas(self) -> FloatArray:
        """(n, d) standard deviations of the residual before the factor that is learnt, m."""
        return self.scatter[1]

    @property
    def relative(self) -> FloatArray:
        """(n, d) `sigmas`, over what is typical."""
        assert self.typical_sigma is not None
        return np.asarray(self.sigmas / self.typical_sigma)

    def by_distance(self, block: Block) -> Block:
        """A block whose residual has been divided by `relative`."""
        assert self.typical_sigma is not None
        # However many points a cloud has, no camera and no arm errs by less.
        least = 1e-4
        assumed = max(self.typical_sigma, least)
        return replace(block, relative=self.relative, typical=self.typical_sigma, assumed=assumed)

    def simulated_axes(self, seen: FloatArray) -> FloatArray | None:
        """Axes (n, 3, 3) in which points that are simulated scatter."""
        stated = self.poses.samples.position_sigma is not None
        return None if stated else ray_axes(seen)

    # ── what is refused, or doubted ───────────────────────────────────────────────────────────
    def check_enough(self) -> None:
        """Three pictures at least, in m."""
        pictures = len(np.unique(self.picture))
        if pictures < FEWEST:
            expected = f"at least {FEWEST}, with the hand turned about different axes"
            raise self.refuse(f"{self.mark}s at {pictures} postures", expected)
        self.check_marks()

    def check_marks(self) -> None:
        """Refuse what was seen too rarely to be of use, or in another unit."""
        names, which = self.seen
        for k, name in enumerate(names):
            if len(np.unique(self.picture[which == k])) < 2:
                raise self.refuse(
                    f"{self.mark} {name} seen once",
                    f"every {self.mark} seen at least twice, because its place is unknown",
                    hint="is its label misspelt?",
                )
        measured = self.in_eye
        away = float(np.median(np.linalg.norm(measured, axis=1)))
        if isinstance(self.poses, ArmPoses) and not NEAR <= away <= FAR:
            expected = "the points' positions in the camera, in m"
            check_unit(self, "the points", extent(measured), extent, expected, SEEN_UNIT)
        self._check_step()

    def _check_step(self) -> None:
        """Refuse depths that fit the arm in another step, and not as they are."""
        off, away = self._misfit(1.0), float(np.median(np.linalg.norm(self.in_eye, axis=1)))
        # So much of the distance is no error of an arm, nor of a camera.
        if off < 0.05 * away:
            return
        # Steps of depth are 1, 0.25, 0.2 or 0.1 mm: how many times as far away points are by
        # another one.
        better = {factor: self._misfit(factor) for factor in (0.1, 0.2, 0.25, 4.0, 5.0, 10.0)}
        best = min(better, key=lambda factor: better[factor])
        # What fits five times better is no chance.
        if better[best] < 0.2 * off:
            raise self.refuse(
                f"{self.mark}s that differ from where the arm has them by {mm(off):.3g} mm, and by "
                f"{mm(better[best]):.3g} mm if all are {best:g} times as far away",
                "points in m",
                hint="one step of the depth has another length: give it with --unit where the "
                "clouds are read (suta-calib balls, planes), or with --depth-unit (detect)",
            )

    def _misfit(self, factor: float) -> float:
        """Middle distance of what was seen, so many times as far away, from the closed form, m."""
        samples = replace(self.poses.samples, position=self.in_eye * factor)
        term = replace(self, poses=self.poses.with_samples(samples))
        expected = term.observed(term.start_values({}), term.poses).place
        return float(np.median(np.linalg.norm(expected - term.in_eye, axis=1)))

    @property
    def doubts(self) -> Mapping[str, Level]:
        """Points behind the camera or beside it."""
        measured = self.in_eye
        ahead = measured[:, 2] > np.linalg.norm(measured[:, :2], axis=1) / 2.0
        if ahead.mean() >= 0.5:
            return {}
        x_ahead = measured[:, 0] > np.linalg.norm(measured[:, 1:], axis=1) / 2.0
        looks = (
            "They look like a camera's body axes (x ahead, y left, z up), as ROS has them "
            "beside the optical ones"
            if x_ahead.mean() > 0.5
            else "No depth camera looks there"
        )
        return {
            f"{np.mean(~ahead):.0%} of the points are not in front of the camera (z ahead). "
            f"{looks}: the pose of the camera is then that of this other frame, and the noise "
            "by distance is wrong. Give the points in the optical frame: x to the right, y "
            "down, z ahead.": "care"
        }

    @property
    def misread(self) -> Iterator[tuple[str, Term]]:
        """Mirrored."""
        samples = self.poses.samples
        if samples.position is None:
            return
        again = replace(samples, position=samples.position * [-1.0, 1.0, 1.0])
        # Learnt anew: what is read in another way scatters in another way.
        yield (
            "x has the other sign: the pictures, or the clouds, are mirrored",
            replace(self, poses=self.poses.with_samples(again), weights=None, typical_sigma=None),
        )


def with_seen(poses: PoseSource, seen: SeenPoints, mark: str) -> PoseSource:
    """A row for each point that was seen in the picture of a row; pictures by their names."""
    images = [str(name) for name in poses.samples.labels["image"]]
    rows: dict[str, list[int]] = {}
    for k, name in enumerate(seen.image.tolist()):
        rows.setdefault(name, []).append(k)
    pairs = [(row, k) for row, name in enumerate(images) for k in rows.get(name, [])]
    if not pairs:
        raise SamplesError(
            f"images {listed([*dict.fromkeys(images)], 3)} in the samples and "
            f"{listed([*rows], 3)} in the {mark}s",
            "the same names in both",
            file=seen.path,
            where="column 'image'",
        )
    lost = [name for name in dict.fromkeys(images) if name not in rows]
    if lost:
        warnings.warn(
            f"{seen.path or f'{mark}s'}: no {mark}s of {len(lost)} of {len({*images})} images "
            f"({listed(lost, 3)}): they are left out",
            SutaCalibWarning,
            stacklevel=2,
        )
    row, seen_row = np.array(pairs, dtype=np.intp).T
    samples = poses.samples.take(row)
    samples = replace(
        samples,
        position=seen.position[seen_row],
        position_sigma=None if seen.sigma is None else seen.sigma[seen_row],
        labels={**samples.labels, mark: seen.point[seen_row]},
        origin=[seen.origin(k) for k in seen_row.tolist()],
    )
    return poses.take(row).with_samples(samples)
