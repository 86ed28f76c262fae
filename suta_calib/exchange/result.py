"""Reads a written result: the arm, its values, and the poses that were estimated."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.analysis.comparison import check_nominal
from suta_calib.arrays import FloatArray
from suta_calib.assessment import refuse_unusable, says_usable
from suta_calib.display import Displayable
from suta_calib.errors import InputError
from suta_calib.exchange.cells import is_folder
from suta_calib.exchange.rotations import is_rotation
from suta_calib.geometry.lens import LENSES, lens_called
from suta_calib.geometry.numbers import homogeneous, rotation_from_rpy
from suta_calib.inputs import UrdfFile
from suta_calib.job.schema import JobSpec, read_job
from suta_calib.measurements.camera import Camera, read_camera
from suta_calib.model.arm import ArmModel
from suta_calib.model.bodies import Bodies
from suta_calib.model.chain import Chain, ChainJoint
from suta_calib.model.robot import AnyArm
from suta_calib.pose_calibration.eye_poses import FRAMES
from suta_calib.terms.external_frame import labelled
from suta_calib.tracking.provenance import arm_of_job, made_from
from suta_calib.tracking.uncertainty import (
    CalibrationUncertainty,
    numbers,
    read_json_object,
    read_uncertainty,
)
from suta_calib.units import from_mm
from suta_calib.words import listed

RECORD: Final = "result.json"
# Of a folder, the first of these that is in it.
_RECORDS: Final = (RECORD, "detect.json")


@dataclass(frozen=True, eq=False)
class Transform(Displayable):
    """A pose (4, 4), m, that does not move: ``T_parent_child``, by the names of the frames."""

    parent: str
    child: str
    matrix: FloatArray


@dataclass(frozen=True, eq=False)
class Step:
    """What a chain passes: a joint that moves about or along its axis, then a fixed transform.

    The chain's pose is the product of all steps: ``before · motion(axis, reading)``.

    Attributes:
        joint: as the URDF has it.
        before: (4, 4) fixed transform in front of the motion.
        axis: (3,) of the motion; turned about where the chain climbs.
    """

    joint: ChainJoint
    before: FloatArray
    axis: FloatArray


@dataclass(frozen=True, eq=False)
class CalibratedArm:
    """An arm at nominal with the values, and their covariance, that a calibration found.

    Attributes:
        model: the arm, or the robot with its chains.
        calibration: what was found.
        chain: of several chains the one that a format of a single chain is about.
    """

    model: AnyArm
    calibration: CalibrationUncertainty
    chain: str = ""

    @property
    def alone(self) -> ArmModel:
        """The only chain, or the one that was chosen.

        Raises:
            ParameterError: there are several, and none of them was.
        """
        return self.model.chosen(self.chain)

    @property
    def values(self) -> Mapping[str, float]:
        """By parameter's name, those of no geometry included."""
        return self.calibration.values

    @cached_property
    def origins(self) -> dict[str, FloatArray]:
        """(4, 4) of each joint's own origin, by its name, with offsets folded in."""
        return {
            name: homogeneous(rotation_from_rpy(rpy), xyz)
            for name, (xyz, rpy) in self.model.origins(self.values).items()
        }

    def steps(self, chain: Chain) -> tuple[list[Step], FloatArray]:
        """A chain from base to tip, and the fixed transform (4, 4) that is left at its end."""
        pose, steps = np.eye(4), list[Step]()
        for joint in chain.joints:
            origin = self.origins[joint.name]
            if not joint.climbed:
                pose = pose @ origin
            if joint.moving:
                steps.append(Step(joint, pose, -joint.axis if joint.climbed else joint.axis))
                pose = np.eye(4)
            if joint.climbed:
                pose = pose @ np.linalg.inv(origin)
        return steps, pose

    @cached_property
    def tools(self) -> tuple[Transform, ...]:
        """Each tip in the link of the last joint of its chain that moves."""
        ends = ((chain, *self.steps(chain)) for chain in self.model.chained)
        return tuple(
            Transform(steps[-1].joint.child if steps else "base", chain.tip, end)
            for chain, steps, end in ends
        )

    def frame(self, what: str, label: str) -> str:
        """What the URDF calls a frame of a result, or a name with the label of what is none."""
        if what not in ("base", "tip"):
            return f"{what}_{label}" if label else what
        body = label.partition("/")[0]
        if isinstance(self.model, ArmModel):
            return self.model.chain.base if what == "base" else self.model.tip
        chains = self.model.chains
        if body in chains:
            return chains[body].tip
        first = next(iter(chains.values()))
        return first.chain.base if what == "base" else first.tip


