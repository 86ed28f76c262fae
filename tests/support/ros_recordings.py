"""Recordings of ROS 1 and 2, simulated: an arm that rests at postures, and where it is seen."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from suta_calib.arrays import FloatArray
from suta_calib.measurements import Camera

JOINTS = ("joint_1", "joint_2")
POSTURES = np.array([[0.1, -0.4], [0.9, 0.2], [-0.6, 0.8]])
# s between readings, and of a rest and of the motion after it.
STEP, REST, MOTION = 0.02, 2.0, 0.6


def motion(postures: FloatArray = POSTURES) -> tuple[FloatArray, FloatArray]:
    """Times (n,), s, and readings, rad: at rest at every posture, in between under way."""
    time, q = list[float](), list[FloatArray]()
    for k, posture in enumerate(postures):
        begin = k * (REST + MOTION)
        following = postures[min(k + 1, len(postures) - 1)]
        for at in np.arange(0, REST + MOTION, STEP):
            share = np.clip((at - REST) / MOTION, 0, 1)
            time.append(begin + at)
            q.append(posture + share * (following - posture))
    return np.array(time), np.array(q)


def seen(q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (n, 3, 3) and positions (n, 3), m, that belong to readings."""
    rotation = Rotation.from_euler("zy", q[:, :2]).as_matrix()
    return rotation, np.stack([q[:, 0], q[:, 1], 1 + q[:, 0] * q[:, 1]], axis=1)


# Size of the pictures, px, and what lies behind each row of their pixels.
WIDTH, HEIGHT, PADDING = 8, 6, 3
CAMERA = Camera(WIDTH, HEIGHT, np.array([9.0, 9.0, 4.0, 3.0, 0.1, -0.2, 0.001, 0.002, 0.0]))

_CAMERA_INFO = ("/camera/camera_info", "sensor_msgs/msg/CameraInfo")
# By whether there are pictures, and whether they are compressed.
CAMERA_TOPICS = {
    (False, False): (),
    (True, False): (("/camera/image_raw", "sensor_msgs/msg/Image"), _CAMERA_INFO),
    (True, True): (
        ("/camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage"),
        _CAMERA_INFO,
    ),
}


def picture(posture: int) -> NDArray[np.uint8]:
    """The picture (height, width, 3), blue green red, that is taken at a posture."""
    blue, green = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    return np.stack([20 * blue, 30 * green, np.full_like(blue, 70 * (posture + 1))], -1).astype(
        "u1"
    )


def raw_picture(posture: int, encoding: str) -> tuple[bytes, int]:
    """Pixels of such a picture with padded rows, and the bytes of a row."""
    image = picture(posture)
    rows = {
        "bgr8": image,
        "rgb8": image[..., ::-1],
        "bgra8": np.dstack([image, np.full_like(image[..., 0], 255)]),
        "mono8": image[..., 0],
        "mono16": (image[..., 0].astype("<u2") * 257).view("u1"),
    }[encoding].reshape(HEIGHT, -1)
    padded = np.hstack([rows, np.full((HEIGHT, PADDING), 99, dtype="u1")])
    return padded.tobytes(), padded.shape[1]


