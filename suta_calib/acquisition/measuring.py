"""Measuring one placement of an artefact, or one fixed point, with an arm on a cable."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field, replace
from itertools import count, islice
from pathlib import Path
from typing import Any, Literal

import numpy as np

from suta_calib.acquisition.continuous import Continuous, Swept, time_columns
from suta_calib.acquisition.extra_columns import ExtraColumns
from suta_calib.acquisition.guided import Guided, Keyboard, Keys
from suta_calib.acquisition.pictures import (
    FOLDER,
    IMAGE,
    RestPictures,
    Seen,
    SoughtBoard,
    narrow_postures,
    nothing_seen,
)
from suta_calib.acquisition.raw import RawRecorder
from suta_calib.acquisition.replay import RecordedStream, RecordingEnded
from suta_calib.acquisition.rest import DEFAULT_REST, RestSettings
from suta_calib.acquisition.run import Run, SamplesFile
from suta_calib.acquisition.seating_check import Visit
from suta_calib.acquisition.session import (
    ArmReadings,
    Finder,
    Sampler,
    StreamEvents,
    run_session,
    summary_lines,
)
from suta_calib.acquisition.session_events import (
    ConsoleListener,
    Listener,
    Live,
    Opened,
    Said,
    SessionEvent,
)
from suta_calib.acquisition.stops import StopFinder
from suta_calib.acquisition.sweep_contact import Surface
from suta_calib.acquisition.touch_sequence import (
    ONE_POINT,
    Station,
    TouchSequence,
    checked_label,
    kinds_of,
    place_option,
    read_arm,
    read_row,
    repeated,
    touched,
)
from suta_calib.acquisition.unattended import Unattended
from suta_calib.arrays import FloatArray
from suta_calib.atomic import check_folder, check_outputs, only_writer
from suta_calib.device.bus import Bus
from suta_calib.device.description import DeviceSpec
from suta_calib.device.device_file import read_device
from suta_calib.device.formats import format_of
from suta_calib.device.port_process import PortProcess
from suta_calib.device.reading import Reading
from suta_calib.display import Displayable
from suta_calib.errors import InputError, MissingExtraError, SamplesError
from suta_calib.inputs import UrdfFile
from suta_calib.job.outline import read_outline
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.measurements.files import expand
from suta_calib.optional_packages import load
from suta_calib.simulation.schema import PORTABLE_NAME
from suta_calib.terms import KINDS, Term
from suta_calib.units import deg
from suta_calib.words import listed

Status = Literal["complete", "incomplete", "interrupted"]


@dataclass(frozen=True)
class MeasureOptions(Displayable):
    """What is to be measured, and how: one label, or ``free``.

    Attributes:
        job: the calibration.yaml that samples are taken for; they need not exist yet.
        device: the device.yaml; None where there is a recording.
        labels: by sort of place (``placement``, ``point``, ``plane``, …), the label of the one
            that is touched: ``{"placement": "P1"}``.
        free: readings only, with no label: wherever the arm rests.
        repeat: which time this is measured.
        seconds: how long the arm's rest on each landmark is recorded, s: so long that a hand's
            tremor and the encoders' noise average out.
        rests: how many rests, where no artefact is touched.
        continuous: sample for so long while the arm moves, s, in place of rests; inf until a key
            is pressed.
        every: least time between two samples of ``continuous``, s.
        recording: readings that were recorded, in place of a device; see `RecordedStream`.
        out: the CSV; among the job's samples by default.
        sequence: landmarks in order; all of the artefact's by default.
        observation: which of the job's: a number, a name such as ``validation[0]``, or a kind.
        resume: go on after the last confirmed landmark.
        unattended: ask nothing: each rest after a motion is the next one.
        attended: as unattended, but somebody follows it and may press keys; the first rest counts
            once the arm has moved.
        patience: how long nothing may happen before it is given up, s; a minute where nobody
            is asked, for ever otherwise.
        raw: where the whole stream goes, as Parquet.
        urdf: for the distances that are shown; the job's by default.
        rest: what counts as rest.
        chain: which of several chains of the job's robot is measured.
        camera: ``NAME=SOURCE`` of a camera that takes a picture at each rest; samples and pictures
            go to the folder of this name beside the job (`RestPictures`). Where the job has a row
            of this camera with a board, rests count in which it is seen, and its corners are
            found (`SoughtBoard`).
    """

    job: Path
    device: Path | None = None
    labels: Mapping[str, str] = field(default_factory=dict)
    free: bool = False
    repeat: str = "1"
    seconds: float = 2.0
    rests: int = 20
    continuous: float | None = None
    every: float = 0.0
    out: Path | None = None
    sequence: tuple[str, ...] | None = None
    observation: str | None = None
    resume: bool = False
    unattended: bool = False
    attended: bool = False
    patience: float | None = None
    raw: Path | None = None
    urdf: UrdfFile | None = None
    rest: RestSettings = DEFAULT_REST
    chain: str = ""
    recording: Path | None = None
    camera: str | None = None

    def check(self) -> None:
        """Refuse options that contradict each other.

        Raises:
            InputError: they do.
        """
        given = [*(f"--{place}" for place in self.labels), *(["--free"] if self.free else [])]
        if len(given) != 1:
            chosen = " and ".join(given) or "none of the three"
            raise InputError(chosen, "one of --placement LABEL, --point LABEL and --free")
        if (self.device is None) == (self.recording is None):
            found = "both" if self.device else "neither"
            raise InputError(found, "one of --device device.yaml and --recording FILE")
        if self.recording is not None and self.raw is not None:
            raise InputError("--raw with --recording", "--raw with --device")
        placed = "placement" in self.labels
        if placed and self.continuous is not None:
            raise InputError("--continuous with --placement", "--point or --free")
        if not placed and self.sequence is not None:
            raise InputError("--sequence without --placement", "both")
        checked_label(self.repeat, "--repeat")
        if self.camera is not None:
            name, _, source = self.camera.partition("=")
            if not (PORTABLE_NAME.fullmatch(name) and source):
                expected = "NAME=NUMBER, such as wrist=0; the name is that of a folder"
                raise InputError(repr(self.camera), expected, where="--camera")
            if not self.free or self.continuous is not None or self.recording is not None:
                expected = "--free and --device: the camera takes a picture at each rest"
                raise InputError("--camera", expected)

    @property
    def camera_files(self) -> tuple[str, Path] | None:
        """Where pictures come from, and the folder of their samples; None without a camera."""
        if self.camera is None:
            return None
        name, _, source = self.camera.partition("=")
        return source, self.job.parent / name


@dataclass(frozen=True)
class Measured(Displayable):
    """What one call of `measure` left behind.

    Attributes:
        status: ``complete``; ``incomplete`` where patience ended it; ``interrupted`` by Ctrl-C.
        file: the samples file.
        samples: how many rows of it are this run's.
        happened: what became of the stream, in sentences.
        missing: names of the stations without a sample; None while sampling a motion.
        look_at: what the user should look at again, by station; None likewise.
        sweep: what a motion without stops left; None of rests.
    """

    status: Status
    file: Path
    samples: int
    happened: tuple[str, ...] = ()
    missing: tuple[str, ...] | None = None
    look_at: dict[str, str] | None = None
    sweep: Swept | None = None

    def as_dict(self) -> dict[str, Any]:
        """As JSON data."""
        given = {key: value for key, value in vars(self).items() if value is not None}
        if self.sweep is not None:
            given["sweep"] = self.sweep.as_dict()
        return {**given, "file": str(self.file)}


def measure(
    options: MeasureOptions,
    *,
    say: Callable[[str], None] = print,
    show: Callable[[str], None] | None = None,
    keyboard: Keys | None = None,
    port: PortProcess | None = None,
    listen: Listener | None = None,
) -> Measured:
    """Wait until the arm rests on each landmark, record it, and write it to the samples file.

    Whatever happens then, what was confirmed is there. Nothing that was measured is ever
    overwritten.

    Args:
        options: what is to be measured.
        say: shows the user a line.
        show: shows what the arm does at the moment, again and again, in place of the last.
        keyboard: where keys come from unless ``options.unattended``; standard input by default.
        port: the device's, where somebody has begun to open it; closed in the end.
        listen: told all that happens, beside the console.

    Returns:
        What was measured; also after Ctrl-C, once the port was opened.

    Raises:
        InputError, JobError: options that contradict each other, or files that cannot be used.
        DeviceError: a device that does not answer.
        OutputError: a disk that is full.
    """
    with ExitStack() as stack:
        if port is not None:
            stack.callback(port.close)
        options.check()
        spec = None if options.device is None else read_device(options.device)
        recording = None
        if spec is None:
            assert options.recording is not None
            recording = RecordedStream(
                options.recording, [n for k in KINDS.values() for n in k.sent]
            )
            spec = recording.spec
        plan, out, surface = _plan(options, spec.extra_columns)
        if note := stated_elsewhere(options):
            say(note)
        joints = plan.arm.joints
        if recording is not None:
            recording.use(joints)
            spec = recording.spec
        check_folder(out.parent)
        raw = [] if options.raw is None else [options.raw]
        inputs = [options.job, options.device, options.recording, options.urdf]
        check_outputs([out, *raw], inputs)
        stack.enter_context(only_writer(out))
        choose = ArmReadings(spec, joints)
        columns = plan.label_columns
        if (twice := set(columns) & set(spec.extra_columns)) != set():
            raise InputError(
                f"{min(twice)!r}, which is a label of these samples",
                "another name",
                file=spec.path,
                where="extra_columns",
            )
        see = nothing_seen
        if options.camera_files is not None:
            source, folder = options.camera_files
            sought = SoughtBoard.of(options.job, folder.name)
            pictures = RestPictures(source, folder / FOLDER, sought)
            see = stack.enter_context(closing(pictures))
            columns = (*columns, IMAGE)
        # What is felt in motion is more than what is wanted of a rest.
        in_motion = options.continuous is not None
        columns = (*columns, *(time_columns(joints) if in_motion else spec.extra_columns))
        file = SamplesFile(out, joints, columns, plan.key, resume=options.resume)
        listeners: list[Listener] = [ConsoleListener(say, show)]
        listeners += [] if listen is None else [listen]
        session = _Session(
            *(options, plan, surface, spec, file, listeners, see), quiet=show is not None
        )
        bus: Bus | RecordedStream
        bus = recording or Bus(spec, reconnect=True, on_event=session.note, port=port)
        return session.run(stack.enter_context(closing(bus)), choose, keyboard)


def stated_elsewhere(options: MeasureOptions) -> str:
    """What to say of a label that the job states no pose of, before any that it does is measured.

    Raises:
        InputError: the job cannot be used.
    """
    for place, label in options.labels.items():
        row = read_row(options.job, options.observation, kinds_of(place), options.chain)
        stated = [name for name in row.given if name]
        if not stated or label in stated:
            continue
        if not any(row.file(name, options.repeat).exists() for name in (label, *stated)):
            return (
                f"{options.job} states the pose of {listed(stated)}, but not of {label}: if this "
                f"{place} stands there, give --{place} {stated[0]}"
            )
    return ""


def stations_of(options: MeasureOptions) -> tuple[TouchSequence, tuple[Station, ...]]:
    """What would be measured, and which of its stations have no sample yet.

    Raises:
        InputError, JobError: as of `measure`.
    """
    columns = () if options.device is None else read_device(options.device).extra_columns
    plan, out, _ = _plan(options, columns)
    labels = (*plan.label_columns, *columns)
    file = SamplesFile(out, plan.arm.joints, labels, plan.key, resume=True)
    missing = Run(plan, file, lambda _: None).missing
    return plan, tuple(station for station in plan.stations if station.name in missing)


def earlier_visits(options: MeasureOptions, plan: TouchSequence) -> dict[str, list[Visit]]:
    """Touches of the same placement or point in other repeats, by landmark, or the empty name."""
    visits = dict[str, list[Visit]]()
    if plan.artefact is None and plan.place != ONE_POINT:
        return visits
    ((place, label),) = options.labels.items()
    row = read_row(options.job, options.observation, kinds_of(place), options.chain)
    # What cannot be read is said where it is calibrated with.
    with suppress(SamplesError):
        for file in expand(row.pattern, options.job.parent):
            table = read_csv_table(file)
            names = [place, "repeat", *(["landmark"] if plan.artefact is not None else [])]
            labels = [table.labels(name, "a label column") for name in names]
            q = np.stack([table.numbers(j, "one column per joint") for j in plan.arm.joints], 1)
            for angles, (of, repeat, *mark) in zip(q, zip(*labels, strict=True), strict=True):
                if of == label and repeat != options.repeat:
                    visit = Visit(f"repeat {repeat}", angles)
                    visits.setdefault("".join(map(str, mark)), []).append(visit)
    return visits


class _Session:
    """One call of `measure`: who takes samples of what, and what is said of it."""

    def __init__(
        self,
        options: MeasureOptions,
        plan: TouchSequence,
        surface: Surface | None,
        spec: DeviceSpec,
        file: SamplesFile,
        listeners: Sequence[Listener],
        see: Seen,
        *,
        quiet: bool,
    ) -> None:
        self._options, self._plan, self._spec, self._file = options, plan, spec, file
        self._listeners = listeners
        self._angles: FloatArray | None = None
        self._heard = time.monotonic()
        self._events = StreamEvents()
        self._lines: list[str] = []
        self._run: Run | None = None
        self._shown = -math.inf
        self._sampler: Sampler
        self._finder: Finder
        if options.continuous is not None:
            unknowns = None
            if names := read_outline(options.job).unknowns:
                unknowns = plan.arm.select(*names)
            self._sampler = self._finder = Continuous(
                *(plan, file, self._say, options.continuous, options.every),
                surface=surface,
                unknowns=unknowns,
                quiet=quiet,
            )
            return
        even = not format_of(spec).has_clock
        extra = ExtraColumns(spec.extra_columns, _kinds_over(spec.extra_columns), file.numbers)
        finder = StopFinder(plan.arm.joints, options.seconds, options.rest, even=even, extra=extra)
        visits = earlier_visits(options, plan)
        self._run = Run(plan, file, self._say, self._tell_stations, see, visits)
        self._finder = finder
        self._tell(Opened(plan, options.seconds))
        self._tell_stations()
        # Nobody can answer as fast as a recording is read.
        if options.unattended or options.attended or options.recording is not None:
            self._sampler = Unattended(
                self._run, finder, options.seconds, attended=options.attended
            )
        else:
            self._sampler = Guided(self._run, finder, options.seconds)

    def _tell(self, event: SessionEvent) -> None:
        for listener in self._listeners:
            listener(event)

    def _say(self, text: str) -> None:
        self._tell(Said(text))

    def note(self, message: str) -> None:
        """Something went wrong with the device, and it went on."""
        self._events.messages.append(message)
        # A clock that was set anew hides how long the stream was cut.
        if isinstance(self._finder, StopFinder):
            self._finder.interrupt()
        self._say(message)

    def run(
        self, bus: Bus | RecordedStream, choose: ArmReadings, keyboard: Keys | None
    ) -> Measured:
        options = self._options
        if self._sampler.done:
            self._say(f"nothing left to measure: {self._file.path} contains every station")
            return self._measured("complete")
        patience = options.patience
        if patience is None:
            # Unattended, nobody is there to see that nothing happens any more.
            patience = 60.0 if options.unattended else math.inf
        try:
            with ExitStack() as stack:
                record = None
                if (raw := self._raw()) is not None:
                    names, extra = self._spec.names, self._spec.extra_columns
                    recorder = RawRecorder(raw, names, self._say, extra)
                    record = stack.enter_context(recorder).write
                if not options.unattended:
                    keyboard = stack.enter_context(keyboard or Keyboard())
                    if isinstance(self._sampler, Continuous) and keyboard.terminal:
                        self._say("sweep the arm; Enter or q ends")
                stack.callback(self._conclude, bus)
                stack.enter_context(bus)
                # A recording that has ended is all there is.
                stack.enter_context(suppress(RecordingEnded))
                finished = False
                finished = run_session(
                    bus,
                    choose,
                    self._finder,
                    self._sampler,
                    events=self._events,
                    idle=lambda reading: self._idle(keyboard, reading),
                    record=record,
                    patience=patience,
                )
        except KeyboardInterrupt:
            return self._measured("interrupted")
        if options.recording is not None:
            finished = self._sampler.done or isinstance(self._sampler, Continuous)
        return self._measured("complete" if finished else "incomplete")

    def _raw(self) -> Path | None:
        """Where the whole stream goes: a sweep's always, as nobody can sweep alike again."""
        options, out = self._options, self._file.path
        if options.raw is not None or options.continuous is None or options.recording is not None:
            return options.raw
        try:
            load("pyarrow", "parquet")
        except MissingExtraError as error:
            self._say(f"the readings between the samples are not recorded: {error}")
            return None
        out.parent.mkdir(parents=True, exist_ok=True)
        names = (out.with_name(f"{out.stem}_{k}.parquet") for k in count(2))
        first = out.with_suffix(".parquet")
        return next(path for path in (first, *islice(names, 1000)) if not path.exists())

    def _idle(self, keyboard: Keys | None, reading: Reading | None) -> None:
        """Between two reads: keys, and what the arm does."""
        sampler = self._sampler
        if reading is not None:
            self._angles, self._heard = reading.angles, time.monotonic()
        if isinstance(sampler, Continuous):
            self._idle_in_motion(sampler, keyboard)
            return
        if isinstance(sampler, Guided) and keyboard is not None:
            # Where no one sits at the keys, a line waits until it is asked for.
            key = keyboard.key() if keyboard.terminal or sampler.asking else None
            if key is not None:
                sampler.press(key)
        elif isinstance(sampler, Unattended) and keyboard is not None and keyboard.terminal:
            while (key := keyboard.key()) is not None:
                sampler.press(key)
        finder, run = self._finder, self._run
        assert isinstance(finder, StopFinder)
        doing = f"resting {finder.recorded:.1f} of {self._options.seconds:g} s"
        if not finder.resting:
            doing = "moving"
        elif isinstance(sampler, Guided) and sampler.asking:
            doing = "resting, waiting for a key"
        if run is not None and not run.done:
            doing += f" · next: {run.station.name}"
        silence = time.monotonic() - self._heard
        self._tell(Live(doing, self._angles, finder.resting, finder.recorded, silence))

    def _tell_stations(self) -> None:
        """Which are measured."""
        if self._run is not None:
            self._tell(self._run.state)

    def _idle_in_motion(self, sampler: Continuous, keyboard: Keys | None) -> None:
        """A key may end a sweep; how far it is, is shown once a second."""
        if keyboard is not None and keyboard.terminal and (key := keyboard.key()) is not None:
            sampler.press(key)
        now = time.monotonic()
        if now - self._shown > 1.0:
            self._shown = now
            self._tell(Live(sampler.doing(), self._angles, False, 0.0, now - self._heard))

    def _conclude(self, bus: Bus | RecordedStream) -> None:
        """Also after Ctrl-C or a lost device: say what there is."""
        if not self._events.readings:
            return
        self._lines = summary_lines(self._events, bus.statistics, self._spec)
        if isinstance(self._sampler, Continuous):
            self._lines = [*self._sampler.conclude(), *self._lines]
        rows = len(self._file.rows)
        recorded = f"{rows} sample{'s' * (rows != 1)} in {self._file.path}"
        self._say(recorded if rows else "no samples recorded")
        if not rows and isinstance(self._finder, StopFinder) and self._finder.restless:
            rest = self._options.rest
            self._say(
                f"the arm was never at rest: within {rest.window:g} s, "
                f"{', '.join(self._finder.restless)} drifted by more than {deg(rest.drift):.2g} "
                f"deg or trembled by more than {deg(rest.tremble):.2g} deg. Seat it firmly and "
                "let go, or allow more motion with --drift-deg or --tremble-deg"
            )
        if self._options.camera is not None:
            angles = [angles for _, angles in self._file.rows]
            if advice := narrow_postures(self._plan.arm.joints, angles):
                self._say(advice)
        if rows and self._run is not None and not self._run.done:
            self._say("run the same command with --resume to continue after the last sample")
        for line in self._lines:
            self._say(line)

    def _measured(self, status: Status) -> Measured:
        run, file = self._run, self._file
        measured = Measured(status, file.path, len(file.rows), tuple(self._lines))
        if isinstance(self._sampler, Continuous):
            return replace(measured, sweep=self._sampler.swept)
        if run is None:
            return measured
        if run.missing:
            how = "they can still be measured"
            if run.done:
                again = f"measure them with --resume --sequence {','.join(run.missing)}"
                how = "continue with --resume" if run.seating is None else again
            self._say(f"missing: {', '.join(run.missing)}; {how}")
        for name, note in run.notes.items():
            self._say(f"check {name}: {note}")
        return replace(measured, missing=run.missing, look_at=run.notes)