@dataclass(frozen=True, eq=False)
class Result(Displayable):
    """A result as it was written.

    Attributes:
        path: the ``result.json``.
        arm: of a calibration; None for a closed problem.
        transforms: poses that it found: of cameras, instruments and artefacts, of a tool.
        cameras: by their labels, with the intrinsics that were found.
        data: the JSON itself.
        unsized: further cameras, of whose pictures nothing says the size: theirs is 0.
    """

    path: Path
    arm: CalibratedArm | None
    transforms: tuple[Transform, ...]
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    data: Mapping[str, Any] = field(default_factory=dict)
    unsized: Mapping[str, Camera] = field(default_factory=dict)

    @property
    def usable(self) -> bool:
        """Whether its verdict allows its use."""
        return says_usable(self.data)

    def need_arm(self, form: str) -> CalibratedArm:
        """The arm, for a format that needs one."""
        if self.arm is None:
            problem = f"no calibrated arm, which the format {form} needs"
            raise InputError(problem, "the result of suta-calib calibrate", file=self.path)
        return self.arm

    @property
    def every_transform(self) -> tuple[Transform, ...]:
        """`transforms`, and that of the arm's tool, or of each chain's."""
        return (*self.transforms, *(() if self.arm is None else self.arm.tools))

    def need_cameras(self, form: str, size: tuple[int, int] | None = None) -> Mapping[str, Camera]:
        """The cameras by their labels, at least one, for a format that needs them.

        Args:
            form: name of the format.
            size: width and height of the pictures, px, where the result does not say them.
        """
        if self.unsized and size is None:
            raise InputError(
                f"camera {listed(sorted(self.unsized))}, of whose pictures nothing says the size",
                "a camera with image_width and image_height",
                file=self.path,
                hint="give it (--picture-size WxH); or calibrate with --camera",
            )
        if size is not None and not self.unsized:
            problem = "the size of the pictures, which the cameras of the result say themselves"
            raise InputError(problem, "no --picture-size", file=self.path)
        width, height = size or (0, 0)
        told = {
            label: replace(camera, width=width, height=height)
            for label, camera in self.unsized.items()
        }
        for label, camera in told.items():
            if not camera.inside(camera.intrinsics[None, 2:4]).all():
                u, v = camera.intrinsics[2:4]
                raise InputError(
                    f"{width} x {height} px, but the principal point of camera {label} at "
                    f"({u:.0f}, {v:.0f})",
                    "the size of the pictures that were taken",
                    where="--picture-size",
                )
        if not (self.cameras or told):
            problem = f"no camera, which the format {form} needs"
            raise InputError(problem, "the result of a job with a camera", file=self.path)
        return {**self.cameras, **told}

    def need_transforms(self, form: str) -> tuple[Transform, ...]:
        """`every_transform`, at least one, for a format of poses."""
        if not self.every_transform:
            problem = f"no pose of a tool, camera or instrument, which the format {form} needs"
            raise InputError(problem, "a result with such a pose", file=self.path)
        return self.every_transform


def read_result(
    path: str | Path,
    *,
    urdf: str | UrdfFile | None = None,
    tip: str | None = None,
    base: str | None = None,
    chain: str = "",
    anyway: bool = False,
) -> Result:
    """Read a result, with the arm of its job.

    Args:
        path: ``result.json`` or ``detect.json``, the folder it is in, or a ``camera.yaml``.
        urdf: the nominal arm, where the job is not there any more.
        tip: its tip, likewise.
        base: link its chain starts at, likewise; the root by default.
        chain: of several chains of a robot the one that a format of a single chain is about.
        anyway: take an answer that says of itself that it must not be used.

    Raises:
        InputError: unreadable, no answer of this package, of another arm, or its inputs are gone.
        UnusableResultError: it must not be used.
    """
    path = Path(path)
    if path.suffix in (".yaml", ".yml"):
        return Result(path, None, (), {"default": replace(read_camera(path), covariance=None)})
    if is_folder(path):
        there = (path / name for name in _RECORDS if (path / name).is_file())
        path = next(there, path / RECORD)
    data = read_json_object(path)
    refuse_unusable(data, path, anyway=anyway)
    if "parameters" not in data:
        transforms, seen = tuple(_closed(data, path)), _recorded(data)
        if not (transforms or seen):
            expected = "the result of calibrate, hand-eye, rig, detect, pivot or register"
            raise InputError("a result that cannot be exported", expected, file=path)
        cameras = {name: _camera_of(row, path) for name, row in seen.items()}
        sized = {name: camera for name, camera in cameras.items() if camera.width}
        unsized = {name: camera for name, camera in cameras.items() if not camera.width}
        return Result(path, None, transforms, sized, data, unsized)
    job: JobSpec | None = None
    model: AnyArm
    if urdf is None:
        origin = made_from(data, path, "the nominal arm, given with --urdf and --tip")
        # The arm needs no samples, which may have been too large to be copied.
        job = None if origin.lacking else read_job(origin.path)
        model = arm_of_job(origin).mechanism()
    else:
        if tip is None:
            raise InputError("no tip", "the link or frame of the tip", where="--tip")
        model = ArmModel.from_urdf(urdf, tip, base)
    calibration = read_uncertainty(path, model, anyway=anyway)
    check_nominal(model, path, calibration.values)
    arm = CalibratedArm(model, calibration, chain)
    if chain:
        _ = arm.alone
    return Result(path, arm, tuple(_external(data, arm, path)), _cameras(data, job, path), data)


