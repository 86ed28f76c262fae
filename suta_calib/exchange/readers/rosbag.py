"""Recordings of ROS 1 and ROS 2 (.bag, a folder with .db3 or .mcap), read without ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.atomic import note_input
from suta_calib.errors import ForeignFileError, MissingExtraError
from suta_calib.exchange.cells import is_folder, is_plain_file
from suta_calib.exchange.clock import Between, Clock
from suta_calib.exchange.felt_gravity import POSTURES, GravityLog, check_unit
from suta_calib.exchange.imported import ImportedRows, checked_places
from suta_calib.exchange.moving_rows import MOVING, MovingRows, moving_arm
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.recorded_rests import (
    SECONDS,
    RecordedPicture,
    Rest,
    Seen,
    found_rests,
    imported_rests,
    seen_poses,
)
from suta_calib.exchange.ros_pictures import CAMERA_INFO, COMPRESSED, IMAGE, camera_of, pictures_at
from suta_calib.exchange.rotations import rotations_from
from suta_calib.exchange.table_roles import UNIT
from suta_calib.exchange.tracked_bodies import BODY, INVERT, PREFIX, REFERENCE, Body, Recording
from suta_calib.geometry.numbers import homogeneous, rotation_from_quaternion
from suta_calib.optional_packages import load
from suta_calib.words import listed

JOINT_TOPIC: Final = Option("joint_topic", "Topic of the joint states.", "/joint_states")
POSE_TOPIC: Final = Option("pose_topic", "Topic with the poses of a tracker or camera.", "/TOPIC")
IMAGE_TOPIC: Final = Option(
    "image_topic", "Topic with pictures; one picture of each rest is written to a file.", "/TOPIC"
)
IMU_TOPIC: Final = Option(
    "imu_topic",
    "Topic of an IMU (sensor_msgs/Imu) that felt gravity during the rests.",
    "/TOPIC",
)
_IMU: Final = "sensor_msgs/msg/Imu"
_JOINT_STATE: Final = "sensor_msgs/msg/JointState"
_TF: Final = "tf2_msgs/msg/TFMessage"
# Where the pose is in messages that hold one.
_POSES: Final = {
    "geometry_msgs/msg/PoseStamped": ("pose",),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose", "pose"),
    "geometry_msgs/msg/TransformStamped": ("transform",),
    "nav_msgs/msg/Odometry": ("pose", "pose"),
}


@dataclass(eq=False)
class _Bag:
    """What was read: by topic, and transforms in the order in which they came.

    Of cameras the first message, of pictures the names of their topics.
    """

    joints: dict[str, list[tuple[float, dict[str, float]]]] = field(default_factory=dict)
    poses: dict[str, list[tuple[float, list[float]]]] = field(default_factory=dict)
    transforms: list[tuple[float, str, str, list[float]]] = field(default_factory=list)
    cameras: dict[str, Any] = field(default_factory=dict)
    pictures: set[str] = field(default_factory=set)
    imus: dict[str, list[tuple[float, list[float]]]] = field(default_factory=dict)


class RosbagReader(Reader):
    """Rests of the joint states with the poses of a topic or of tf; or such poses alone."""

    name = "rosbag"
    summary = "ROS 1 and 2 recordings (.bag, .db3, MCAP): joint states, poses, tf, pictures, IMUs"
    example = "run_1 --format rosbag --body tool0 --reference tracker --out a.csv"
    options = (
        *(
            JOINT_TOPIC,
            POSE_TOPIC,
            IMAGE_TOPIC,
            IMU_TOPIC,
            BODY,
            REFERENCE,
            PREFIX,
            INVERT,
            SECONDS,
        ),
        *(POSTURES, UNIT, MOVING),
    )
    extra = "ros"

    def recognises(self, path: Path, head: str) -> bool:
        """A folder with metadata.yaml, a file of one, or the first line of a bag."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return head.startswith(("#ROSBAG V", "\ufffdMCAP0", "SQLite format 3"))

    def read(self, path: Path, given: Given) -> ImportedRows:
        """Rows for the rests where there are joint states, or else for every pose."""
        check_unit(given)
        bag = _read(path, self.extra)
        joints = _chosen(path, bag.joints, given, JOINT_TOPIC) if bag.joints else None
        poses = self._poses(path, bag, given)
        if joints is None:
            if IMAGE_TOPIC in given:
                problem = "pictures, but no joint states"
                expected = (
                    "a topic of sensor_msgs/JointState, because each picture belongs to a rest"
                )
                raise ForeignFileError(problem, expected, file=path)
            if poses is None and bag.imus:
                log = _felt(path, bag, given)
                return (
                    log.at_postures(self.name, given) if POSTURES in given else log.rows(self.name)
                )
            if poses is None:
                problem = "no joint states, and no selected poses"
                topics = listed(list(bag.poses)) or "none"
                hint = f"topics with poses: {topics}; --body and --reference are frames of tf"
                expected = "a topic of sensor_msgs/JointState, or poses"
                raise ForeignFileError(problem, expected, file=path, hint=hint)
            time, body = poses
            recording = Recording(path, {"pose": body}, time, "in m, as in ROS")
            # Whose pose it is was said when it was put together.
            left = {"prefix": given.text(PREFIX) or None, "invert": INVERT in given}
            return recording.imported(self.name, Given(self.options, left, self.name))
        if poses is not None and INVERT in given:
            poses = poses[0], poses[1].inverse()
        if MOVING in given:
            for option in (IMAGE_TOPIC, IMU_TOPIC):
                if option in given:
                    raise given.refuse(option, "a moving arm", f"{MOVING.switch} left out: rests")
            moving = _in_motion(path, bag.joints[joints])
            return moving_arm(path, self.name, *moving, poses, given.text(PREFIX))
        names, time, angles = _together(path, joints, bag.joints[joints])
        rests = found_rests(path, names, time, angles, given)
        pictures = _pictures(path, bag, rests, given) if IMAGE_TOPIC in given else None
        bodies = dict[str, list[Seen | None]]()
        if poses is not None:
            bodies["pose"] = seen_poses(*poses, rests, given.text(PREFIX))
        if IMU_TOPIC in given:
            log = _felt(path, bag, given)
            bodies["rest of the IMU"] = [log.still(rest.begin, rest.end) for rest in rests]
        rows = imported_rests(path, self.name, names, rests, bodies, pictures)
        return rows if pictures is None else _with_camera(rows, bag, given.text(IMAGE_TOPIC))

    def _poses(self, path: Path, bag: _Bag, given: Given) -> tuple[FloatArray, Body] | None:
        """Times (n,), s, and poses, of a topic or of two frames of tf; None where none is asked."""
        if BODY in given or REFERENCE in given:
            return _through_tf(path, bag, given)
        if not bag.poses or (POSE_TOPIC not in given and bag.joints and len(bag.poses) > 1):
            return None
        rows = bag.poses[_chosen(path, bag.poses, given, POSE_TOPIC)]
        numbers = np.array([row for _, row in rows])
        lines = [1] * len(rows)
        places = checked_places(path, lines, numbers[:, :3])
        body = Body(places, rotations_from("xyzw", numbers[:, 3:], path, lines))
        return np.array([at for at, _ in rows]), body


