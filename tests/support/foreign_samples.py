"""A small file of every foreign format, simulated: the same poses as each of them writes them.

Written after the formats' public descriptions; no instrument made them. Frame 3 was not seen.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import c3d as c3d_files
import numpy as np
import phone_logs
from foreign import poses, transforms
from ros_recordings import JOINTS as RECORDED
from ros_recordings import motion, write_recording
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from suta_calib.arrays import FloatArray

R, P = poses(8)
TOOL = transforms(R, P)
REFERENCE = transforms(*poses(8, seed=5))
# The frame in which the tool was not seen.
LOST = 3
KEPT = np.delete(np.arange(8), LOST)


class Sample(NamedTuple):
    """A file of a format, and the options that tell its tool."""

    path: Path
    options: dict[str, Any]
    reference: str = ""


def quaternion(T: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_matrix(T[:, :3, :3]).as_quat())


def _line(cells: list[Any], separator: str = ",") -> str:
    return separator.join(repr(float(c)) if isinstance(c, float) else str(c) for c in cells)


def motive(folder: Path) -> Sample:
    bodies, axes = ("probe", "base"), ["X", "Y", "Z", "W", "X", "Y", "Z", ""]
    kinds = ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"]
    lines = [
        "Format Version,1.23,Take Name,Take 1,Capture Frame Rate,100.0,Export Frame Rate,100.0,"
        "Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global",
        "",
        _line(["", "", *["Rigid Body"] * 16]),
        _line(["", "", *[name for name in bodies for _ in range(8)]]),
        _line(["", "", *["1"] * 8, *["2"] * 8]),
        _line(["", "", *kinds * 2]),
        _line(["Frame", "Time (Seconds)", *axes * 2]),
    ]
    for k in range(8):
        cells: list[Any] = [k, k / 100]
        for T in (TOOL, REFERENCE):
            seen = [*quaternion(T)[k].tolist(), *T[k, :3, 3].tolist(), 0.0001]
            cells += [""] * 8 if k == LOST and T is TOOL else seen
        lines.append(_line(cells))
    path = folder / "motive.csv"
    path.write_text("\r\n".join(lines) + "\r\n")
    return Sample(path, {"body": "probe"}, "base")


def vicon(folder: Path) -> Sample:
    axes = ["RX", "RY", "RZ", "TX", "TY", "TZ"]
    lines = [
        "Segments",
        "100",
        _line(["", "", "Global Angle s:probe", *[""] * 5, "Global Angle s:base", *[""] * 5]),
        _line(["Frame", "Sub Frame", *axes * 2]),
        _line(["", "", *(["deg"] * 3 + ["mm"] * 3) * 2]),
    ]
    for k in range(8):
        cells: list[Any] = [k + 1, 0]
        for T in (TOOL, REFERENCE):
            turn = Rotation.from_matrix(T[k, :3, :3]).as_rotvec(degrees=True)
            seen = [*turn.tolist(), *(1e3 * T[k, :3, 3]).tolist()]
            cells += [""] * 6 if k == LOST and T is TOOL else seen
        lines.append(_line(cells))
    path = folder / "vicon.csv"
    path.write_text("\n".join(lines) + "\n")
    return Sample(path, {"body": "s:probe", "rotation": "vector"}, "s:base")


def qualisys(folder: Path) -> Sample:
    tab = "\t"
    names = ["X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual", *[f"Rot[{k}]" for k in range(9)]]
    lines = [
        "NO_OF_FRAMES\t8",
        "NO_OF_CAMERAS\t6",
        "NO_OF_BODIES\t2",
        "FREQUENCY\t100",
        "TIME_STAMP\t2024-01-01, 12:00:00",
        "DATA_INCLUDED\t6D",
        "BODY_NAMES\tprobe\tbase",
        tab.join([*names, *names]),
    ]
    for k in range(8):
        cells: list[Any] = []
        for T in (TOOL, REFERENCE):
            by_columns = T[k, :3, :3].T.ravel().tolist()
            seen = [*(1e3 * T[k, :3, 3]).tolist(), 0.0, 0.0, 0.0, 0.1, *by_columns]
            cells += [0.0] * 16 if k == LOST and T is TOOL else seen
        lines.append(_line(cells, tab) + tab)
    path = folder / "run_6D.tsv"
    path.write_text("\n".join(lines) + "\n")
    return Sample(path, {"body": "probe"}, "base")


def ndi(folder: Path) -> Sample:
    of_tool = "ToolInfo,Frame#,PortHandle,Face#,TransformStatus,Q0,Qx,Qy,Qz,Tx,Ty,Tz,Error,#Markers"
    lines = [f"ToolCount,{of_tool},{of_tool}"]
    for k in range(8):
        cells: list[Any] = [2]
        for name, T in (("probe", TOOL), ("base", REFERENCE)):
            x, y, z, w = quaternion(T)[k].tolist()
            pose = [w, x, y, z, *(1e3 * T[k, :3, 3]).tolist(), 0.1]
            lost = k == LOST and T is TOOL
            cells += [name, k, "01", 0, *(["Missing", *[""] * 8] if lost else ["OK", *pose]), 4]
        lines.append(_line(cells))
    path = folder / "ndi.csv"
    path.write_text("\n".join(lines) + "\n")
    return Sample(path, {"body": "probe"}, "base")


def plus_sequence(folder: Path) -> Sample:
    lines = ["ObjectType = Image", "NDims = 3", "DimSize = 1 1 8", "ElementType = MET_UCHAR"]
    for k in range(8):
        for name, T in (("StylusToTracker", TOOL), ("ReferenceToTracker", REFERENCE)):
            lost = k == LOST and T is TOOL
            matrix = T[k].copy()
            matrix[:3, 3] *= 1e3
            numbers = " ".join(repr(float(v)) for v in (np.eye(4) if lost else matrix).ravel())
            field = f"Seq_Frame{k:04d}_{name}Transform"
            lines += [f"{field} = {numbers}", f"{field}Status = {'INVALID' if lost else 'OK'}"]
        lines.append(f"Seq_Frame{k:04d}_Timestamp = {k / 20!r}")
    lines.append("ElementDataFile = LOCAL")
    path = folder / "run.mha"
    path.write_bytes("\n".join(lines).encode() + b"\n" + bytes(range(8)))
    return Sample(path, {"body": "StylusToTracker"}, "ReferenceToTracker")


# Formats whose files hold a tool and a reference body.
BODIES: dict[str, Callable[[Path], Sample]] = {
    "motive": motive,
    "vicon": vicon,
    "qualisys": qualisys,
    "ndi": ndi,
    "plus-sequence": plus_sequence,
}


def table(folder: Path) -> Sample:
    lines = ["x,y,z,qx,qy,qz,qw"]
    lines += [_line([*P[k].tolist(), *quaternion(TOOL)[k].tolist()]) for k in KEPT]
    path = folder / "table.csv"
    path.write_text("\n".join(lines) + "\n")
    return Sample(path, {})


def rosbag(folder: Path) -> Sample:
    return Sample(write_recording(folder / "run"), {})


MOTORS = {
    name: {
        "id": k,
        "drive_mode": int(k == 2),
        "homing_offset": 100 * k - 250,
        "range_min": 700 + k,
        "range_max": 3300,
    }
    for k, name in enumerate(("shoulder_pan", "shoulder_lift", "elbow_flex"), 1)
}


def lerobot_calibration(folder: Path) -> Sample:
    path = folder / "so101.json"
    path.write_text(json.dumps(MOTORS, indent=4))
    return Sample(path, {})


def leica_gsi(folder: Path) -> Sample:
    """GSI-16, coordinates to a hundredth of a millimetre."""
    lines = []
    for k in range(8):
        words = [f"*11{k + 1:04d}+{f'P{k}':0>16}"]
        for index, value in zip((81, 82, 83), P[k], strict=True):
            words.append(f"{index}..08{'-' if value < 0 else '+'}{abs(round(value * 1e5)):016d}")
        lines.append(" ".join(words) + " ")
    path = folder / "points.gsi"
    path.write_text("\n".join(lines) + "\n")
    return Sample(path, {})


def opencv_storage(folder: Path) -> Sample:
    """As ``cv::FileStorage`` breaks its lines."""
    lines = ["%YAML:1.0", "---", "frameCount: 8"]
    for k in range(8):
        for name, T in (("T1", TOOL), ("T2", REFERENCE)):
            numbers = [repr(float(v)) for v in T[k].ravel()]
            rows = ",\n       ".join(", ".join(numbers[at : at + 4]) for at in range(0, 16, 4))
            lines += [f"{name}_{k}: !!opencv-matrix", "   rows: 4", "   cols: 4", "   dt: d"]
            lines.append(f"   data: [ {rows} ]")
    path = folder / "poses.yml"
    path.write_text("\n".join(lines) + "\n")
    return Sample(path, {"body": "T1"}, "T2")


def pose_list(folder: Path) -> Sample:
    """As moveit_calibration writes its samples."""
    names = "effector_wrt_world", "object_wrt_sensor"
    samples = [
        "".join(
            f"{'- ' if T is TOOL else '  '}{name}: {T[k].ravel().tolist()}\n"
            for name, T in zip(names, (TOOL, REFERENCE), strict=True)
        )
        for k in range(8)
    ]
    path = folder / "samples.yaml"
    path.write_text("".join(samples))
    return Sample(path, {"body": names[0]}, names[1])


def colmap(folder: Path) -> Sample:
    lines = [
        "# Image list with two lines of data per image:",
        "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
        "#   POINTS2D[] as (X, Y, POINT3D_ID)",
    ]
    for k in range(8):
        numbers = [*np.roll(quaternion(TOOL)[k], 1), *TOOL[k, :3, 3]]
        lines.append(" ".join([str(k + 1), *map(repr, map(float, numbers)), "1", f"im_{k}.png"]))
        lines.append("20.5 30.5 7 40.25 50.75 -1")
    path = folder / "images.txt"
    path.write_text("\n".join(lines) + "\n")
    return Sample(path, {})


def bop(folder: Path) -> Sample:
    def pose(T: FloatArray, number: int) -> dict[str, Any]:
        rotation, position = T[:3, :3].ravel().tolist(), (1e3 * T[:3, 3]).tolist()
        return {"cam_R_m2c": rotation, "cam_t_m2c": position, "obj_id": number}

    scene = {str(k): [pose(TOOL[k], 1), pose(REFERENCE[k], 2)] for k in range(8)}
    path = folder / "scene_gt.json"
    path.write_text(json.dumps(scene))
    return Sample(path, {"body": "object_1"}, "object_2")


def visp(folder: Path) -> Sample:
    path = folder / "visp"
    path.mkdir(exist_ok=True)
    for name, poses_of in (("fPe", TOOL), ("cPo", REFERENCE)):
        for k in range(8):
            turn = Rotation.from_matrix(poses_of[k, :3, :3]).as_rotvec()
            numbers = "".join(f"  - [{float(v)!r}]\n" for v in (*poses_of[k, :3, 3], *turn))
            text = f"rows: 6\ncols: 1\ndata:\n{numbers}"
            (path / f"pose_{name}_{k + 1}.yaml").write_text(text)
    return Sample(path, {"body": "fPe"}, "cPo")


def matlab(folder: Path) -> Sample:
    path = folder / "poses.mat"
    cells = np.empty(8, object)
    cells[:] = list(REFERENCE)
    savemat(path, {"A": np.moveaxis(TOOL, 0, -1), "B": cells, "note": "simulated"})
    return Sample(path, {"body": "A"}, "B")


# The maker's numbers of a UR5 as its description has them.
UR5 = {
    "shoulder": (0, 0, 0.089159, 0, 0, 0),
    "upper_arm": (0, 0, 0, np.pi / 2, 0, 0),
    "forearm": (-0.425, 0, 0, 0, 0, 0),
    "wrist_1": (-0.39225, 0, 0.10915, 0, 0, 0),
    "wrist_2": (0, -0.09465, 0, np.pi / 2, 0, 0),
    "wrist_3": (0, 0.0823, 0, np.pi / 2, np.pi, np.pi),
}


def c3d(folder: Path) -> Sample:
    writer = c3d_files.Writer(point_rate=100)
    for k in range(8):
        points = np.zeros((2, 5), np.float32)
        points[:, :3] = 1e3 * np.array([TOOL[k, :3, 3], REFERENCE[k, :3, 3]])
        if k == LOST:
            points[0, 3] = -1
        writer.add_frames([(points, np.zeros((0, 0)))])
    writer.set_point_labels(["probe", "base"])
    path = folder / "trial.c3d"
    with warnings.catch_warnings(), path.open("wb") as file:
        warnings.simplefilter("ignore")
        writer.write(file)
    return Sample(path, {"body": "probe"})


def ur_kinematics(folder: Path) -> Sample:
    keys = "x", "y", "z", "roll", "pitch", "yaw"
    text = "kinematics:\n"
    for link, numbers in UR5.items():
        lines = (f"    {key}: {float(n)!r}\n" for key, n in zip(keys, numbers, strict=True))
        text += f"  {link}:\n{''.join(lines)}"
    path = folder / "my_robot_calibration.yaml"
    path.write_text(text + "  hash: calib_1\n")
    return Sample(path, {})


def lerobot_dataset(folder: Path) -> Sample:
    """Two episodes of the motion that the recordings of ROS have."""
    import pyarrow as arrow
    from pyarrow import parquet

    time, q = motion()
    path = folder / "dataset"
    (path / "meta").mkdir(parents=True, exist_ok=True)
    (path / "data/chunk-000").mkdir(parents=True, exist_ok=True)
    names = [f"{name}.pos" for name in RECORDED]
    state = {"dtype": "float32", "shape": [2], "names": names}
    info = {"codebase_version": "v3.0", "fps": 50, "features": {"observation.state": state}}
    (path / "meta/info.json").write_text(json.dumps(info))
    for episode in range(2):
        columns = {
            "observation.state": np.rad2deg(q).tolist(),
            "timestamp": time,
            "episode_index": np.full(len(time), episode),
        }
        file = path / f"data/chunk-000/file-{episode:03d}.parquet"
        parquet.write_table(arrow.table(columns), file)
    return Sample(path, {"state_unit": "deg"})


def dh(folder: Path) -> Sample:
    path = folder / "arm_dh.csv"
    path.write_text(
        "joint,type,theta_deg,d_mm,a_mm,alpha_deg\n"
        "joint_1,revolute,10,100,20,90\njoint_2,revolute,-5,0,300,0\njoint_3,prismatic,0,50,0,0\n"
    )
    return Sample(path, {})


JOINTS = np.random.default_rng(7).uniform(-2, 2, (8, 6))


def _program(path: Path, lines: list[str], what: str) -> Sample:
    path.write_text("\n".join(lines) + "\n")
    return Sample(path, {"what": what})


def ur_script(folder: Path) -> Sample:
    lines = ["def program():", "  # movej([9, 9, 9, 9, 9, 9])"]
    for k in range(8):
        q = ", ".join(repr(float(v)) for v in JOINTS[k])
        turn = Rotation.from_matrix(R[k]).as_rotvec()
        pose = ", ".join(repr(float(v)) for v in (*P[k], *turn))
        lines += [f"  movej([{q}], a=1.4, v=1.05)", f"  movel(p[{pose}], a=1.2)"]
    return _program(folder / "run.script", [*lines, "end"], "poses")


def krl(folder: Path) -> Sample:
    lines = ["DEFDAT RUN", "; E6AXIS P0={A1 9,A2 9,A3 9,A4 9,A5 9,A6 9}"]
    for k in range(8):
        q = ",".join(f"A{j + 1} {float(v)!r}" for j, v in enumerate(np.rad2deg(JOINTS[k])))
        angles = Rotation.from_matrix(R[k]).as_euler("ZYX", degrees=True)
        numbers = zip("XYZABC", (*1e3 * P[k], *angles), strict=True)
        pose = ",".join(f"{name} {float(v)!r}" for name, v in numbers)
        lines += [f"DECL E6AXIS XJ{k}={{{q},E1 0.0}}", f"DECL E6POS XP{k}={{{pose},S 2,T 10}}"]
    return _program(folder / "run.dat", [*lines, "ENDDAT"], "poses")


def rapid(folder: Path) -> Sample:
    lines = [
        "MODULE Module1",
        "  ! CONST jointtarget j0:=[[9,9,9,9,9,9],[9E9,9E9,9E9,9E9,9E9,9E9]];",
    ]
    for k in range(8):
        q = ",".join(repr(float(v)) for v in np.rad2deg(JOINTS[k]))
        place = ",".join(repr(float(v)) for v in 1e3 * P[k])
        x, y, z, w = quaternion(TOOL)[k].tolist()
        none = "[9E9,9E9,9E9,9E9,9E9,9E9]"
        lines += [
            f"  CONST jointtarget j{k + 1}:=[[{q}],{none}];",
            f"  CONST robtarget p{k}:=[[{place}],[{w!r},{x!r},{y!r},{z!r}],[0,0,0,0],{none}];",
        ]
    return _program(folder / "run.mod", [*lines, "ENDMODULE"], "poses")


PROGRAMS: dict[str, Callable[[Path], Sample]] = {"ur-script": ur_script, "krl": krl, "rapid": rapid}


def mjcf(folder: Path) -> Sample:
    path = folder / "arm.xml"
    path.write_text(
        '<mujoco model="two"><compiler angle="radian"/><worldbody>'
        '<body name="upper" pos="0 0 0.5" quat="0.8 0.6 0 0"><inertial pos="0 0 0" mass="1" '
        'diaginertia="1 1 1"/><joint name="joint_1" axis="0 0 1" range="-2 2" limited="true"/>'
        '<body name="fore" pos="0.3 0 0.1"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        '<joint name="joint_2" axis="0.6 0 0.8" pos="0.02 0 0"/>'
        '<site name="tip" pos="0.2 0.1 0" quat="0.6 0 0.8 0"/></body></body>'
        "</worldbody></mujoco>\n"
    )
    return Sample(path, {})


def phone(form: str) -> Callable[[Path], Sample]:
    """A log of three rests, with as many postures beside it."""

    def write(folder: Path) -> Sample:
        time, felt = phone_logs.log(phone_logs.directions(3))
        path = folder / f"{form}.csv"
        if form == "accelerometer":
            phone_logs.phyphox(path, time, felt)
            lines = path.read_text().splitlines()[1:]
            path.write_text("\n".join(["time,ax,ay,az,size", *lines]) + "\n")
        else:
            {"sensor-logger": phone_logs.sensor_logger, "phyphox": phone_logs.phyphox}[form](
                path, time, felt
            )
        file, _ = phone_logs.postures(folder / "postures.csv", 3)
        return Sample(path, {"postures": str(file)})

    return write


# Poses by name, of which two are pairs.
POSES = {"pose-list": pose_list, "colmap": colmap, "bop": bop, "visp": visp, "matlab": matlab}
SAMPLES: dict[str, Callable[[Path], Sample]] = {
    "table": table,
    **BODIES,
    "rosbag": rosbag,
    "lerobot-calibration": lerobot_calibration,
    "leica-gsi": leica_gsi,
    "lerobot-dataset": lerobot_dataset,
    "dh": dh,
    **PROGRAMS,
    "mjcf": mjcf,
    "opencv-yaml": opencv_storage,
    **POSES,
    "ur-kinematics": ur_kinematics,
    "c3d": c3d,
    **{form: phone(form) for form in ("sensor-logger", "phyphox", "accelerometer")},
}
# Those whose samples are folders.
FOLDERS = ("rosbag", "lerobot-dataset", "visp")
FILES = [name for name in SAMPLES if name not in FOLDERS]
