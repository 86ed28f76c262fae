"""A folder with everything that any command reads, and what each command is given of it."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
from ball_clouds import CENTRE, RADIUS, cloud, write_pcd
from camera_scenes import BOARD, CAMERA, SECOND, X, pictures
from certified_artefact import write_points
from cli_job import write_simulated_job
from pose_answers import XYZ
from pose_scenes import PAIR, POSE, pair_numbers, pivot_numbers, point_numbers, write_csv
from simulated import SUTA_URDF
from torso_robot import write_torso_job

from suta_calib.job import CalibrationJob
from suta_calib.measurements import (
    Samples,
    write_board,
    write_camera,
    write_corners,
    write_samples,
)
from suta_calib.measurements.artefact import Artefact, Landmark, write_artefact
from suta_calib.model.arm import ArmModel
from suta_calib.report import calibration_document
from suta_calib.report.files import write_document
from suta_calib.stereotactic.cis_simulation import simulate_stereotactic

WORKCELL = SUTA_URDF.parents[1] / "data" / "workcell"
JOB, URDF, SAMPLES = "calibration.yaml", "arm.urdf", "calibration/a.csv"
BOX = ("--region", "150,600,-300,300,0,400", "--grid", "5")
DEVICE = """\
port: /dev/no-such-port
joints: [{name: joint_1}, {name: joint_2}, {name: joint_3},
         {name: joint_4}, {name: joint_5}, {name: joint_6}]
"""
ARTEFACT = """\
name: block
landmarks:
  A: {position_mm: [0, 0, 0]}
  B: {position_mm: [100, 0, 0]}
  C: {position_mm: [0, 100, 0]}
"""
TOUCHED = """\
arm: {urdf: arm.urdf, tip: tip}
parameters: [{select: ["joint_*.offset"], bound_deg: 15}]
observations: [{kind: pairwise_distance, artefact: artefact.yaml, samples: touched.csv}]
"""
CROSSES = """\
arm: {urdf: arm.urdf, tip: tip}
parameters: [{select: ["joint_*.offset"], bound_deg: 15}]
observations: [{kind: landmark, artefact: block.yaml, samples: crosses.csv}]
"""
ACCEPTANCE = "arm: {urdf: arm.urdf, tip: tip}\nrepeatability: {samples: visits.csv}\n"
SIMULATION = """\
arm: {urdf: arm.urdf, tip: tip}
seed: 3
sets:
  tracked:
    kind: tracked_point
    samples: 5
    base_in_instrument: {position_mm: [1000, 2000, 300], rotation_rpy_deg: [10, 20, 30]}