def _kinds_over(columns: Sequence[str]) -> list[type[Term]]:
    """Kinds of observation that are measured at rest by these columns alone."""
    # Loading the kinds takes a second, in which the arm may be leaving its first posture.
    kinds = KINDS.values() if columns else ()
    return [kind for kind in kinds if kind.sent and {*kind.sent} <= {*columns}]


def _plan(
    options: MeasureOptions, columns: Sequence[str]
) -> tuple[TouchSequence, Path, Surface | None]:
    """What to measure, where it goes, and the place that a sweep goes over.

    ``columns`` are what the device sends beside the joints. Where an observation of the job is made
    of them, what is measured at free rests is of that observation.
    """
    if options.free:
        chain = options.chain, ""
        out = options.job.parent / f"free_{options.repeat}.csv"
        if options.camera_files is not None:
            out = options.camera_files[1] / "samples.csv"
        resting = options.continuous is None
        kinds = [kind.kind for kind in _kinds_over(columns) if resting]
        if kinds and any(row.kind in kinds for row in read_outline(options.job).rows):
            row = read_row(options.job, options.observation, kinds, options.chain)
            chain, out = row.chain, row.file("free", options.repeat)
        arm = read_arm(options.job, options.urdf, chain)
        plan = repeated(arm, None, None, options.repeat, options.rests)
        return plan, options.out or out, None
    ((place, label),) = options.labels.items()
    row = read_row(options.job, options.observation, kinds_of(place), options.chain)
    if row.kind not in kinds_of(place):
        places = dict.fromkeys(kind.place for kind in KINDS.values() if kind.place)
        flag = place_option(KINDS[row.kind]) if row.kind in KINDS else ""
        raise InputError(
            f"an observation of kind {row.kind}",
            ", ".join(f"{' or '.join(kinds_of(place))} for --{place}" for place in places),
            file=options.job,
            where="--observation",
            hint=f"use {flag or '--free, and add what was seen to the file'}",
        )
    arm = read_arm(options.job, options.urdf, row.chain)
    if row.artefact is None:
        plan = repeated(arm, KINDS[row.kind], label, options.repeat, options.rests)
    else:
        plan = touched(arm, row, label, options.repeat, options.sequence)
    surface = None
    if row.kind in KINDS and Surface.testable(KINDS[row.kind]):
        surface = Surface(arm, KINDS[row.kind], row.settings)
    return plan, options.out or row.file(label, options.repeat), surface
