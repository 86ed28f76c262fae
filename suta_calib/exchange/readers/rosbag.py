"""Recordings of ROS 1 and ROS 2 (.bag, a folder with .db3 or .mcap), read without ROS."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.atomic import note_input
from suta_calib.errors import ForeignFileError, MissingExtraError
from suta_calib.exchange.bodies import BODY, INVERT, PREFIX, REFERENCE, Body, Recording
from suta_calib.exchange.imported import ImportedRows, checked_places
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.recorded_rests import SECONDS, imported_rests
from suta_calib.exchange.rotations import rotations_from
from suta_calib.extras import load
from suta_calib.geometry.numbers import homogeneous, rotation_from_quaternion
from suta_calib.words import listed

JOINT_TOPIC: Final = Option("joint_topic", "Topic of the joint states.", "/joint_states")
POSE_TOPIC: Final = Option("pose_topic", "Topic with the poses of a tracker or camera.", "/TOPIC")
_JOINT_STATE: Final = "sensor_msgs/msg/JointState"
_TF: Final = "tf2_msgs/msg/TFMessage"
# Where the pose is in messages that hold one.
_POSES: Final = {
    "geometry_msgs/msg/PoseStamped": ("pose",),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose", "pose"),
    "geometry_msgs/msg/TransformStamped": ("transform",),
    "nav_msgs/msg/Odometry": ("pose", "pose"),
}
_MOST_MESSAGES: Final = 5_000_000
# Steps from a frame to the root; more is a loop.
_DEEPEST: Final = 100


@dataclass(eq=False)
class _Bag:
    """What was read: by topic, and transforms in the order in which they came."""

    joints: dict[str, list[tuple[float, dict[str, float]]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    poses: dict[str, list[tuple[float, list[float]]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    transforms: list[tuple[float, str, str, list[float]]] = field(default_factory=list)


class RosbagReader(Reader):
    """Rests of the joint states with the poses of a topic or of tf; or such poses alone."""

    name: ClassVar[str] = "rosbag"
    summary: ClassVar[str] = "ROS 1 and 2 recordings (.bag, .db3, MCAP): joint states, poses, tf"
    example: ClassVar[str] = "run_1 --format rosbag --body tool0 --reference tracker --out a.csv"
    options: ClassVar[tuple[Option, ...]] = (
        *(JOINT_TOPIC, POSE_TOPIC, BODY, REFERENCE, PREFIX, INVERT, SECONDS),
    )
    extra: ClassVar[str] = "ros"

    def recognises(self, path: Path, head: str) -> bool:
        """A folder with metadata.yaml, a file of one, or the first line of a bag."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return head.startswith(("#ROSBAG V", "\ufffdMCAP0", "SQLite format 3"))

    def read(self, path: Path, given: Given) -> ImportedRows:
        """Rows for the rests where there are joint states, or else for every pose."""
        bag = _read(path, self.extra)
        joints = _chosen(path, bag.joints, given, JOINT_TOPIC) if bag.joints else None
        poses = self._poses(path, bag, given)
        if joints is None:
            if poses is None:
                said = "no joint states, and no poses that were asked for"
                topics = listed(list(bag.poses)) or "none"
                hint = f"topics with poses: {topics}; --body and --reference name frames of tf"
                expected = "a topic of sensor_msgs/JointState, or poses"
                raise ForeignFileError(said, expected, file=path, hint=hint)
            time, body = poses
            recording = Recording(path, {"pose": body}, time, "in m, as ROS has them")
            # Whose pose it is was said when it was put together.
            left = {"prefix": given.text(PREFIX) or None, "invert": INVERT in given}
            return recording.imported(self.name, Given(self.options, left, self.name))
        names = sorted({name for _, row in bag.joints[joints] for name in row})
        told = [(at, row) for at, row in bag.joints[joints] if len(row) == len(names)]
        if not told:
            said = f"no message of {joints} that tells every joint of {listed(names)}"
            raise ForeignFileError(said, "one of them", file=path)
        time = np.array([at for at, _ in told])
        angles = np.array([[row[name] for name in names] for _, row in told])
        seen = poses
        if seen is not None and INVERT in given:
            seen = (seen[0], seen[1].inverse())
        return imported_rests(path, self.name, names, time, angles, given, seen, given.text(PREFIX))

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


def _chosen(path: Path, topics: dict[str, Any], given: Given, option: Option) -> str:
    """The topic that is asked for, or the only one."""
    name = given.text(option)
    if option not in given and len(topics) == 1:
        return next(iter(topics))
    if option not in given and option.metavar in topics:
        return option.metavar
    if name not in topics:
        said = f"no topic {name!r} of that kind" if name else f"{len(topics)} topics of that kind"
        hint = f"say which with {option.switch}"
        raise ForeignFileError(said, f"one of {listed(list(topics))}", file=path, hint=hint)
    return name