def _together(
    path: Path, topic: str, messages: Sequence[tuple[float, dict[str, float]]]
) -> tuple[list[str], FloatArray, FloatArray]:
    """Names of all joints, times (n,), s, and their readings (n, joints) whenever one was told.

    An arm and its gripper often tell of theirs in messages of their own on one topic. What was
    told last holds for half a second; no longer, or a joint whose driver died would rest.
    """
    names = sorted({name for _, row in messages for name in row})
    latest = dict[str, tuple[float, float]]()
    time, angles = list[float](), list[list[float]]()
    for at, row in messages:
        latest |= {name: (at, value) for name, value in row.items()}
        complete = len(row) == len(names) or (
            len(latest) == len(names) and all(abs(at - when) < 0.5 for when, _ in latest.values())
        )
        if complete:
            time.append(at)
            angles.append([latest[name][1] for name in names])
    if not time:
        problem = f"no time at which {topic} contains every joint of {listed(names)}"
        raise ForeignFileError(problem, "all of them within 0.5 s", file=path)
    return names, np.array(time), np.array(angles)


def _in_motion(
    path: Path, messages: Sequence[tuple[float, dict[str, float]]]
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Readings of all joints, and times (n,), s, at which the joint that is told most rarely was.

    Joints of other messages are interpolated: of a moving arm, what was told last does not hold.
    """
    by_joint = dict[str, list[tuple[float, float]]]()
    for at, row in messages:
        for name, value in row.items():
            by_joint.setdefault(name, []).append((at, value))
    moving = dict[str, MovingRows]()
    for name, values in sorted(by_joint.items()):
        time, readings = np.array(sorted(values)).T
        clock = Clock.of(path, time)
        moving[name] = MovingRows(path, clock, {name: readings[clock.rows]}, None)
    slowest = max(moving.values(), key=lambda rows: rows.clock.step)
    at_rows = slowest.clock.time
    between = {name: Between.of(rows.clock, at_rows) for name, rows in moving.items()}
    covered = np.all([where.known for where in between.values()], axis=0)
    rows_there = {name: rows.between(between[name])[name][covered] for name, rows in moving.items()}
    return rows_there, at_rows[covered]


def _felt(path: Path, bag: _Bag, given: Given) -> GravityLog:
    """What an IMU felt, in the order of its stamps: as by REP 145, upwards at rest, in m/s²."""
    rows = sorted(bag.imus[_chosen(path, bag.imus, given, IMU_TOPIC)])
    time, felt = np.array([at for at, _ in rows]), np.array([row for _, row in rows])
    hint = "choose a topic of raw data, with gravity"
    return GravityLog.of(path, time, felt, without=hint)


def _pictures(
    path: Path, bag: _Bag, rests: Sequence[Rest], given: Given
) -> list[RecordedPicture | None]:
    """A picture of each rest."""
    topic = _chosen(path, dict.fromkeys(bag.pictures), given, IMAGE_TOPIC)
    with _read_errors(path):
        messages = _messages(_folder_of(path), lambda _, other: other == topic)
        return pictures_at(path, topic, rests, ((at, message) for _, _, at, message in messages))


def _with_camera(rows: ImportedRows, bag: _Bag, topic: str) -> ImportedRows:
    """With the camera whose camera_info stands beside the topic of its pictures, or with why not.

    ``/left/image_raw/compressed`` is of the camera of ``/left/camera_info``.
    """
    places = [topic.rpartition("/")[0]]
    places.append(places[0].rpartition("/")[0])
    name = next((f"{p}/camera_info" for p in places if f"{p}/camera_info" in bag.cameras), "")
    if not name:
        hint = f"no camera_info that belongs to {topic}"
        return replace(rows, remarks=(*rows.remarks, f"The recording has {hint}."))
    camera, why = camera_of(bag.cameras[name])
    if camera is None:
        return replace(rows, notes=(*rows.notes, f"{name} was not written: {why}."))
    return replace(rows, camera=camera)


def _chosen(path: Path, topics: dict[str, Any], given: Given, option: Option) -> str:
    """The topic that is asked for, or the only one."""
    name = given.text(option)
    if option not in given and len(topics) == 1:
        return next(iter(topics))
    if option not in given and option.metavar in topics:
        return option.metavar
    if name not in topics:
        problem = (f"no topic {name!r}" if name else f"{len(topics)} topics") + " of this kind"
        hint = f"choose it with {option.switch}"
        raise ForeignFileError(problem, f"one of {listed(list(topics))}", file=path, hint=hint)
    return name


def _read(path: Path, extra: str) -> _Bag:
    """Everything that matters in a recording; of pictures the topics: memory may hold fewer."""
    most_messages = 5_000_000
    if not (is_folder(path) or is_plain_file(path)):
        raise ForeignFileError("no such file", "a recording", file=path)
    load("rosbags", extra)
    folder, bag = _folder_of(path), _Bag()
    for file in [folder] if folder.is_file() else sorted(folder.iterdir()):
        note_input(file)

    def matters(kind: str, topic: str) -> bool:
        if kind in (IMAGE, COMPRESSED):
            bag.pictures.add(topic)
        return kind in {_JOINT_STATE, _TF, CAMERA_INFO, _IMU, *_POSES}

    with _read_errors(path):
        for count, message in enumerate(_messages(folder, matters)):
            if count > most_messages:
                problem = f"more than {most_messages} messages"
                raise ForeignFileError(problem, "a shorter recording", file=path)
            _take(bag, *message)
    return bag


def _folder_of(path: Path) -> Path:
    """The recording that a path is, or is a part of: its folder tells what is in it."""
    if is_folder(path) or path.suffix.lower() == ".bag":
        return path
    if not (path.parent / "metadata.yaml").is_file():
        hint = "create it with ros2 bag reindex"
        raise ForeignFileError("no metadata.yaml in its folder", "one", file=path, hint=hint)
    return path.parent


@contextmanager
def _read_errors(path: Path) -> Iterator[None]:
    """Damaged recordings make their readers, and the database beneath, raise whatever they meet."""
    try:
        yield
    except (ForeignFileError, MissingExtraError):
        raise
    except Exception as problem:  # noqa: BLE001
        message = " ".join(f"{type(problem).__name__}: {problem}".split())[:160]
        description = f"a recording that cannot be read ({message})"
        expected = "a .bag file, or a folder that ros2 bag recorded"
        raise ForeignFileError(description, expected, file=path) from None


def _messages(
    path: Path, chosen: Callable[[str, str], bool]
) -> Iterator[tuple[str, str, float, Any]]:
    """Type, topic, time (s, of the header where there is one) and content, in order.

    ``chosen`` says of a type and a topic whether its messages are wanted.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        connections = [c for c in reader.connections if chosen(c.msgtype, c.topic)]
        for connection, stamp, raw in reader.messages(connections=connections):
            message = reader.deserialize(raw, connection.msgtype)
            at = _seconds(message.header) if hasattr(message, "header") else 0.0
            yield connection.msgtype, connection.topic, at or 1e-9 * stamp, message


def _seconds(header: Any) -> float:
    return float(header.stamp.sec + 1e-9 * header.stamp.nanosec)


def _take(bag: _Bag, kind: str, topic: str, at: float, message: Any) -> None:
    if kind == _JOINT_STATE:
        row = dict(zip(message.name, map(float, message.position), strict=False))
        if row and all(map(np.isfinite, row.values())):
            bag.joints.setdefault(topic, []).append((at, row))
    elif kind == _TF:
        for transform in message.transforms:
            ends = (transform.header.frame_id, transform.child_frame_id)
            parent, child = (name.lstrip("/") for name in ends)
            # Static ones hold from the beginning.
            when = 0.0 if topic.endswith("static") else _seconds(transform.header) or at
            bag.transforms.append((when, parent, child, _numbers(transform.transform)))
    elif kind == _IMU:
        felt = message.linear_acceleration
        bag.imus.setdefault(topic, []).append((at, [felt.x, felt.y, felt.z]))
    elif kind == CAMERA_INFO:
        bag.cameras.setdefault(topic, message)
    else:
        pose = message
        for name in _POSES[kind]:
            pose = getattr(pose, name)
        bag.poses.setdefault(topic, []).append((at, _numbers(pose)))


def _numbers(pose: Any) -> list[float]:
    """x, y, z in m, and a quaternion x, y, z, w, of a Pose or a Transform."""
    place = getattr(pose, "position", None) or pose.translation
    turn = getattr(pose, "orientation", None) or pose.rotation
    return [*(float(getattr(place, a)) for a in "xyz"), *(float(getattr(turn, a)) for a in "xyzw")]


def _through_tf(path: Path, bag: _Bag, given: Given) -> tuple[FloatArray, Body]:
    """``T_reference_body`` whenever one of the transforms between them came anew."""
    body, reference = given.text(BODY), given.text(REFERENCE)
    frames = {name for _, parent, child, _ in bag.transforms for name in (parent, child)}
    for option, name in ((BODY, body), (REFERENCE, reference)):
        if name not in frames:
            problem = f"no frame {name!r} in tf" if name else f"no {option.switch}"
            frames_known = listed(sorted(frames), 12) or "none: no tf was recorded"
            raise ForeignFileError(problem, f"one of {frames_known}", file=path)
    if body == reference:
        raise given.refuse(
            REFERENCE, f"{body!r}, which is the body itself", "another frame than --body"
        )
    latest: dict[str, tuple[str, FloatArray]] = {}
    times, poses = list[float](), list[FloatArray]()
    for at, parent, child, numbers in sorted(bag.transforms, key=lambda sample: sample[0]):
        rotation = rotation_from_quaternion(numbers[3:]) if any(numbers[3:]) else np.eye(3)
        latest[child] = (parent, homogeneous(rotation, numbers[:3]))
        up, down = _to_root(latest, body), _to_root(latest, reference)
        common = next((name for name in up if name in down), None)
        if common is None or (child not in up and child not in down):
            continue
        times.append(at)
        poses.append(np.linalg.inv(down[common]) @ up[common])
    if not poses:
        problem = f"no connection from {body!r} to {reference!r} in tf"
        raise ForeignFileError(problem, "frames of one tree", file=path)
    matrices = np.array(poses)
    return np.array(times), Body(matrices[:, :3, 3], matrices[:, :3, :3])


def _to_root(latest: dict[str, tuple[str, FloatArray]], frame: str) -> dict[str, FloatArray]:
    """``T_ancestor_frame`` of every frame on the way up, itself first."""
    poses, pose = {frame: np.eye(4)}, np.eye(4)
    # Steps from a frame to the root; more is a loop.
    deepest = 100
    while frame in latest and len(poses) < deepest:
        frame, step = latest[frame]
        pose = step @ pose
        poses[frame] = pose
    return poses