"""


@dataclass(frozen=True)
class Given:
    """What a command is given.

    Attributes:
        arguments: behind its name; of these, names of the scene's files and folders are paths.
        reads: the scene's files that it reads, all of them before it computes.
        out: the option that says where it writes, and whether that is a file; empty for none.
        needs_device: whether it cannot end well without a device.
        welcome: what is malformed to others and not to it, such as another encoding.
        ending: that the name of the file it writes must have.
    """

    arguments: tuple[str, ...]
    reads: tuple[str, ...]
    out: str = ""
    out_is_file: bool = False
    needs_device: bool = False
    welcome: tuple[str, ...] = ()
    ending: str = ""


_OF_JOB = (JOB, URDF, SAMPLES, "validation/a.csv")
# A robot of two chains.
CHAINS = "chains/calibration.yaml"
_OF_CHAINS = (CHAINS, "chains/robot.urdf", "chains/right_fitted.csv", "chains/left_held.csv")
_OF_ARM = (URDF, "--tip", "tip")
GIVEN = {
    "demo": Given((), (), "--out"),
    "calibrate": Given((JOB,), _OF_JOB, "--out"),
    "observe": Given((JOB,), _OF_JOB),
    "study": Given(
        (JOB, "--trials", "1", "--sizes", "30", "--jobs", "1", "--anyway"), _OF_JOB, "--out"
    ),
    "extend": Given((JOB, "--quick"), _OF_JOB, "--out"),
    "budget": Given((CHAINS, "--anyway"), _OF_CHAINS, "--out"),
    "view": Given((JOB, "--port", "0", "--seconds", "0.2"), _OF_JOB, "--html", out_is_file=True),
    "check": Given(
        ("calibrated/result.json", "validation/a.csv", "--no-history"),
        ("calibrated/result.json", "validation/a.csv"),
        "--out",
    ),
    "validate": Given((URDF, JOB), _OF_JOB),
    "outliers": Given((JOB,), _OF_JOB, "--out"),
    "init": Given(_OF_ARM, (URDF,), "--out"),
    "simulate": Given(("simulation.yaml",), ("simulation.yaml", URDF), "--out"),
    "pivot": Given(("pivot.csv",), ("pivot.csv",), "--out"),
    "hand-eye": Given(("pairs.csv",), ("pairs.csv",), "--out"),
    "detect": Given(
        ("view.jpg", "--board", "board.yaml"), ("board.yaml",), "--out", out_is_file=True
    ),
    "balls": Given(("cloud.pcd", "--ball", "A=30"), ("cloud.pcd",), "--out", out_is_file=True),
    "rig": Given(
        (
            *("--corners", "left.csv", "--corners", "right.csv", "--board", "rig_board.yaml"),
            *("--camera", "rig_camera.yaml", "--camera", "rig_camera.yaml"),
        ),
        ("left.csv", "right.csv", "rig_board.yaml", "rig_camera.yaml"),
        "--out",
    ),
    "planes": Given(("cloud.pcd",), ("cloud.pcd",), "--out", out_is_file=True),
    "register": Given(("a.csv", "b.csv"), ("a.csv", "b.csv"), "--out"),
    "stereotactic": Given(
        ("cis",), tuple(f"cis-{k}.txt" for k in ("calbody", "calreadings", "empivot")), "--out"
    ),
    "certify": Given(("points.csv",), ("points.csv",), "--out", out_is_file=True),
    "monitor": Given(("--device", "device.yaml"), ("device.yaml",), needs_device=True),
    "emulate": Given(
        (*_OF_ARM, "--seconds", "0.1", "--start", "now"), (URDF,), "--device-out", out_is_file=True
    ),
    "track": Given(
        (*_OF_ARM, "--device", "device.yaml"),
        (URDF, "device.yaml"),
        "--csv",
        out_is_file=True,
        needs_device=True,
    ),
    "path-accuracy": Given(
        ("recorded.csv", "reference.csv"), ("recorded.csv", "reference.csv"), "--out"
    ),
    "measure": Given(
        ("touched.yaml", "--device", "device.yaml", "--placement", "P9", "--yes"),
        ("touched.yaml", URDF, "artefact.yaml", "device.yaml"),
        "--out",
        out_is_file=True,
        needs_device=True,
    ),
    "guide": Given(
        ("touched.yaml", "--device", "device.yaml", "--port", "0", "--no-open"),
        ("touched.yaml", URDF, "artefact.yaml", "device.yaml"),
        needs_device=True,
    ),
    "plan": Given((JOB, "-n", "1", "--tilt", "0"), _OF_JOB, "--out"),
    "tip-map": Given((JOB, *BOX, "--anyway"), _OF_JOB, "--out"),
    "residual-map": Given((JOB, "--anyway"), _OF_JOB, "--out"),
    "zero-offsets": Given(
        (*_OF_ARM, "--readings", "known.csv"),
        (URDF, "known.csv"),
        "--out",
        out_is_file=True,
    ),
    "motors": Given(
        ("crosses.yaml", "--device", "device.yaml"),
        ("crosses.yaml", URDF, "block.yaml", "device.yaml", "crosses.csv"),
        "--out",
        out_is_file=True,
    ),
    "repeatability": Given(("visits.csv", "--urdf", *_OF_ARM), (URDF, "visits.csv"), "--out"),
    "import": Given(
        ("foreign.tsv",), ("foreign.tsv",), "--out", out_is_file=True, welcome=("UTF-16",)
    ),
    "export": Given(
        ("calibrated/result.json", "--format", "mjcf"),
        ("calibrated/result.json",),
        "--out",
        out_is_file=True,
    ),
    "certificate": Given(
        *(("calibrated/result.json",), ("calibrated/result.json",), "--out"),
        out_is_file=True,
        ending=".pdf",
    ),
    "iso10360": Given(("iso.yaml",), ("iso.yaml", URDF, "visits.csv"), "--out"),
}


def write_scene(folder: Path, urdf: Path) -> Path:
    """Write all that `GIVEN` names."""
    write_simulated_job(folder, urdf)
    arm = ArmModel.from_urdf(folder / URDF, "tip")
    random = np.random.default_rng(0)
    for name, text in (
        ("device.yaml", DEVICE),
        ("artefact.yaml", ARTEFACT),
        ("touched.yaml", TOUCHED),
        ("crosses.yaml", CROSSES),
        ("iso.yaml", ACCEPTANCE),
        ("simulation.yaml", SIMULATION),
    ):
        (folder / name).write_text(text)
    q = 0.5 + 1e-4 * random.standard_normal((10, len(arm.joints)))
    visits = Samples.from_arrays(arm.joints, q, labels={"point": ["F1"] * len(q)})
    write_samples(folder / "visits.csv", visits)
    turned = random.uniform(-0.8, 0.8, (12, len(arm.joints)))
    known = Samples.from_arrays(arm.joints, turned[:6] - 0.01, position=arm.forward(turned[:6])[1])
    write_samples(folder / "known.csv", known)
    labels = {"placement": ["P1"] * 3, "repeat": ["1"] * 3, "landmark": list("ABC")}
    write_samples(folder / "touched.csv", Samples.from_arrays(arm.joints, q[:3], labels=labels))
    marks = {
        f"M{k}": Landmark(f"M{k}", at, None, 1e-5) for k, at in enumerate(arm.forward(turned)[1])
    }
    write_artefact(folder / "block.yaml", Artefact("block", marks))
    labels = {"placement": ["P1"] * 12, "repeat": ["1"] * 12, "landmark": [*marks]}
    write_samples(folder / "crosses.csv", Samples.from_arrays(arm.joints, turned, labels=labels))
    write_csv(folder / "pivot.csv", POSE, pivot_numbers(["left"] * 40))
    poses = pivot_numbers(["left"] * 40)
    np.savetxt(folder / "foreign.tsv", poses, delimiter="\t", header="\t".join(POSE), comments="")
    write_csv(folder / "pairs.csv", PAIR, pair_numbers(20, "eye-in-hand"))
    for name, numbers in zip(("a.csv", "b.csv"), point_numbers(12), strict=True):
        write_csv(folder / name, XYZ, numbers)
    time = np.arange(0, 4, 0.02)[:, None]
    path = np.hstack([0.1 * np.sin(time * k) for k in (1.0, 2.3, 3.1)])
    for name in ("recorded.csv", "reference.csv"):
        write_csv(folder / name, ("time", *XYZ), np.hstack([time, path]))
    write_points(folder / "points.csv")
    # Rows about the ball alone, so that few are read again and again.
    write_pcd(folder / "cloud.pcd", cloud((CENTRE, RADIUS))[30:80, 70:130].reshape(-1, 3))
    (folder / CHAINS).parent.mkdir()
    write_torso_job(folder / "chains", fitted=30, held_out=5)
    for name, file in (("view.jpg", "pictures/00.jpg"), ("board.yaml", "board.yaml")):
        shutil.copy(WORKCELL / file, folder / name)
    pair = pictures(8, pixel=0.1, eyes=(X, SECOND)).views
    for name, view in zip(("left.csv", "right.csv"), pair, strict=True):
        # The first cell with a dot is a number.
        image = np.char.replace(view.corners.image, ".png", "")
        write_corners(folder / name, replace(view.corners, image=image))
    write_board(folder / "rig_board.yaml", BOARD)
    write_camera(folder / "rig_camera.yaml", CAMERA)
    result = CalibrationJob.load(folder / JOB).run()
    job = folder / JOB
    inputs = {str(job): sha256(job.read_bytes()).hexdigest()}
    write_document(calibration_document(result), folder / "calibrated", inputs)
    simulate_stereotactic("cis", seed=2, distortion=3e-3, em_noise=0.05e-3, grid=2).write(folder)
    return folder


def command_line(command: str, folder: Path, out: Path | None = None) -> list[str]:
    """The words of one command over the scene in a folder."""
    given = GIVEN[command]
    words: Sequence[str] = [
        str(folder / word) if (folder / word).is_file() or word == "cis" else word
        for word in given.arguments
    ]
    if out is not None and given.out:
        words = [*words, given.out, f"{out}{given.ending}"]
    return [command, *words]
