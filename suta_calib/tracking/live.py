"""Tracking an arm on a cable: from files and addresses to published poses."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from suta_calib.atomic import check_folder, check_outputs
from suta_calib.device.bus import Bus
from suta_calib.device.device_file import read_device
from suta_calib.device.reading import Statistics
from suta_calib.display import Displayable
from suta_calib.errors import InputError, OutputError
from suta_calib.inputs import UrdfFile
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.igtl import IgtlPublisher
from suta_calib.tracking.provenance import tracked_ends
from suta_calib.tracking.publisher import Publisher, UdpPublisher, pose_dict
from suta_calib.tracking.recording import CsvRecorder, ParquetRecorder, part_of
from suta_calib.tracking.session import TrackingSession, low_latency
from suta_calib.tracking.tracker import NO_TOOL, TipKinematics, Tracker, followed, read_tool
from suta_calib.tracking.uncertainty import SOURCE_WORDS, CalibrationUncertainty, read_uncertainty
from suta_calib.trust.tip import taken_as_cool
from suta_calib.units import mm


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

    def ends(self) -> tuple[str, str | None]:
        """Tip and base of what is tracked.

        Raises:
            InputError: no tip is given, or no one chain of the job.
        """
        if self.tip is not None:
            if self.chain:
                raise InputError("a tip and a chain", "only one of them", where="--chain")
            return self.tip, self.base
        if self.result is None:
            expected = "--tip LINK, or --result RESULT.json of a job with this tip"
            raise InputError("no tip", expected, where="--tip")
        tip, base = tracked_ends(self.result, self.chain)
        return tip, self.base or base


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
        check_outputs(recordings, [options.arm, options.device, options.result, options.tool])
        for path in recordings:
            existing = next((p for p in (path, part_of(path)) if p.is_file()), None)
            if existing is not None and not options.force:
                raise OutputError(
                    f"{existing}: found an existing recording; expected the name of a new file; "
                    "choose another, or replace it with --force"
                )
        self.on_event: Callable[[str], None] = lambda _: None
        self.arm = ArmModel.from_urdf(options.arm, *options.ends())
        self.device = read_device(options.device)
        self.uncertainty: CalibrationUncertainty | None = None
        if options.result is not None:
            calibration = read_uncertainty(options.result, self.arm, anyway=options.anyway)
            self.uncertainty = calibration.with_held(self.arm)
        self.tool = NO_TOOL
        if options.tool is not None:
            self.tool = read_tool(options.tool, anyway=options.anyway)
        kinematics = TipKinematics(self.arm, self.tool, self.uncertainty)
        self._tracker = Tracker(self.arm, self.device.names, kinematics, options.device)
        self.events: list[str] = []
        self.interrupted = False

        def note(event: str) -> None:
            self.events.append(event)
            self.on_event(event)

        self._bus = Bus(self.device, reconnect=True, on_event=note)

    @property
    def warmth(self) -> str:
        """What must be known of an arm whose lengths grow with warmth; empty for any other."""
        calibration = self.uncertainty
        return "" if calibration is None else taken_as_cool(self.arm.offered, calibration.values)

    @property
    def lag(self) -> str:
        """What must be known of an arm whose joints lag by where they came from; else empty."""
        calibration = self.uncertainty
        return "" if calibration is None else followed(self.arm.offered, calibration.values)

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
        calibration, statistics = self.uncertainty, self.statistics
        last = self.session.last_valid
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
            "notes": [note for note in (self.warmth, self.lag) if note],
            **self.session.summary(),
            "last": last and pose_dict(last),
            "stream": counts | {"flags": flags},
            "events": self.events,
            "interrupted": self.interrupted,
        }
