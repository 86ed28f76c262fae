"""An arm that rests on landmarks, and what a run recorded of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from device_stand_in import Replay, Script

from suta_calib.acquisition.run import Run, SamplesFile
from suta_calib.acquisition.session import ArmReadings, StreamEvents, run_session
from suta_calib.acquisition.stops import StopFinder
from suta_calib.acquisition.touch_sequence import TouchSequence, read_row, touched
from suta_calib.acquisition.unattended import Unattended
from suta_calib.arrays import FloatArray
from suta_calib.device.description import DeviceSpec, JointSpec
from suta_calib.device.reading import Reading
from suta_calib.model.arm import ArmModel

SECONDS = 0.5


def plan_of(job: Path, arm: ArmModel, sequence: str) -> TouchSequence:
    row = read_row(job, None, ["pairwise_distance"])
    return touched(arm, row, "P1", "1", sequence.split(","))


def file_of(plan: TouchSequence, path: Path, *, resume: bool = False) -> SamplesFile:
    return SamplesFile(path, plan.arm.joints, plan.label_columns, plan.key, resume=resume)


def visit(postures: dict[str, FloatArray], names: str, rest: float = 1.0) -> Script:
    first, *others = names.split(",")
    script = Script(postures[first]).rest(rest)
    for name in others:
        script.move(postures[name], 0.6).rest(rest)
    return script


def device(joints: tuple[str, ...]) -> DeviceSpec:
    specs = tuple(JointSpec(name, 1) for name in joints)
    return DeviceSpec(Path("device.yaml"), "", 1, "frames", "counts", 1 << 22, specs)


class Attempt:
    """An unattended run over made-up readings."""

    def __init__(self, plan: TouchSequence, file: SamplesFile, readings: list[Reading]) -> None:
        self.said: list[str] = []
        self.run = Run(plan, file, self.said.append)
        finder = StopFinder(plan.arm.joints, SECONDS)
        taker = Unattended(self.run, finder, SECONDS)
        choose = ArmReadings(device(plan.arm.joints), plan.arm.joints)
        source = Replay(readings)
        self.events = StreamEvents()
        self.done = run_session(source, choose, finder, taker, events=self.events, patience=1.0)

    @property
    def landmarks(self) -> list[str]:
        return [labels["landmark"] for labels, _ in self.run.file.rows]


def check_against(attempt: Attempt, postures: dict[str, FloatArray]) -> None:
    for labels, angles in attempt.run.file.rows:
        assert np.abs(angles - postures[labels["landmark"]]).max() < 1e-5, labels