def _read(path: Path, extra: str) -> _Bag:
    """Everything that matters in a recording.

    Raises:
        ForeignFileError: it is missing, damaged, or without end.
        MissingExtraError: rosbags is not installed.
    """
    if not path.exists():
        raise ForeignFileError("no such file", "a recording", file=path)
    load("rosbags", extra)
    if path.is_file() and path.suffix.lower() != ".bag":
        # A part of a recording, whose folder tells what is in it.
        if not (path.parent / "metadata.yaml").is_file():
            hint = "ros2 bag reindex makes it"
            raise ForeignFileError("no metadata.yaml beside it", "one", file=path, hint=hint)
        path = path.parent
    for file in [path] if path.is_file() else sorted(path.iterdir()):
        note_input(file)
    bag = _Bag()
    try:
        for count, (kind, topic, at, message) in enumerate(_messages(path)):
            if count > _MOST_MESSAGES:
                said = f"more than {_MOST_MESSAGES} messages"
                raise ForeignFileError(said, "a shorter recording", file=path)
            _take(bag, kind, topic, at, message)
    except (ForeignFileError, MissingExtraError):
        raise
    # Damaged recordings make their readers, and the database beneath, raise whatever they meet.
    except Exception as problem:  # noqa: BLE001
        said = " ".join(f"{type(problem).__name__}: {problem}".split())[:160]
        raise ForeignFileError(
            f"a recording that cannot be read ({said})",
            "a .bag file, or a folder that ros2 bag recorded",
            file=path,
        ) from None
    return bag


def _messages(path: Path) -> Iterator[tuple[str, str, float, Any]]:
    """Type, topic, time (s, of the header where there is one) and content, in order."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    wanted = {_JOINT_STATE, _TF, *_POSES}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        connections = [each for each in reader.connections if each.msgtype in wanted]
        for connection, stamp, raw in reader.messages(connections=connections):
            message = reader.deserialize(raw, connection.msgtype)
            at = 1e-9 * stamp
            if hasattr(message, "header"):
                own = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
                at = own or at
            yield connection.msgtype, connection.topic, at, message


def _take(bag: _Bag, kind: str, topic: str, at: float, message: Any) -> None:
    if kind == _JOINT_STATE:
        numbers = map(float, message.position)
        row = dict(zip(message.name, numbers, strict=False))
        if row and all(map(np.isfinite, row.values())):
            bag.joints[topic].append((at, row))
    elif kind == _TF:
        for each in message.transforms:
            own = each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec
            parent, child = (
                name.lstrip("/") for name in (each.header.frame_id, each.child_frame_id)
            )
            numbers_ = _numbers(each.transform)
            bag.transforms.append(
                (0.0 if topic.endswith("static") else own or at, parent, child, numbers_)
            )
    else:
        pose = message
        for name in _POSES[kind]:
            pose = getattr(pose, name)
        bag.poses[topic].append((at, _numbers(pose)))


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
            said = f"no frame {name!r} in tf" if name else f"no {option.switch}"
            known = listed(sorted(frames), 12) or "no frames: nothing was recorded of tf"
            raise ForeignFileError(said, f"one of {known}", file=path)
    latest: dict[str, tuple[str, FloatArray]] = {}
    times, found = list[float](), list[FloatArray]()
    # Static ones first: they hold from the beginning.
    for at, parent, child, numbers in sorted(bag.transforms, key=lambda each: each[0]):
        rotation = rotation_from_quaternion(numbers[3:]) if any(numbers[3:]) else np.eye(3)
        latest[child] = (parent, homogeneous(rotation, numbers[:3]))
        up, down = _to_root(latest, body), _to_root(latest, reference)
        common = next((name for name in up if name in down), None)
        if common is None or (child not in up and child not in down):
            continue
        times.append(at)
        found.append(np.linalg.inv(down[common]) @ up[common])
    if not found:
        said = f"no way from {body!r} to {reference!r} in tf"
        raise ForeignFileError(said, "frames of one tree", file=path)
    matrices = np.array(found)
    return np.array(times), Body(matrices[:, :3, 3], matrices[:, :3, :3])


def _to_root(latest: dict[str, tuple[str, FloatArray]], frame: str) -> dict[str, FloatArray]:
    """``T_ancestor_frame`` of every frame on the way up, itself first."""
    found, pose = {frame: np.eye(4)}, np.eye(4)
    while frame in latest and len(found) < _DEEPEST:
        frame, step = latest[frame]
        pose = step @ pose
        found[frame] = pose
    return found
