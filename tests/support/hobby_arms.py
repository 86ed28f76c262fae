"""Five-joint hobby arms that touch a printed sheet, simulated: what a new job makes of them.

Horns are put on one to three degrees off, lengths are one to two millimetres off, axes are tilted
by up to a degree. The printer makes the sheet 0.3 to 1 % too long or too short, along x and along y
by different factors; crosses are met by eye to 0.3 mm, and servos have 4096 steps. The sheet lies
on the table, then on a slope, and somewhere else for validation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from suta_calib import ArmModel, Solution
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.job.new_job import new_job, write_job
from suta_calib.measurements.artefact import Artefact, Landmark, write_artefact
from suta_calib.measurements.scale import LengthScale, stretch_prior
from suta_calib.model.parameters import OFFSET, POSITION
from suta_calib.simulation import InverseKinematics, Targets
from suta_calib.units import from_deg, from_mm

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
TIP = "pen_point"
# Readings about which the arm holds its pen over the table.
POSTURE = np.radians((0, -20, 45, 45, 0))


def urdf_of(rng: np.random.Generator) -> str:
    """An arm with the joints of an SO-101, and lengths of its own."""
    upper, fore, wrist, pen = rng.uniform((100, 110, 45, 75), (140, 160, 75, 110))
    base, side, forward, off = rng.uniform((50, 20, 0, 10), (70, 35, 40, 30))
    origins = (
        *((0, 0, base), (side, 0, 60), (forward, 0, upper)),
        *((fore, 0, 0), (wrist, 0, 0), (off, 0, pen)),
    )
    text, parent = ['<robot name="desk_arm">', '  <link name="base"/>'], "base"
    for name, origin in zip((*JOINTS, "pen"), origins, strict=True):
        link = TIP if name == "pen" else f"{name}_link"
        xyz = " ".join(f"{value / 1000:.4f}" for value in origin)
        rpy = "0 1.5707963267948966 0" if name == "wrist_roll" else "0 0 0"
        text += [
            f'  <link name="{link}"/>',
            f'  <joint name="{name}" type="{"fixed" if name == "pen" else "revolute"}">',
            f'    <origin xyz="{xyz}" rpy="{rpy}"/>',
            f'    <parent link="{parent}"/><child link="{link}"/>',
        ]
        if name != "pen":
            limit = 2.8 if name == "wrist_roll" else 1.9
            limits = f'lower="-{limit}" upper="{limit}" effort="3" velocity="5"'
            axis = "0 1 0" if name in JOINTS[1:4] else "0 0 1"
            text += [f'    <axis xyz="{axis}"/>', f"    <limit {limits}/>"]
        text.append("  </joint>")
        parent = link
    return "\n".join([*text, "</robot>", ""])


def true_values(arm: ArmModel, rng: np.random.Generator) -> dict[str, float]:
    """The dimensions of an arm as it was built."""

    def off(least: float, most: float) -> float:
        return float(rng.uniform(least, most) * rng.choice((-1.0, 1.0)))

    truth = dict[str, float]()
    for name, p in arm.parameters.items():
        if p.key == OFFSET:
            truth[name] = from_deg(off(1.0, 3.0))
        elif name in arm.geometric and p.key in POSITION:
            truth[name] = p.nominal + from_mm(off(1.0, 2.0) if p.nominal else off(0.0, 0.5))
        elif name in arm.geometric and p.owner != TIP and name not in arm.like_offsets:
            truth[name] = from_deg(off(0.1, 1.0))
    return truth


def sheet(along_x: float = 1.0, along_y: float = 1.0, ruler: float | None = None) -> Artefact:
    """Crosses on A4 paper: as the file says, or as they were printed, or measured by a ruler."""
    marks = [
        Landmark(
            f"{row}{k}",
            from_mm(np.array([80 * n * along_x, 50 * (k - 3) * along_y, 0])),
            None,
            1e-4,
        )
        for n, row in enumerate("ABC")
        for k in range(1, 6)
    ]
    scale = LengthScale.of_grade("printed") if ruler is None else LengthScale(ruler, "printed")
    return Artefact("sheet", {mark.name: mark for mark in marks}, scale, stretch_prior(scale))


@dataclass(frozen=True)
class DeskArm:
    """A simulated arm whose crosses were met, in a folder with the job that ``init`` writes.

    Attributes:
        job: its ``calibration.yaml``, as written.
        arm: at nominal.
        truth: by name, the values that differ from it.
        begin: how far from the base the sheet begins, m.
    """

    job: Path
    arm: ArmModel
    truth: dict[str, float]
    begin: float

    @classmethod
    def made(cls, folder: Path, seed: int, ruler: float | None = None) -> DeskArm:
        """The arm of a seed; only the samples and the artefact are filled in.

        Args:
            folder: of the URDF and of the job.
            seed: of everything.
            ruler: relative standard deviation with which the sheet was measured; it was not by
                default.
        """
        rng = np.random.default_rng([37, seed])
        folder.mkdir(parents=True)
        urdf = folder / "arm.urdf"
        urdf.write_text(urdf_of(rng))
        arm = ArmModel.from_urdf(urdf, TIP)
        begin = 0.41 * sum(float(np.linalg.norm(joint.xyz)) for joint in arm.chain.joints[2:])
        desk = cls(folder / "job/calibration.yaml", arm, true_values(arm, rng), begin)
        write_job(new_job(arm, folder / "job"))
        write_artefact(folder / "job/artefact.yaml", sheet())
        factors = 1 + rng.uniform(0.003, 0.01, 2) * rng.choice((-1.0, 1.0), 2)
        printed = sheet(*factors.tolist())
        if ruler is not None:
            read = factors * (1 + ruler * np.random.default_rng([38, seed]).standard_normal(2))
            write_artefact(folder / "job/artefact.yaml", sheet(*read.tolist(), ruler))
        crosses = {
            name: mark.position + mark.sigma * rng.standard_normal(3)
            for name, mark in printed.landmarks.items()
        }
        slope = rng.uniform(8, 25)
        for place, position, rpy, times in (
            ("calibration/table", (begin, 0, 0), (0, 0, 0), 2),
            ("calibration/slope", (begin, 0.01, 0.03), (5, -slope, -10), 2),
            ("validation/aside", (begin, 0.02, 0.03), (8, 0, 10), 1),
        ):
            file = folder / f"job/{place}.csv"
            (file.parent / "samples.csv").unlink(missing_ok=True)
            turned = rotation_from_rpy(np.radians(rpy))
            placed = {name: turned @ at + position for name, at in crosses.items()}
            file.write_text("\n".join(desk._met(file.stem, placed, times, rng)) + "\n")
        return desk

    def _met(
        self, place: str, crosses: Mapping[str, FloatArray], times: int, rng: np.random.Generator
    ) -> Iterator[str]:
        """A samples file: all crosses of a sheet, by eye, each time in another posture."""
        yield ",".join(("placement", "repeat", "landmark", *self.arm.joints))
        for repeat in range(1, times + 1):
            at = np.array([*crosses.values()])
            q, reached = self.postures(at + 3e-4 * rng.standard_normal(at.shape), rng)
            assert reached.all()
            step = 2 * np.pi / 4096
            for name, row in zip(crosses, step * np.round(q / step), strict=True):
                yield ",".join((place, str(repeat), name, *map(repr, row.tolist())))

    def postures(self, at: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Readings (n, 5) that bring the true tip to (n, 3), m; and which could be reached."""
        kinematics = InverseKinematics(self.arm, self.truth)
        starts = POSTURE + 0.25 * (kinematics.random_readings(rng, len(at)) - POSTURE)
        targets = Targets(at, np.tile(np.eye(3), (len(at), 1, 1)), "position")
        found = kinematics.solve(targets, starts, rng)
        return found.q, found.reached

    def workspace(self, n: int = 200) -> FloatArray:
        """Readings that bring the tip to places above the table: 200 by 300 mm, 100 mm high."""
        rng = np.random.default_rng(1)
        lower, upper = (self.begin, -0.15, 0.0), (self.begin + 0.2, 0.15, 0.1)
        q, reached = self.postures(rng.uniform(lower, upper, (n, 3)), rng)
        return np.asarray(q[reached])

    def tip_error(self, values: Mapping[str, float], q: FloatArray | None = None) -> float:
        """RMS distance of the tip from the true one, m, the base registered: over `workspace`."""
        q = self.workspace() if q is None else q
        true, found = (
            self.arm.at(
                {name: value for name, value in v.items() if name in self.arm.offered}
            ).forward(q)[1]
            for v in (self.truth, values)
        )
        true, found = true - true.mean(axis=0), found - found.mean(axis=0)
        u, _, vt = np.linalg.svd(found.T @ true)
        turned = found @ u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        return float(np.sqrt(np.mean(np.sum((turned - true) ** 2, axis=1))))

    def deviations(self, solution: Solution) -> dict[str, float]:
        """By how many standard deviations each estimate of the arm is off."""
        return {
            name: abs(estimate.value - self.truth.get(name, self.arm.offered[name].nominal))
            / estimate.std
            for name, estimate in solution.estimates.items()
            if name in self.arm.offered and estimate.std
        }
