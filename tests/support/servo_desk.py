"""A desk with a hobby arm, a printed sheet, a camera on its hand and one beside it, simulated.

The pen touches the crosses of the sheet on the table and on a slope; then the camera on the hand
sees a board on the table, and the camera beside the arm a board in the hand. Sheet and board come
from one printer, which makes both 0.5 mm in 200 mm too long or too short along each side.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from hobby_arms import sheet
from servo_arms import SLOPE, TABLE, ServoArm, arm_with_pen, placed

from suta_calib import Solution
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import (
    homogeneous,
    register_points,
    rotation_from_rpy,
    rotation_from_vector,
    vector_from_rotation,
)
from suta_calib.job.calibration import Calibration
from suta_calib.job.new_job import new_job, write_job
from suta_calib.measurements import Camera, Chessboard, corners_of, write_camera, write_corners
from suta_calib.measurements.artefact import write_artefact
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND
from suta_calib.units import deg

# The hand is held at a slant: hanging straight down, its weight would not take up the play of the
# wrist.
TOUCHING = (0.0, -20.0, 45.0, 25.0, 0.0)
# Places of the sheet; at the last nothing is fitted.
PLACES = {"table": TABLE, "slope": SLOPE, "aside": ((190.0, -10.0, 25.0), (-8.0, -5.0, 12.0))}
CAMERA = Camera(1280, 720, np.array([800.0, 800, 639.5, 359.5, 0.05, -0.1, 0, 0, 0]))
BOARD = Chessboard(8, 5, 0.015)
CAMERAS = {"wrist": EYE_IN_HAND, "front": EYE_TO_HAND}
# Postures about which each camera takes its pictures, and how far from them at most, deg.
SEEN_AT = {"wrist": (0.0, -30.0, 40.0, 55.0, 0.0), "front": (10.0, -20.0, 10.0, 0.0, 0.0)}
AROUND = (50.0, 30.0, 30.0, 40.0, 90.0)


def pose(position_mm: Sequence[float], rpy_deg: Sequence[float]) -> FloatArray:
    return homogeneous(rotation_from_rpy(np.radians(rpy_deg)), np.array(position_mm) / 1e3)


def looking(at: Sequence[float], to: Sequence[float]) -> FloatArray:
    """Pose of a camera that looks from one place to another, its x axis level; m."""
    forward = np.subtract(to, at) / np.linalg.norm(np.subtract(to, at))
    right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
    return homogeneous(np.array([right, np.cross(forward, right), forward]).T, np.array(at))


# The camera on the hand and the board in the hand, in the frame of the pen.
ON_HAND, IN_HAND = pose((-90, 15, -80), (3, 12, 88)), pose((-80, 45, 10), (182, -3, 5))
# The board on the table and the camera beside the arm, in the base's frame.
ON_TABLE, BESIDE = pose((180, -40, 0), (178, 1, 10)), looking((0.55, 0.15, 0.35), (0.25, 0, 0.2))


@dataclass(eq=False)
class ServoDesk:
    """What was measured on a desk.

    Attributes:
        servos: the arm.
        job: its ``calibration.yaml``.
        stretch: (2,) by how much the printer makes all longer, along x and y.
    """

    servos: ServoArm
    job: Path
    stretch: FloatArray

    @classmethod
    def made(
        cls, folder: Path, seed: int, *, pictures: int = 60, lens: bool = False, **servos: Any
    ) -> ServoDesk:
        """A job as ``init --pen --camera`` begins it, measured; of no pictures no camera.

        The lenses are known, or found from the pictures.
        """
        folder.mkdir(parents=True)
        arm = ServoArm.made(arm_with_pen(folder), seed, **servos)
        desk = cls(arm, folder / "calibration.yaml", 2.5e-3 * arm.random.standard_normal(2))
        cameras = CAMERAS if pictures else {}
        write_job(new_job(arm.arm, folder, pen=True, cameras=cameras))
        write_artefact(folder / "artefact.yaml", sheet(ruler=2.5e-3))
        desk._complete_job(lens=lens)
        for place in PLACES:
            desk.touch(place)
        for name in cameras:
            desk.see(name, pictures)
        return desk

    def touch(
        self, place: str, file: Path | None = None, marks: Sequence[str] = (), repeat: str = "1"
    ) -> None:
        """Samples of the crosses at a place, as `measure` writes them; of all by default."""
        printed = sheet(*(1 + self.stretch).tolist())
        if marks:
            printed = replace(printed, landmarks={name: printed.landmarks[name] for name in marks})
        at = placed(printed, PLACES[place])
        at = at + 3e-4 * self.servos.random.standard_normal(at.shape)
        labels = [(place, repeat, mark) for mark in printed.landmarks]
        if file is None:
            folder = self.job.parent / ("validation" if place == "aside" else "calibration")
            (folder / "samples.csv").unlink(missing_ok=True)
            file = folder / f"{place}.csv"
        q = self.servos.touching(at, TOUCHING)
        self._write(file, ("placement", "repeat", "landmark"), labels, q)

    def _complete_job(self, *, lens: bool) -> None:
        """The pose of the sheet by a ruler; the file of both lenses, if they are known."""
        position, rpy = np.array(TABLE)
        ruler = position + self.servos.random.standard_normal(3)
        turned = rpy + 0.5 * self.servos.random.standard_normal(3)
        text = self.job.read_text()
        after = "  # Camera wrist" if "  # Camera wrist" in text else "\n# Samples that are never"
        begun = text[text.index("    # pose:") : text.index(after)]
        stated = (
            f"    pose:\n      table: {{position_mm: {ruler.tolist()}, rotation_rpy_deg: "
            f"{turned.tolist()}, prior_mm: 1, prior_deg: 0.5}}\n"
        )
        text = text.replace(begun, stated).replace("starts: 8", "starts: 2")
        if lens:
            write_camera(self.job.parent / "camera.yaml", CAMERA)
            text = text.replace("board: board.yaml", "board: board.yaml\n    camera: camera.yaml")
        self.job.write_text(text)

    def _write(
        self, file: Path, names: Sequence[str], labels: Sequence[Sequence[str]], q: FloatArray
    ) -> None:
        with file.open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow((*names, *self.servos.arm.joints))
            for label, row in zip(labels, self.servos.readings(q), strict=True):
                writer.writerow((*label, *map(repr, row.tolist())))

    def hands(self, q: FloatArray) -> FloatArray:
        """True poses of the pen (k, 4, 4)."""
        return np.array([homogeneous(*of) for of in zip(*self.servos.at(q), strict=True)])

    def pictures(self, name: str) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Postures in which a camera sees the whole board, and the corners that it sees, px."""
        random, middle = self.servos.random, np.radians(SEEN_AT[name])
        points = np.array([*BOARD.points.values()]) * [*(1 + self.stretch), 1]
        leaning = self.servos.hanging(middle[None])[:, 1:-1]
        while True:
            q = middle + np.radians(AROUND) * random.uniform(-1, 1, (200, 5))
            q = q[(self.servos.hanging(q)[:, 1:-1] == leaning).all(axis=1)]
            hand = self.hands(q)
            seen = np.linalg.inv(BESIDE) @ hand @ IN_HAND
            if name == "wrist":
                seen = np.linalg.inv(hand @ ON_HAND) @ ON_TABLE
            for angles, board in zip(q, seen, strict=True):
                at = points @ board[:3, :3].T + board[:3, 3]
                # Not too near, and not too much from the side.
                if at[:, 2].min() > 0.06 and board[2, 2] > 0.6:
                    pixel = CAMERA.project(at)
                    if (pixel > 10).all() and (
                        pixel < [CAMERA.width - 10, CAMERA.height - 10]
                    ).all():
                        yield angles, pixel + 0.2 * random.standard_normal(pixel.shape)

    def see(self, name: str, pictures: int) -> None:
        """Samples and corners of a camera's pictures, as `measure` and `detect` write them."""
        self.saw(name, [*islice(self.pictures(name), pictures)])

    def saw(self, name: str, taken: Sequence[tuple[FloatArray, FloatArray]]) -> None:
        """The same of some `pictures`."""
        images = [f"{k:02}.png" for k in range(len(taken))]
        q = np.array([angles for angles, _ in taken])
        labels = [(image,) for image in images]
        self._write(self.job.parent / name / "samples.csv", ("image",), labels, q)
        numbers = np.tile(np.array([*BOARD.points]), len(taken))
        pixels = np.concatenate([pixel for _, pixel in taken])
        corners = corners_of(np.repeat(images, len(BOARD.points)), numbers, pixels)
        write_corners(self.job.parent / name / "corners.csv", corners)

    def errors(self, result: Calibration | Solution) -> dict[str, float]:
        """Errors of a result over the workspace, the base registered: mm and deg, RMS.

        Of the tip and the camera on the hand, in 40 postures; and of the camera beside the arm.
        """
        random, arm = np.random.default_rng(1), self.servos.arm
        places = random.uniform((0.17, -0.12, 0.0), (0.33, 0.12, 0.1), (40, 3))
        q = self.servos.touching(places, TOUCHING)
        true = self.hands(q)
        values = {name: e.value for name, e in result.estimates.items() if name in arm.offered}
        rotation, position = arm.forward(self.servos.read_at(q), values)
        turn, shift = register_points(position, true[:, :3, 3])[:2]
        base = homogeneous(turn, shift)
        found = base @ np.array([homogeneous(*of) for of in zip(rotation, position, strict=True)])
        hand, beside = found @ camera_in(result, "wrist"), base @ camera_in(result, "front")
        return {
            "tip_mm": _apart(found, true)[0],
            **dict(zip(("wrist_mm", "wrist_deg"), _apart(hand, true @ ON_HAND), strict=True)),
            **dict(zip(("front_mm", "front_deg"), _apart(beside[None], BESIDE[None]), strict=True)),
        }


def camera_in(result: Calibration | Solution, label: str) -> FloatArray:
    """Pose (4, 4) of a camera, of that name, in the tip or in the base."""
    x = np.array([result.estimates[f"hand_eye[{label}].{k}"].value for k in ("x", "y", "z")])
    turn = [result.estimates[f"hand_eye[{label}].{k}"].value for k in ("rx", "ry", "rz")]
    return homogeneous(rotation_from_vector(turn), x)


def _apart(one: FloatArray, other: FloatArray) -> tuple[float, float]:
    """How far poses (k, 4, 4) are apart: mm and deg, RMS."""
    shift = np.linalg.norm(one[:, :3, 3] - other[:, :3, 3], axis=1)
    turned = np.swapaxes(one[:, :3, :3], 1, 2) @ other[:, :3, :3]
    turn = np.linalg.norm(vector_from_rotation(turned), axis=1)
    return 1e3 * float(np.sqrt(np.mean(shift**2))), deg(float(np.sqrt(np.mean(turn**2))))
