"""Tracking an arm on a cable: from files and addresses to published poses."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.atomic import check_folder, check_outputs
from suta_calib.device.bus import Bus
from suta_calib.device.device_file import read_device
from suta_calib.device.formats import format_of
from suta_calib.device.reading import Statistics
from suta_calib.display import Displayable
from suta_calib.errors import InputError, OutputError
from suta_calib.inputs import UrdfFile
from suta_calib.measurements.sample_files import TEMPERATURE
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import BENDING, COMPLIANCE
from suta_calib.tracking.docking import Docking
from suta_calib.tracking.igtl import IgtlPublisher
from suta_calib.tracking.provenance import arm_of_job, made_from
from suta_calib.tracking.publisher import Publisher, UdpPublisher, pose_dict
from suta_calib.tracking.read_back import load_job
from suta_calib.tracking.recalibration import Recalibration, read_recalibration
from suta_calib.tracking.recording import CsvRecorder, ParquetRecorder, part_of
from suta_calib.tracking.session import TrackingSession, low_latency
from suta_calib.tracking.tracker import NO_TOOL, TipKinematics, Tracker, followed, read_tool
from suta_calib.tracking.uncertainty import (
    SOURCE_WORDS,
    CalibrationUncertainty,
    read_json_object,
    read_uncertainty,
)
from suta_calib.trust.tip import taken_as_cool
from suta_calib.units import mm

# What may be given where the job of a result is gone.
_OTHERWISE: Final = "the tip with --tip"


@dataclass(frozen=True)
class TrackOptions(Displayable):
    """Which arm is tracked, and where its poses go.

    Attributes:
        arm: the calibrated URDF, for raw readings.
        tip: link or frame of the arm that is tracked; None for that of the result's job.
        chain: which of the chains of that job, where it has several.
        device: the device.yaml.
        base: link the pose is relative to; the root by default.
        result: result.json of the calibration that wrote ``arm``: for the tip's uncertainty.
        anyway: take a result or a tool that says of itself that it must not be used.
        tool: tip.json of a pivot calibration: a tool on the tip.
        igtl: host (empty for ``host``) and port at which OpenIGTLink clients are served.
        host: address of that port; ``0.0.0.0`` lets anybody on the network read.
        igtl_name: the device name of these messages.
        udp: host and port to which JSON datagrams are sent.
        csv, parquet: files that record every pose.
        force: whether they may take the place of earlier recordings.
        seconds: how long from the first reading on, s; until it is stopped by default.
        rate: most poses a second of the device's clock; one for every frame by default.
        recalibrate: a file of points that do not move (`read_recalibration`): a rest on one of
            them shows how the zeros drift.
        payload: what the tip carries, kg, and its centre in the frame of the tip, m; what the
            samples of the result say, if they all say the same, by default.
    """

    arm: UrdfFile
    tip: str | None
    device: Path
    base: str | None = None
    result: Path | None = None
    anyway: bool = False
    tool: Path | None = None
    igtl: tuple[str, int] | None = None
    host: str = "127.0.0.1"
    igtl_name: str = "TipToBase"
    udp: tuple[str, int] | None = None
    csv: Path | None = None
    parquet: Path | None = None
    force: bool = False
    seconds: float | None = None
    rate: float | None = None
    chain: str = ""
    recalibrate: Path | None = None
    payload: tuple[float, float, float, float] | None = None

    def model(self) -> ArmModel:
        """What is tracked: the calibrated URDF, with what the job of the result says of the arm.

        That is where gravity points, and closed loops.

        Raises:
            InputError: no tip is given, or no one chain of the job.
        """
        if self.tip is not None and self.chain:
            raise InputError("a tip and a chain", "only one of them", where="--chain")
        if self.result is not None:
            try:
                origin = made_from(read_json_object(self.result), self.result, _OTHERWISE)
            except InputError:
                # The job may be gone where the tip is known.
                if self.tip is None:
                    raise
            else:
                return arm_of_job(origin).tracked(self.arm, self.chain, self.tip, self.base)
        if self.tip is None:
            expected = "--tip LINK, or --result RESULT.json of a job with this tip"
            raise InputError("no tip", expected, where="--tip")
        return ArmModel.from_urdf(self.arm, self.tip, self.base)


class Tracking:
    """Tracks an arm; a context manager, which ends with complete files.

    For example::

        with Tracking(TrackOptions(urdf, "tip", device, csv=log, seconds=10)) as tracking:
            tracking.run()
        tracking.session.last_valid

    Args:
        options: which arm, and where its poses go.

    Attributes:
        on_event: called with one sentence for everything that went wrong and went on; may be set.
        arm: the calibrated arm.
        device: the device.
        tool: on the tip.
        uncertainty: of the arm's calibration, the doubt about what that held among it, or None.
        payload: (4,) what the tip carries, kg and m, where the arm yields and it is known.
        recalibration: of the zeros, if that is asked for; the poses stay those of the calibration.
        session: counts, latency and the latest poses; there once the context is entered.
        events: everything that went wrong and went on, in order.
        interrupted: whether Ctrl-C ended it.

    Raises:
        UrdfError, DeviceFileError, InputError: a file that cannot be used, or a device that lacks
            a joint of the arm.
        OutputError: a recording that is there already, or that is one of the files that are read.
    """

    session: TrackingSession

    def __init__(self, options: TrackOptions) -> None:
        self.options = options
        recordings = [path for path in (options.csv, options.parquet) if path is not None]
        inputs = [options.arm, options.device, options.result, options.tool, options.recalibrate]
        check_outputs(recordings, inputs)
        for path in recordings:
            existing = next((p for p in (path, part_of(path)) if p.is_file()), None)
            if existing is not None and not options.force:
                raise OutputError(
                    f"{existing}: found an existing recording; expected the name of a new file; "
                    "choose another, or replace it with --force"
                )
        self.on_event: Callable[[str], None] = lambda _: None
        self.arm = options.model()
        self.device = read_device(options.device)
        self.uncertainty: CalibrationUncertainty | None = None
        if options.result is not None:
            calibration = read_uncertainty(options.result, self.arm, anyway=options.anyway)
            self.uncertainty = calibration.with_held(self.arm)
        self.tool = NO_TOOL
        if options.tool is not None:
            self.tool = read_tool(options.tool, anyway=options.anyway)
        self.payload, self._on_payload = self._carried()
        kinematics = TipKinematics(self.arm, self.tool, self.uncertainty, self.payload)
        self.recalibration: Recalibration | None = None
        correction, warmth = None, None
        if options.recalibrate is not None:
            if self.uncertainty is None:
                expected = "--result: the ± of the calibration that it begins with"
                raise InputError("--recalibrate alone", expected)
            spec = read_recalibration(options.recalibrate)
            self.recalibration = Recalibration(self.arm, self.uncertainty, spec, self.tool)
            correction = self.recalibration.correction
            if TEMPERATURE in self.device.extra_columns:
                warmth = self.device.extra_columns.index(TEMPERATURE)
        self._tracker = Tracker(
            *(self.arm, self.device.names, kinematics, options.device), correction, warmth
        )
        self.events: list[str] = []
        self.interrupted = False

        self._bus = Bus(self.device, reconnect=True, on_event=self._note)

    def _note(self, event: str) -> None:
        self.events.append(event)
        self.on_event(event)

    def _carried(self) -> tuple[FloatArray | None, str]:
        """What the tip carries, and what must be known of it, of an arm that yields."""
        given, calibration = self.options.payload, self.uncertainty
        beside = () if calibration is None else calibration.beside_geometry
        if not any(self.arm.offered[name].key in (COMPLIANCE, *BENDING) for name in beside):
            if given is not None:
                expected = "--result of an arm with compliances: a load moves no other arm"
                raise InputError("a payload", expected, where="--payload")
            return None, ""
        if given is not None:
            return np.array(given), ""
        assert calibration is not None
        try:
            job = load_job(read_json_object(calibration.path), calibration.path)
        except InputError:
            return None, (
                "The job of the result is not there. So the tip is taken to carry nothing, and "
                "gravity to point along -z of the root link. If it carries a load, give --payload."
            )
        chain = self.options.chain
        samples = [t.poses.samples for t in job.observations if t.poses.chain in ("", chain)]
        stated = [s.payload for s in samples if s.payload is not None]
        loads = np.unique(np.vstack([np.zeros((0, 4)), *stated]), axis=0)
        if len(loads) > 1:
            return None, (
                f"The samples state loads of {loads[0, 0]:g} to {loads[-1, 0]:g} kg. The tip is "
                "taken to carry nothing: give --payload if it does."
            )
        return (loads[0] if len(loads) else None), ""

    @property
    def notes(self) -> list[str]:
        """What must be known of the poses: of warmth, of joints that lag, and of a load."""
        values = {} if self.uncertainty is None else self.uncertainty.values
        about = (taken_as_cool, followed)
        notes = [say(self.arm.offered, values) for say in about]
        return [note for note in (*notes, self._on_payload) if note]

    @property
    def statistics(self) -> Statistics:
        """What was lost or damaged so far."""
        return self._bus.statistics

    def __enter__(self) -> Self:
        """Create the files, open the network's ports.

        Raises:
            OutputError: one of them cannot be had.
            InputError: a name of an OpenIGTLink device, or a host, that cannot be used.
            MissingExtraError: Parquet is asked for and pyarrow is not installed.
        """
        options, publishers = self.options, list[Publisher]()
        with ExitStack() as stack:
            if options.igtl is not None:
                host, port = options.igtl
                server = IgtlPublisher(port, options.igtl_name, host or options.host)
                publishers.append(stack.enter_context(server))
            if options.udp is not None:
                publishers.append(stack.enter_context(UdpPublisher(*options.udp)))
            for path, recorder in ((options.csv, CsvRecorder), (options.parquet, ParquetRecorder)):
                if path is not None:
                    check_folder(path.parent)
                    publishers.append(stack.enter_context(recorder(path, self.arm.joints)))
            if self.recalibration is not None:
                # Behind the others, which must not wait for it.
                even = not format_of(self.device).has_clock
                publishers.append(Docking(self.recalibration, self._note, even=even))
            self.session = TrackingSession(self._tracker, publishers, options.rate)
            self._publishers = stack.pop_all()
        for publisher in publishers:
            if public := getattr(publisher, "public", ""):
                self.on_event(f"everybody in the network can read the poses at {public}")
        return self

    def __exit__(self, *error: Any) -> None:
        self._publishers.__exit__(*error)

    def run(
        self,
        view: AbstractContextManager[object] | None = None,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Track until the time is over, ``stop`` says so, or Ctrl-C ends it.

        Args:
            view: shows the session; entered once the port is open.
            stop: asked again and again.

        Raises:
            DeviceError: the device cannot be opened, was never heard, or cannot be understood.
            OutputError: a file that cannot be written any more.
        """
        try:
            with low_latency(), self._bus as bus, view or nullcontext():
                self.session.run(bus, self.options.seconds, stop)
        except KeyboardInterrupt:
            self.interrupted = True

    def as_dict(self) -> dict[str, Any]:
        """What was tracked, and what happened, as JSON data."""
        calibration, statistics, load = self.uncertainty, self.statistics, self.payload
        last, live = self.session.last_valid, self.recalibration
        counts = {key: value for key, value in vars(statistics).items() if isinstance(value, int)}
        flags = {
            name: {"errors": int(errors), "warnings": int(warnings)}
            for name, errors, warnings in zip(
                statistics.joints, statistics.error_flags, statistics.warning_flags, strict=True
            )
        }
        uncertainty = calibration and {
            "source": SOURCE_WORDS[calibration.source],
            "parameters": list(calibration.names),
            "held": list(calibration.fixed),
            "held_within": list(calibration.counted),
            "tool_included": self.tool.std is not None,
        }
        return {
            "arm": str(self.arm.chain.path),
            "base": self.arm.chain.base,
            "tip": self.arm.tip,
            "device": str(self.device.path),
            "tool_mm": mm(self.tool.tip).tolist(),
            "uncertainty": uncertainty,
            "payload": None
            if load is None
            else {"mass_kg": float(load[0]), "position_mm": mm(load[1:]).tolist()},
            "notes": self.notes,
            **({} if live is None else {"recalibration": live.as_dict()}),
            **self.session.summary(),
            "last": last and pose_dict(last),
            "stream": counts | {"flags": flags},
            "events": self.events,
            "interrupted": self.interrupted,
        }
