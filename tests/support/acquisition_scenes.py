"""An arm that rests on landmarks, and what a run recorded of it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from device_stand_in import Replay, Script

from suta_calib.acquisition.guided import Guided
from suta_calib.acquisition.pictures import Seen, nothing_seen
from suta_calib.acquisition.replay import RecordingEnded
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


def file_of(plan: TouchSequence, path: Path, *, resume: bool = False) -> SamplesFile:
    return SamplesFile(path, plan.arm.joints, plan.label_columns, plan.key, resume=resume)


def device(joints: tuple[str, ...]) -> DeviceSpec:
    specs = tuple(JointSpec(name, 1) for name in joints)
    return DeviceSpec(Path("device.yaml"), "", 1, "frames", "counts", 1 << 22, specs)


class Attempt:
    """An unattended run over made-up readings."""

    def __init__(
        self,
        plan: TouchSequence,
        file: SamplesFile,
        readings: list[Reading],
        see: Seen = nothing_seen,
    ) -> None:
        self.said: list[str] = []
        self.run = Run(plan, file, self.said.append, see=see)
        finder = StopFinder(plan.arm.joints, SECONDS)
        taker = Unattended(self.run, finder, SECONDS)
        choose = ArmReadings(device(plan.arm.joints), plan.arm.joints)
        source = Replay(readings)
        self.events = StreamEvents()
        patience = np.inf if readings else 0.1
        with suppress(RecordingEnded):
            run_session(source, choose, finder, taker, events=self.events, patience=patience)
        taker.finish()
        self.done = taker.done

    @property
    def landmarks(self) -> list[str]:
        return [labels["landmark"] for labels, _ in self.run.file.rows]


@dataclass(frozen=True)
class Scene:
    """The SUTA as its job describes it, its posture on every landmark, and a folder for samples."""

    job: Path
    arm: ArmModel
    postures: dict[str, FloatArray]
    folder: Path

    def __getitem__(self, landmark: str) -> FloatArray:
        """(joints,) readings on a landmark, rad."""
        return self.postures[landmark]

    def plan(self, sequence: str) -> TouchSequence:
        row = read_row(self.job, None, ["pairwise_distance"])
        return touched(self.arm, row, "P1", "1", sequence.split(","))

    def visit(self, names: str, rest: float = 1.0) -> Script:
        first, *others = names.split(",")
        script = Script(self.postures[first]).rest(rest)
        for name in others:
            script.move(self.postures[name], 0.6).rest(rest)
        return script

    def file(
        self, plan: TouchSequence, name: str = "a.csv", *, resume: bool = False
    ) -> SamplesFile:
        return file_of(plan, self.folder / name, resume=resume)

    def attempt(
        self,
        plan: str | TouchSequence,
        readings: Script | list[Reading],
        *,
        name: str = "a.csv",
        resume: bool = False,
    ) -> Attempt:
        plan = self.plan(plan) if isinstance(plan, str) else plan
        readings = readings.readings() if isinstance(readings, Script) else readings
        return Attempt(plan, self.file(plan, name, resume=resume), readings)

    def guidance(self, plan: str | TouchSequence, start: str) -> Guidance:
        plan = self.plan(plan) if isinstance(plan, str) else plan
        return Guidance(plan, self.file(plan), self[start])

    def check(self, attempt: Attempt) -> None:
        for labels, angles in attempt.run.file.rows:
            assert np.abs(angles - self.postures[labels["landmark"]]).max() < 1e-5, labels


class Guidance:
    """A user who presses keys between pieces of the stream."""

    def __init__(self, plan: TouchSequence, file: SamplesFile, start: FloatArray) -> None:
        self.said: list[str] = []
        self.run = Run(plan, file, self.said.append)
        self.finder = StopFinder(plan.arm.joints, SECONDS)
        self.guided = Guided(self.run, self.finder, SECONDS)
        self.script, self.fed = Script(start), 0

    def arm_does(self) -> None:
        """Feed what the script has grown by."""
        for event in self.finder.feed(self.script.readings()[self.fed :]):
            self.guided.handle(event)
        self.fed = len(self.script.angles)

    def rows(self) -> list[str]:
        return [labels["landmark"] for labels, _ in self.run.file.rows]