def write_recording(
    path: Path,
    storage: str = "sqlite3",
    *,
    ros1: bool = False,
    encoding: str = "",
    camera_model: str = "plumb_bob",
    joints: Sequence[str] = JOINTS,
    postures: FloatArray = POSTURES,
    taken: tuple[Camera, Sequence[NDArray[np.uint8]]] | None = None,
    parted: bool = False,
) -> Path:
    """Joint states, the tool in the base and the base in the tracker by tf, and as a topic.

    With an encoding also pictures at 10 Hz: raw, or ``png``, compressed; with a camera and what it
    saw at each posture, greys, those. Parted, the last joint tells of itself by itself.
    """
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        kind = "tf2_msgs/msg/TFMessage"
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", kind))
    t = store.types
    time, q = motion(postures)
    rotation, position = seen(q)
    quaternion = Rotation.from_matrix(rotation).as_quat()
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer1(path) if ros1 else Writer(path, version=9, storage_plugin=plugin)
    with writer:
        topics = {
            name: writer.add_connection(name, kind, typestore=store)
            for name, kind in (
                ("/joint_states", "sensor_msgs/msg/JointState"),
                ("/tf", "tf2_msgs/msg/TFMessage"),
                ("/tf_static", "tf2_msgs/msg/TFMessage"),
                ("/tool", "geometry_msgs/msg/PoseStamped"),
                *CAMERA_TOPICS[bool(encoding), encoding == "png"],
            )
        }

        def header(at: float, frame: str) -> object:
            stamp = t["builtin_interfaces/msg/Time"](int(at), round(at % 1 * 1e9))
            numbers = [0] if ros1 else []
            return t["std_msgs/msg/Header"](*numbers, stamp, frame)

        def transform(at: float, parent: str, child: str, xyz: object, turn: object) -> object:
            place = t["geometry_msgs/msg/Vector3"](*map(float, xyz))
            rotation = t["geometry_msgs/msg/Quaternion"](*map(float, turn))
            whole = t["geometry_msgs/msg/Transform"](place, rotation)
            stamped = t["geometry_msgs/msg/TransformStamped"](header(at, parent), child, whole)
            return t["tf2_msgs/msg/TFMessage"]([stamped])

        def write(topic: str, at: float, message: object) -> None:
            kind = message.__msgtype__
            raw = (
                store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind)
            )
            writer.write(topics[topic], int(at * 1e9), raw)

        def image(at: float, posture: int) -> object:
            if encoding == "png":
                import cv2

                data = cv2.imencode(".png", picture(posture))[1]
                kind = t["sensor_msgs/msg/CompressedImage"]
                return kind(header(at, "camera"), "bgr8; png compressed bgr8", data)
            kind = t["sensor_msgs/msg/Image"]
            if taken is not None:
                grey = taken[1][posture]
                size = *grey.shape, "mono8", 0, grey.shape[1]
                return kind(header(at, "camera"), *size, grey.ravel())
            data, step = raw_picture(posture, encoding)
            pixels = np.frombuffer(data, dtype=np.uint8)
            return kind(header(at, "camera"), HEIGHT, WIDTH, encoding, 0, step, pixels)

        def camera(at: float) -> object:
            used = CAMERA if taken is None else taken[0]
            fx, fy, cx, cy, *of_lens = used.intrinsics
            k, d = np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1]), np.array(of_lens)
            region = t["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
            kind = t["sensor_msgs/msg/CameraInfo"]
            matrices = d, k, np.eye(3).ravel(), np.zeros(12)
            size = used.height, used.width
            return kind(header(at, "camera"), *size, camera_model, *matrices, 0, 0, region)

        start = 100.0
        if encoding:
            write("/camera/camera_info", start, camera(start))
        half = np.sqrt(0.5)
        write(
            "/tf_static", start, transform(start, "tracker", "base", (0, 0, 2), (0, 0, half, half))
        )
        for at, row, xyz, turn in zip(time + start, q, position, quaternion, strict=True):
            for some in (slice(-1), slice(-1, None)) if parted else (slice(None),):
                state = t["sensor_msgs/msg/JointState"](
                    header(at, ""), list(joints[some]), row[some], np.zeros(0), np.zeros(0)
                )
                write("/joint_states", at, state)
            write("/tf", at, transform(at, "base", "tool", xyz, turn))
            place = t["geometry_msgs/msg/Point"](*map(float, xyz))
            pose = t["geometry_msgs/msg/Pose"](
                place, t["geometry_msgs/msg/Quaternion"](*map(float, turn))
            )
            write("/tool", at, t["geometry_msgs/msg/PoseStamped"](header(at, "base"), pose))
            if encoding and round((at - start) / STEP) % 5 == 0:
                posture = int((at - start) // (REST + MOTION))
                write(CAMERA_TOPICS[True, encoding == "png"][0][0], at, image(at, posture))
    return path


def write_imu_recording(path: Path, *, joints: bool) -> Path:
    """An IMU that the first joint turns about y, and perhaps the joint states, of ROS 2."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    t, (time, q) = store.types, motion()
    rng, none = np.random.default_rng(3), np.zeros(0)
    kinds = {"/imu": "sensor_msgs/msg/Imu", "/joint_states": "sensor_msgs/msg/JointState"}
    with Writer(path, version=9) as writer:
        topics = {
            name: writer.add_connection(name, kind, typestore=store)
            for name, kind in kinds.items()
            if joints or name == "/imu"
        }
        for at, row in zip((time + 100.0).tolist(), q, strict=True):
            stamp = t["builtin_interfaces/msg/Time"](int(at), round(at % 1 * 1e9))
            header = t["std_msgs/msg/Header"](stamp, "imu")
            up = 9.81 * np.array([np.sin(row[0]), 0.0, np.cos(row[0])])
            felt = t["geometry_msgs/msg/Vector3"](*(up + 0.02 * rng.standard_normal(3)).tolist())
            turn = t["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
            still, unknown = t["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0), np.zeros(9)
            parts = (turn, unknown, still, unknown, felt, unknown)
            messages = {
                "/imu": t["sensor_msgs/msg/Imu"](header, *parts),
                "/joint_states": t["sensor_msgs/msg/JointState"](
                    header, list(JOINTS), row, none, none
                ),
            }
            for name, connection in topics.items():
                message = messages[name]
                raw = store.serialize_cdr(message, kinds[name])
                writer.write(connection, int(at * 1e9), raw)
    return path
