"""A line scanner on the tip sees a ball or a plane: the profiles that it measured in its plane."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import casadi as ca
import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.assessment import Level
from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.geometry.numbers import rotation_from_vector, vector_turning_z_to
from suta_calib.geometry.symbols import Symbol, symbolic_rotation
from suta_calib.measurements import SampleColumns, YamlSection
from suta_calib.measurements.fields import FILE, FLAG, LENGTH, TEXT, Field, Value, whole_number
from suta_calib.measurements.profiles import Profiles, read_profiles
from suta_calib.measurements.scale import LengthScale
from suta_calib.model.parameters import PLACEMENT, POSITION, Parameter
from suta_calib.terms.block import LEARNT, Block, Noise, Pose, Residual, pose_of
from suta_calib.terms.external_frame import (
    ExternalFrame,
    labelled,
    point_named,
    point_parameters,
    pose_named,
    pose_parameters,
    pose_values,
)
from suta_calib.terms.given_pose import GivenPose, PriorValue
from suta_calib.terms.instrument_terms import FramedTerm
from suta_calib.terms.observed import Observed, Resimulation, TrueFrame
from suta_calib.terms.plane import PlaneFrame
from suta_calib.terms.poses import PoseSource
from suta_calib.terms.profile_fit import causes, fit_scans, model_of
from suta_calib.terms.profile_rows import with_profiles
from suta_calib.terms.profile_start import (
    arcs_of,
    ends_of,
    in_scanner,
    scanner_by_ball,
    scanner_by_plane,
)
from suta_calib.terms.setup import Setup
from suta_calib.terms.term import Gap, Term
from suta_calib.units import from_mm, mm


def _ball(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """Where an arc has the ball's centre, from it; the radius is last, where unknown.

    Beside the scanner's plane by squares, which have no sign: ``(R² - r² - y²) / 2 y_0``.
    """
    eye = pose_of(unknowns[0:6])
    centre = eye.inverse_act(poses[0].inverse_act(unknowns[6:9]))
    radius = unknowns[9] if unknowns.numel() > 9 else data[4]
    aside = (radius**2 - data[2] ** 2 - centre[1] ** 2) / data[3]
    return ca.vertcat(data[0] - centre[0], aside, data[1] - centre[2])


def _plane(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """Heights of both ends of a piece of a line over the plane ``nᵀ x = z``."""
    eye = pose_of(unknowns[0:6])
    normal = symbolic_rotation(ca.vertcat(unknowns[7], unknowns[8], 0))[:, 2]
    in_hand, height = poses[0].R.T @ normal, ca.dot(normal, poses[0].p) - unknowns[6]
    ends = (eye.R @ ca.vertcat(data[k], 0, data[k + 1]) + eye.p for k in (0, 2))
    return ca.vertcat(*(ca.dot(in_hand, end) + height for end in ends))


def _reach(section: YamlSection, name: str) -> tuple[float, float]:
    near, far = section.numbers(name, 2)
    if not 0 <= near < far:
        raise section.refuse(f"[{near:g}, {far:g}]", "nearest and farthest, in mm", at=(name,))
    return from_mm(near), from_mm(far)


@dataclass(frozen=True, eq=False, repr=False)
class Profile(FramedTerm):
    """``X⁻¹ T_base_hand,i⁻¹ s - c`` for every profile i, but for the sign of y.

    X = ``T_hand_eye`` is the scanner on the tip, s the centre of a ball of radius R that stands
    somewhere, c where the profile has it: the centre of the arc, and beside the scanner's plane by
    ``√(R² - r²)`` with r the arc's radius. Of a plane it is the height over it of both ends of the
    piece of a line. All points of a profile share where the arm really was, so that a profile
    counts as the few numbers that it shows.

    Attributes:
        poses: samples, one for each profile, with the points that are on the surface.
        radius: of the ball, m; None where it is unknown too.
        plane: whether a plane was seen, not a ball.
        free: whether the radius is estimated though one is said.
        noise: scatter and robustness of a coordinate of c, or of a height, m.
        label: terms with the same label share the scanner.
        target: terms with the same one share the ball, or the plane.
        field, reach, points: width of the line, m, nearest and farthest distance, m, and number of
            points of a profile that is simulated.

    Raises:
        SamplesError: no point on a surface.
    """

    kind = "profile"
    order = 14
    about = (
        "a line scanner on the tip saw a ball (sphere_radius_mm: its radius) or a plane (plane: "
        "true) that stands anywhere: the profiles that it measured"
    )
    columns = SampleColumns(
        labels=("scan",), pixels=True, about={"scan": "The profile that was measured there."}
    )
    medium = "camera"
    # As makers state it: 0.01 to 0.1 % of what a scanner can see.
    assumed_scale = LengthScale.of_grade("machined")
    has_angles = False
    keys = (
        Field("profiles", FILE, "The scanner's points: profiles.csv.", True),
        Field(
            "sphere_radius_mm",
            LENGTH,
            "Radius of the ball; without it (and without plane) the radius is unknown too.",
            given_attribute="radius",
        ),
        Field("plane", FLAG, "true where a plane was scanned, not a ball."),
        Field("target", TEXT, "Label of the ball or plane, where there are several."),
    )
    measured_keys = ("profiles", "target")
    simulation_keys = (
        Field("field_mm", LENGTH, "Width of the scanner's line; default 100."),
        Field(
            "reach_mm",
            Value("nearest, farthest in mm", _reach),
            "Distances at which the scanner sees; default [50, 500].",
            given_attribute="reach",
        ),
        Field("points", whole_number(20, 4096), "Points of a profile; default 30."),
    )
    files: ClassVar[Mapping[str, str]] = {"profiles.csv": "scan,x_mm,z_mm\n"}
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {"scan": ("scan",)}
    frames = (
        TrueFrame("hand_eye", "scanner_in_tip", "pose of the scanner on the tip", required=True),
        TrueFrame(
            *("sphere", "target_in_base"),
            "centre of the ball in the base; or a plane, with the z axis along its normal",
            required=True,
        ),
    )
    chance = 2e-3
    assumptions_key = "no sphere_radius_mm"
    leaves_open: ClassVar[Mapping[Gap, tuple[str, str]]] = {
        "tool": (
            "moves the tip in the last link. The scanner does not see this, because its unknown "
            "pose on the tip cancels it",
            "touch one fixed point from several directions (fixed_point); not needed if only the "
            "scanner matters",
        )
    }

    radius: float | None = None
    plane: bool = False
    free: bool = False
    noise: Noise = LEARNT
    label: str = "default"
    target: str = "default"
    field: float = 0.1
    reach: tuple[float, float] = (0.05, 0.5)
    points: int = 30

    def __post_init__(self) -> None:
        if self.plane and self.radius is not None:
            raise self.refuse(
                "sphere_radius_mm beside plane: true", "a ball or a plane", "remove one of them"
            )
        if self.radius is not None and not 0.0 < self.radius < np.inf:
            raise self.refuse(f"a radius of {self.radius:g}", "a radius in m, greater than 0")
        super().__post_init__()

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> Profile:
        """Build it from a row of a job file.

        Raises:
            InputError: profiles that cannot be used, or that belong to no sample.
        """
        given = dict(setup.settings)
        profiles = given.pop("profiles", None)
        attributes: dict[str, Any] = {"noise": setup.noise, "label": setup.label, **given}
        if profiles is None:
            return cls(poses, **attributes)
        return cls.of_profiles(poses, read_profiles(profiles), **attributes)

    @classmethod
    def over_arrays(cls, poses: PoseSource, given: Mapping[str, Any]) -> Self:
        """Build it from arrays, as from files: of every profile the points on the surface count."""
        pixels, scans = poses.samples.pixels, poses.samples.labels["scan"]
        assert pixels is not None
        row, point = np.nonzero(np.isfinite(pixels).all(axis=2))
        term = cls.of_profiles(poses, Profiles(scans[row], pixels[row, point]), **given)
        term.check_given()
        return term

    @classmethod
    def of_profiles(cls, poses: PoseSource, profiles: Profiles, **more: Any) -> Self:
        """Over the poses of scans, with those of their points that are on the ball or the plane.

        Args:
            poses: with the label ``scan``.
            profiles: of any scans.
            more: attributes.

        Raises:
            SamplesError: profiles that show no ball or plane, or that belong to no sample.
        """
        radius, plane = more.get("radius"), more.get("plane", False)
        poses, lost = with_profiles(poses, profiles, radius, plane=plane)
        if lost:
            warnings.warn(lost, SutaCalibWarning, stacklevel=2)
        return cls(poses, **more)

    @classmethod
    def read_settings(cls, row: YamlSection) -> dict[str, Any]:
        """What was scanned; refused where both are said, or where a simulation says neither."""
        settings = super().read_settings(row)
        ball, plane = "sphere_radius_mm" in row, settings.get("plane", False)
        if ball and plane:
            found = "sphere_radius_mm beside plane: true"
            raise row.refuse(found, "a ball or a plane", at=("plane",), hint="remove one of them")
        if not (ball or plane or "profiles" in row):
            hint = "a ball that is simulated has a known radius"
            raise row.refuse("no ball and no plane", "sphere_radius_mm or plane: true", hint=hint)
        return settings

    @property
    def settings(self) -> Mapping[str, Any]:
        """What was scanned, by which scanner."""
        names = ("radius", "plane", "free", "target", "field", "reach", "points")
        return {name: getattr(self, name) for name in names}

    @property
    def with_assumptions_estimated(self) -> Self | None:
        """The same with the ball's radius unknown."""
        return None if self._sized else replace(self, free=True)

    @property
    def _sized(self) -> bool:
        """Whether the radius of a ball is an unknown."""
        return not self.plane and (self.radius is None or self.free)

    @classmethod
    def measures_lengths(cls) -> bool:
        """A scanner does."""
        return True

    @property
    def frame_names(self) -> list[str]:
        """Owners of the scanner's pose and of the ball's, or the plane's."""
        label = self.poses.label(self.target, "base")
        return [
            labelled("hand_eye", self.sees),
            labelled("plane" if self.plane else "sphere", label),
        ]

    @property
    def outside(self) -> tuple[ExternalFrame, ...]:
        """The scanner in the tip, the ball or the plane in the base."""
        eye, target = self.frame_names
        return (
            ExternalFrame(eye, "scanner", "tip", PLACEMENT),
            PlaneFrame(target, "plane", "base", ("z", "rx", "ry"))
            if self.plane
            else ExternalFrame(target, "ball", "base", POSITION),
        )

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The scanner's pose, and the ball's centre, with its radius where unknown, or a plane."""
        eye, target = self.frame_names
        if self.plane:
            every = pose_parameters(target)
            target_parameters = tuple(p for p in every if p.key in ("z", "rx", "ry"))
            return (*pose_parameters(eye), *target_parameters)
        target_parameters = point_parameters(target)
        if self._sized:
            # From no ball to the largest that anybody scans.
            size = Parameter(target, "radius", "m", self.radius or 0.01, 0.0, 2.0, plausible=0.05)
            target_parameters = (*target_parameters, size)
        return (*pose_parameters(eye), *target_parameters)

    def prior_from_pose(self, label: str, pose: GivenPose) -> dict[str, PriorValue]:
        """As of any frame; of a ball its centre, of a plane any point of it and its normal."""
        if label != self.frames[1].key:
            return super().prior_from_pose(label, pose)
        owner = self.frame_names[1]
        if self.plane:
            return pose.of_axis(owner, 2, ("z",))
        return {n: v for n, v in pose.of_pose(owner).items() if n.rpartition(".")[2] in POSITION}

    @cached_property
    def pixels(self) -> FloatArray:
        """(n, points, 2) x and z of the samples, m; the origin where nobody has looked."""
        pixels = self.poses.samples.pixels
        return np.zeros((len(self.poses), 1, 2)) if pixels is None else pixels

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The ball's centre or both heights over the plane, one row for each profile."""
        names = self.poses.samples.labels.get("scan", self.poses.samples.origin)
        labels = [f"scan {name}" for name in names]
        if self.plane:
            block = self._block(2, _plane, self._ends.reshape(-1, 4), labels)
            return (block,)
        columns = [self._arcs, (2.0 * self._aside * self._relative[:, 1])[:, None]]
        if not self._sized:
            columns.append(np.full((len(labels), 1), self.radius))
        block = self._block(3, _ball, np.hstack(columns), labels)
        return (replace(block, relative=self._relative),)

    def _block(self, size: int, residual: Residual, seen: FloatArray, labels: list[str]) -> Block:
        own_columns = np.tile(np.arange(len(self.own_parameters)), (len(seen), 1))
        return Block.per_sample(
            "surface", "m", size, residual, own_columns, seen, self.noise, labels
        )

    @cached_property
    def _arcs(self) -> FloatArray:
        """(n, 3) x and z of the centre of each arc, and its radius, m; any where none is seen."""
        arcs = np.zeros((len(self.pixels), 3))
        arcs[:, 2] = 0.7 * (self.radius or 0.01)
        arcs[self._told] = arcs_of(self.pixels[self._told])
        return arcs

    @cached_property
    def _ends(self) -> FloatArray:
        """(n, 2, 2) both ends of the piece of a line that each profile shows, m."""
        ends = np.zeros((len(self.pixels), 2, 2))
        ends[self._told] = ends_of(self.pixels[self._told])
        return ends

    @cached_property
    def _relative(self) -> FloatArray:
        """(n, 3) how much worse than across an arc tells where the ball's centre is.

        The distance from the scanner's plane follows from the radius of the arc, hardly where the
        ball is cut in its middle.
        """
        relative = np.ones((len(self._arcs), 3))
        # What an arc's radius scatters by, over what its centre does: by the hand, which moves the
        # centre.
        relative[:, 1] = np.hypot(1.0, 0.3 * self._arcs[:, 2] / self._aside)
        return relative

    @cached_property
    def _aside(self) -> FloatArray:
        """(n,) distance of the ball's centre from the scanner's plane as arcs have it, m.

        Of an unknown ball as of one that is hardly larger than the largest arc.
        """
        section = self._arcs[:, 2]
        radius = self.radius or 1.01 * float(section.max(initial=1e-3))
        # Of the radius: how far a ball's centre is beside the scanner's plane is not told better
        # than this.
        return np.sqrt(np.maximum(radius**2 - section**2, (0.1 * radius) ** 2))

    def _centres(self, values: Mapping[str, float], poses: PoseSource) -> FloatArray:
        """(n, 3) of the ball in the scanner, m."""
        eye, ball = self.frame_names
        (turn, shift), centre = pose_named(values, eye), point_named(values, ball)
        rotation, position = poses.at(values)
        in_hand = np.einsum("nji,nj->ni", rotation, centre - position)
        return np.asarray((in_hand - shift) @ turn)

    def _sides(self, values: Mapping[str, float], poses: PoseSource) -> tuple[FloatArray, ...]:
        """(n, 3) normal of the plane in the scanner, and (n,) height of the scanner over it, m."""
        eye, plane = self.frame_names
        turn, shift = pose_named(values, eye)
        z, rx, ry = (values[f"{plane}.{key}"] for key in ("z", "rx", "ry"))
        normal = rotation_from_vector([rx, ry, 0.0])[:, 2]
        rotation, position = poses.at(values)
        in_eye = np.einsum("nji,j->ni", rotation @ turn, normal)
        return in_eye, (position + rotation @ shift) @ normal - z

    def scanned_points(self, values: Mapping[str, float]) -> FloatArray:
        """The points of all profiles."""
        scan, point = np.nonzero(np.isfinite(self.pixels).all(axis=2))
        turn, shift = pose_named(values, self.frame_names[0])
        rotation, position = self.poses.at(values)
        in_hand = in_scanner(self.pixels[scan, point]) @ turn.T + shift
        return np.asarray(np.einsum("nij,nj->ni", rotation[scan], in_hand) + position[scan])

    def _radius(self, values: Mapping[str, float]) -> float:
        if self.radius is not None and not self._sized:
            return self.radius
        return abs(values[f"{self.frame_names[1]}.radius"])

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The profile that a scanner sees; NaN where nothing of it is in its field."""
        across, (near, far) = np.linspace(-0.5, 0.5, self.points) * self.field, self.reach
        if self.plane:
            x = np.broadcast_to(across, (len(poses), self.points))
            z, slope = self._heights(values, poses, x)
            # Part along the beam of a plane's normal, below which a scanner does not see it.
            in_sight = np.all((z > near) & (z < far), axis=1) & (np.abs(slope) > 0.3)
            place = np.column_stack([np.zeros(len(z)), np.zeros(len(z)), z.mean(axis=1)])
            pixels = np.where(in_sight[:, None, None], np.stack([x, z], axis=2), np.nan)
        else:
            place = self._centres(values, poses)
            pixels = self._profile(place, self._radius(values))
        return Observed(place, None, pixels)

    def _profile(self, place: FloatArray, radius: float) -> FloatArray:
        """(n, points, 2) of a ball whose centres are these (n, 3) in the scanner."""
        (near, far), arc = self.reach, np.sqrt(np.maximum(radius**2 - place[:, 1] ** 2, 0.0))
        # Of the radius, what a simulated scanner sees of an arc to either side: 60°.
        left, right = (
            np.clip(place[:, 0] + side * 0.866 * arc, -self.field / 2, self.field / 2)
            for side in (-1.0, 1.0)
        )
        x = left[:, None] + (right - left)[:, None] * np.linspace(0, 1, self.points)
        z = self._arc(place, arc, x, -np.ones(len(place)))
        # A sliver of a ball, or a short part of an arc, is not measured.
        shown, nearest = np.minimum(arc, 0.5 * self.field), place[:, 2] - arc
        in_sight = (arc > 0.3 * radius) & (right - left > shown)
        in_sight &= (nearest > near) & (nearest < far)
        return np.where(in_sight[:, None, None], np.stack([x, z], axis=2), np.nan)

    def _heights(
        self, values: Mapping[str, float], poses: PoseSource, x: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(n, points) z of the plane at x, and (n,) part of its normal along the beam."""
        normal, height = self._sides(values, poses)
        slope = np.where(np.abs(normal[:, 2]) < 1e-6, 1e-6, normal[:, 2])
        return -(height[:, None] + normal[:, :1] * x) / slope[:, None], slope

    @staticmethod
    def _arc(place: FloatArray, arc: FloatArray, x: FloatArray, side: FloatArray) -> FloatArray:
        """(n, points) z of the ball at x, on the side of smaller (-1) or larger z; else NaN."""
        aside = x - place[:, :1]
        # Of the radius of an arc: from there on a ball shows no more than an edge.
        inside = np.abs(aside) <= 0.97 * arc[:, None]
        rise = np.sqrt(np.maximum(arc[:, None] ** 2 - aside**2, 0.0))
        return np.where(inside, place[:, 2:] + side[:, None] * rise, np.nan)

    def resimulated(
        self, values: Mapping[str, float], noise: Sequence[float], again: Resimulation
    ) -> Self:
        """The surface at the same places along the line, or the whole profile where there is none.

        What the hand errs moves all points of a profile.
        """
        measured = self.poses.samples.pixels
        nowhere = Observed(np.zeros((len(self.poses), 3)))
        relative = np.ones((1, 3)) if self.plane else self._relative
        moved = again.observed(self.poses, nowhere, {"position": noise[0]}, relative)
        off = moved.samples.position
        assert off is not None
        if self.plane:
            pixels = self._plane_again(values, measured, off)
        else:
            centre, radius = self._centres(values, self.poses) + off, self._radius(values)
            pixels = self._profile(centre, radius)
            if measured is not None:
                arc = np.sqrt(np.maximum(radius**2 - centre[:, 1] ** 2, 0.0))
                side = np.sign(np.nanmean(measured[..., 1], axis=1) - centre[:, 2])
                z = self._arc(centre, arc, measured[..., 0], side)
                x = np.where(np.isfinite(z), measured[..., 0], np.nan)
                pixels = np.stack([x, z], axis=2)
        samples = replace(self.poses.samples, pixels=pixels)
        return self.over_poses(self.poses.with_samples(samples))

    def _plane_again(
        self, values: Mapping[str, float], measured: FloatArray | None, off: FloatArray
    ) -> FloatArray:
        """(n, points, 2) of the plane, both ends of whose pieces are off by (n, 2), m."""
        if measured is None:
            pixels = self.observed(values, self.poses).pixels
            assert pixels is not None
        else:
            pixels = measured.copy()
        z, slope = self._heights(values, self.poses, pixels[..., 0])
        x = np.ma.masked_invalid(pixels[..., 0])
        along = (x - x.mean(axis=1, keepdims=True)) / x.std(axis=1, keepdims=True)
        along = np.ma.filled(along, np.nan)
        ends = (off[:, :1] + off[:, 1:2] * along) / np.sqrt(2.0)
        pixels[..., 1] = z + ends / np.abs(slope)[:, None]
        return pixels

    @cached_property
    def _told(self) -> BoolArray:
        """(n,) profiles with points enough to tell an arc, or a line."""
        return np.asarray(np.isfinite(self.pixels).all(axis=2).sum(axis=1) >= 3)

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Arcs, or pieces of lines, in closed form; then from rotations all over."""
        usable, size = self._told, [self.radius or 0.01] if self._sized else []
        if not usable.any():
            return np.concatenate([np.zeros(9), size])
        hand = rotation[usable], position[usable]
        if self.plane:
            X, normal, z = scanner_by_plane(hand, self._ends[usable])
            target = np.array([z, *vector_turning_z_to(normal)[:2]])
        else:
            radius_given = None if self._sized else self.radius
            X, centre, radius = scanner_by_ball(hand, self._arcs[usable], radius_given)
            target = np.concatenate([centre, [min(radius, 2.0) for _ in size]])
        return np.asarray(np.nan_to_num(np.concatenate([pose_values(*X), target])))

    def check_enough(self) -> None:
        """As many profiles as the unknowns need, and one that checks them."""
        unknowns, per_scan = len(self.own_parameters), 2 if self.plane else 3
        fewest = -(-unknowns // per_scan) + 1
        if (count := int(self._told.sum())) < fewest:
            what = "plane" if self.plane else "ball"
            raise self.refuse(
                f"{count} profiles of the {what}",
                f"at least {fewest}, with the scanner turned about different axes",
                hint="a profile gives "
                + ("two numbers" if self.plane else "three numbers")
                + f", and there are {unknowns} unknowns",
            )

    def check_beside(self, other: Term) -> None:
        """Rows with one target are of one ball, or of one plane."""
        if not isinstance(other, Profile) or other.frame_names[1] != self.frame_names[1]:
            return
        if self.radius != other.radius:
            here, there = (
                "unknown" if r is None else f"{mm(r):g} mm" for r in (self.radius, other.radius)
            )
            raise SamplesError(
                f"a radius of {here}; an earlier row with target '{self.target}' has {there}",
                "one ball per target",
                where=f"{self.kind}.sphere_radius_mm",
                hint="write the same in both rows, or give the second one another target",
            )

    @property
    def doubts(self) -> Mapping[str, Level]:
        """Scans that agree with the others if they are turned, or exchanged."""
        usable, fewest = np.flatnonzero(self._told), 6
        if self.poses.samples.pixels is None or len(usable) < fewest:
            return {}
        rotation, position = self.poses.at({})
        points = [p[np.isfinite(p).all(axis=1)] for p in self.pixels[usable]]
        radius = None if self._sized else self.radius
        model = model_of((rotation[usable], position[usable]), points, radius, plane=self.plane)
        names = self.poses.samples.labels.get("scan", np.array(self.poses.samples.origin))[usable]
        level: Level = "care" if np.isfinite(self.noise.huber) else "bad"
        return dict.fromkeys(causes(fit_scans(model), names.tolist()), level)

    @property
    def misread(self) -> Iterator[tuple[str, Self]]:
        """With a radius for a diameter, or the other way round."""
        if self.radius is None or self._sized or self.poses.samples.pixels is None:
            return
        given = f"{mm(self.radius):g} mm is"
        for sentence, factor in (
            (f"{given} the diameter of the ball, not its radius.", 0.5),
            (f"{given} half the radius of the ball.", 2.0),
        ):
            yield sentence, replace(self, radius=factor * self.radius)
