"""A job without samples, and an emulated arm to measure it with."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from device_stand_in import postures_on

from suta_calib.arrays import FloatArray
from suta_calib.device.description import DeviceSpec, JointSpec
from suta_calib.emulation import Emulation, Faults, Stops
from suta_calib.emulation.motion import Motion, continuous
from suta_calib.geometry.numbers import wrap
from suta_calib.measurements import Samples, read_artefact, read_samples
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.noise import full_circle
from suta_calib.terms import PairwiseDistance
from suta_calib.terms.poses import joint_ranges

NOISE = 1.7e-5
SECONDS = 0.4


@dataclass(frozen=True)
class Bench:
    """A job without samples, and where its arm rests on each landmark."""

    job: Path
    arm: ArmModel
    postures: dict[str, FloatArray]

    @classmethod
    def made(cls, folder: Path, repository: Path) -> Bench:
        shutil.copy(repository / "urdf" / "suta.urdf", folder / "arm.urdf")
        shutil.copy(repository / "data" / "suta" / "artefact.yaml", folder)
        (folder / "calibration.yaml").write_text(
            "arm: {urdf: arm.urdf, tip: tip}\n"
            "parameters: [{select: ['joint_*.offset'], bound_deg: 15}]\n"
            "observations:\n"
            "  - {kind: pairwise_distance, artefact: artefact.yaml, samples: 'calibration/*.csv'}\n"
            "  - {kind: fixed_point, samples: 'fixed_point/*.csv'}\n",
            encoding="utf-8",
        )
        arm = ArmModel.from_urdf(folder / "arm.urdf", "tip")
        postures = postures_on(arm, read_artefact(folder / "artefact.yaml"))
        return cls(folder / "calibration.yaml", arm, postures)

    @property
    def folder(self) -> Path:
        return self.job.parent

    def emulation(self, motion: Motion, faults: str = "", joints: Sequence[str] = ()) -> Emulation:
        specs = tuple(JointSpec(name, 1) for name in joints or self.arm.joints)
        spec = DeviceSpec(Path("device.yaml"), "", 921600, "frames", "counts", 1 << 22, specs)
        return Emulation(spec, motion, noise=NOISE, faults=Faults.parse(faults))

    def stops(self, names: str, rest: float, move: float = 0.4) -> Stops:
        each = [self.postures[name] for name in names.split(",")]
        where = continuous(np.array(each), full_circle(self.arm))
        labels = tuple({"landmark": name} for name in names.split(","))
        return Stops(where, labels, rest, move, (len(labels) - 1,))

    def command(self, *more: object, seconds: float = SECONDS) -> list[str]:
        device = ("--device", self.folder / "device.yaml", "--seconds", seconds)
        return [str(each) for each in ("measure", self.job, *device, *more)]

    def samples(self, name: str = "calibration/P1_1.csv", columns: Any = None) -> Samples:
        columns = columns or PairwiseDistance.columns
        return read_samples([self.folder / name], joint_ranges(self.arm), columns)

    def check(self, samples: Samples) -> None:
        """The averages are those of the landmarks, to the noise of an average."""
        for label, q in zip(samples.labels["landmark"], samples.q, strict=True):
            off = np.abs(wrap(q - self.postures[label])).max()
            assert off < 8e-6, f"{label}: off by {off:.3g} rad"