def _external(data: Mapping[str, Any], arm: CalibratedArm, path: Path) -> Iterator[Transform]:
    poses = data.get("external_poses")
    for name, pose in poses.items() if isinstance(poses, dict) else ():
        if not isinstance(pose, dict) or pose.get("matrix") is None:
            continue
        matrix = _pose(pose["matrix"], path, f"external_poses: {name}: matrix")
        # Of several placements or instruments each is a frame of its own.
        label = name.partition("[")[2].removesuffix("]")
        ends = (str(pose.get("within", "")), str(pose.get("what", name)))
        parent, child = (arm.frame(what, label) for what in ends)
        yield Transform(parent, child, matrix)


def _closed(data: Mapping[str, Any], path: Path) -> Iterator[Transform]:
    """The poses of hand-eye, pivot and register."""
    setups = [frames for setup, frames in FRAMES.items() if setup == data.get("setup")]
    for key, name in [*(row for frames in setups for row in frames.items()), ("T_b_a", "T_b_a")]:
        if key not in data:
            continue
        _, parent, child = name.split("_")
        if isinstance(by_name := data[key], dict):
            for label, pose in by_name.items():
                # None of what could not be found.
                if pose is not None:
                    matrix = _pose(pose, path, f"{key}: {label}")
                    yield Transform(parent, f"{child}_{label}", matrix)
            continue
        yield Transform(parent, child, _pose(data[key], path, key))
    if "tip_mm" in data:
        tip = from_mm(numbers(data["tip_mm"], (3,), path, "tip_mm"))
        yield Transform("tool", "tip", homogeneous(np.eye(3), tip))


def _recorded(data: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The cameras that hand-eye, rig and detect write, by their labels."""
    if not isinstance(several := data.get("cameras"), dict):
        several = {"default": data}
    eyes = data.get("X")
    rows: dict[str, Mapping[str, Any]] = {}
    for name, row in several.items():
        inner = row.get("camera", row) if isinstance(row, dict) else None
        if isinstance(inner, dict) and "distortion_model" in inner:
            # One that saw several boards is there once for each, as EYE/BOARD.
            known = not isinstance(eyes, dict) or name in eyes
            rows.setdefault(name if known else name.rpartition("/")[0], inner)
    return rows


def _camera_of(row: Mapping[str, Any], path: Path) -> Camera:
    """A camera as a record has it: the lens's numbers by name, or its distortion as a list."""
    lens = lens_called(str(row["distortion_model"]))
    if lens is None:
        problem = f"the lens {row['distortion_model']!r}"
        raise InputError(problem, f"one of {listed([*LENSES])}", file=path)
    by_name = dict(zip(lens.distortion, row.get("distortion", ()), strict=False)) | dict(row)
    values = [numbers(by_name.get(name), (), path, f"camera: {name}") for name in lens.names]
    sides = (row.get(side) or 0 for side in ("width", "height"))
    width, height = (int(numbers(side, (), path, "width, height")) for side in sides)
    return Camera(width, height, np.array(values, dtype=float), lens=lens)


def _pose(value: object, path: Path, where: str) -> FloatArray:
    """(4, 4) of a rigid motion, m."""
    matrix = numbers(value, (4, 4), path, where)
    if not (is_rotation(matrix[None, :3, :3]) and np.array_equal(matrix[3], [0, 0, 0, 1])):
        expected = "a rotation matrix and a position above 0, 0, 0, 1"
        raise InputError("numbers that are not a pose", expected, file=path, where=where)
    return matrix


def _cameras(data: Mapping[str, Any], job: JobSpec | None, path: Path) -> dict[str, Camera]:
    """The job's cameras with the intrinsics that were found; as they were where they were held."""
    parameters, cameras = data["parameters"], dict[str, Camera]()
    for row in () if job is None else job.observations:
        camera = next((given for given in row.settings.values() if isinstance(given, Camera)), None)
        if camera is None:
            continue
        # On one of several chains a camera has the name of what carries it before its own.
        bodies = dict.fromkeys((row.link, row.chain, row.base_chain, ""))
        labels = [Bodies(body, body).label(row.label, "tip") for body in bodies]
        found = (name for name in labels if f"{labelled('camera', name)}.fx" in parameters)
        label = next(found, "")
        if label:
            owner = labelled("camera", label)
            entries = ((key, parameters.get(f"{owner}.{key}", {})) for key in camera.lens.names)
            values = [numbers(e.get("value"), (), path, f"{owner}.{key}") for key, e in entries]
            camera = replace(camera, intrinsics=np.array(values, dtype=float), covariance=None)
        cameras.setdefault(label or labels[0], camera)
    return cameras


def json_bytes(data: Mapping[str, Any]) -> bytes:
    """A JSON file, numbers with all their digits."""
    return (json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def content_digest(record: Mapping[str, Any]) -> str:
    """SHA-256 of an answer as its JSON has it, but for places, times and ``run`` itself."""
    of_run = ("files", "timing_s", "run")
    kept = {key: value for key, value in record.items() if key not in of_run}
    return sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()
