"""Leads through a measurement: one session after the other, shown on the page and driven by it.

What takes readings and decides which rest is which sample is `acquisition`; here its events become
what the page shows, and the page's buttons become keys.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from itertools import chain, count
from queue import Empty
from types import MappingProxyType
from typing import Any, Final

from suta_calib.acquisition.measuring import Measured, MeasureOptions, measure, stations_of
from suta_calib.acquisition.session_events import (
    Live,
    Opened,
    Said,
    SessionEvent,
    Stations,
    StationState,
)
from suta_calib.acquisition.touch_sequence import kinds_of, read_row
from suta_calib.arrays import FloatArray
from suta_calib.device.device_file import read_device
from suta_calib.errors import DeviceError, InputError, JobError, SamplesError
from suta_calib.guide.calibrating import GuidedCalibration
from suta_calib.guide.determined import NextPlace, SoFar
from suta_calib.guide.emulating import emulated_arm, emulated_sensors, job_to_try
from suta_calib.guide.page import GuidePage, PageKeys
from suta_calib.guide.work import Unanswered, Worker
from suta_calib.job.outline import read_outline
from suta_calib.measurements import Artefact
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.measurements.files import expand
from suta_calib.optional_packages import require
from suta_calib.simulation import PoseSpec
from suta_calib.terms import KINDS
from suta_calib.units import mm, std_text
from suta_calib.view.measuring import Mark, MarkStatus, MeasuredArm

_MEASURING: Final = (
    ("retake", "Retake"),
    ("skip", "Skip"),
    ("take", "Take now"),
    ("stop", "Stop"),
)


@dataclass(frozen=True)
class GuideOptions:
    """What is measured, and who may look.

    Attributes:
        measuring: as of `measure`; without labels, the next one that is not measured yet.
        emulate: whether an arm is emulated, in a copy of the job.
        port, host: of the page.
    """

    measuring: MeasureOptions
    emulate: bool = False
    port: int = 8080
    host: str = "127.0.0.1"


class Guide:
    """One run of the page, from its start to the end.

    Args:
        options: what is measured.
        say: shows the console a line.
        opened: called with the page's address once it is there, and so is the device.

    Raises:
        InputError: options or a job that cannot be used.
        MissingExtraError: the extra ``view`` is not installed.
        OutputError: the port is taken.
    """

    def __init__(
        self,
        options: GuideOptions,
        say: Callable[[str], None],
        opened: Callable[[str], None] = lambda _: None,
    ) -> None:
        require("viser", "view")
        measuring = options.measuring
        if (measuring.device is None) != options.emulate:
            found = "neither" if measuring.device is None else "both"
            raise InputError(found, "one of --device device.yaml and --emulate")
        if options.emulate:
            if not measuring.free:
                # What is wrong is said of the job, not of its copy.
                next_label(measuring, next(iter(measuring.labels), ""))
            measuring = replace(measuring, job=job_to_try(measuring.job))
            measuring = replace(measuring, device=emulated_sensors(measuring))
        assert measuring.device is not None
        read_device(measuring.device)
        self._emulate, self._say = options.emulate, say
        self._opened: Callable[[str], None] | None = opened
        self._options = replace(measuring, attended=True, resume=True)
        if not self._options.labels and not self._options.free:
            self._options = replace(self._options, labels=next_label(self._options))
        self._options.check()
        plan, _ = stations_of(self._options)
        self.page = GuidePage(self._options.job.resolve().parent.name)
        self._arm = MeasuredArm(
            self._options.job.name, plan.arm, options.port, options.host, self.page
        )
        self._artefact: Artefact | None = None
        self._stations: Stations | None = None
        self._worst: Mark | None = None
        self._planned: NextPlace | None = None
        self._missing: tuple[str, ...] = ()
        self._following: MeasureOptions | None = None
        self._goals: tuple[tuple[str, FloatArray], ...] = ()
        self._lines: list[str] = []
        self._drawn = 0.0
        self._doubted: set[str] = set()
        self._worker: Worker

    def run(self) -> None:
        """Measure until somebody has had enough.

        Raises:
            DeviceError: a device that is not there at the start.
            OutputError: a disk that is full.
        """
        with ExitStack() as stack:
            stack.enter_context(self._arm)
            self._worker = stack.enter_context(Worker(self._answered))
            self._worker.ask("determined", self._options.job)
            first = True
            while True:
                try:
                    measured = self._measure()
                except DeviceError as error:
                    if first:
                        raise
                    again = _buttons((("again", "Try again"), ("end", "End")))
                    self.page.show(phase="lost", headline=str(error), buttons=again, live=None)
                    if self._wait("again", "end") == "end":
                        return
                    continue
                first = False
                self._open()
                if measured is not None and measured.status == "interrupted":
                    raise KeyboardInterrupt
                if not self._after(measured):
                    return

    def _open(self) -> None:
        """Say where the page is, once there is something to see."""
        opened, self._opened = self._opened, None
        if opened is not None:
            opened(self._arm.url)

    # ── measuring ───────────────────────────────────────────────────────────────────────────
    def _measure(self) -> Measured:
        """One session of `measure`, which is what the page shows."""
        label = _label(self._options)
        self._planned, planned = None, self._planned
        self.page.show(
            phase="measuring", label=label, plan=None, verdict=None, buttons=_buttons(_MEASURING)
        )
        if planned is not None:
            self._arm.show_goal(planned.readings)
        with self._emulated(planned):
            keys = PageKeys(self.page)
            return measure(self._options, say=self._say, keyboard=keys, listen=self._listen)

    @contextmanager
    def _emulated(self, planned: NextPlace | None) -> Iterator[None]:
        """The emulated arm, if one was asked for, for as long as a session lasts."""
        self._goals = ()
        if not self._emulate:
            yield
            return
        place = None if planned is None else PoseSpec(planned.rotation, planned.position)
        _, left = stations_of(self._options)
        with ExitStack() as stack:
            what = f"the emulated arm: looking for its postures at {len(left)} places"
            with said_every_few_seconds(what, self._say):
                postures = stack.enter_context(emulated_arm(self._options, place, left))
            if self._options.free:
                self._goals = tuple(zip((s.name for s in left), postures, strict=True))
            yield

    def _listen(self, event: SessionEvent) -> None:
        match event:
            case Said():
                # Sentences that the page shows.
                self._lines = [*self._lines, event.text][-8:]
                self.page.show(lines=self._lines)
            case Opened():
                self._artefact = event.plan.artefact
                self._doubted = set()
                self._seconds = event.seconds
                ask = (
                    "Rest in a posture unlike the others"
                    if self._options.free
                    else "Bring the tip to"
                )
                self.page.show(ask=ask, how=event.plan.how, map=_map(event.plan.artefact))
                self.page.show(alert=None)
            case Stations():
                self._take_stations(event)
            case Live():
                self._draw(event)

    def _take_stations(self, stations: Stations) -> None:
        before, self._stations = self._stations, stations
        rows = [(_place(s.name), s.status, s.doubt) for s in stations.states]
        self.page.show(stations=rows)
        doubted = {s.name: s.doubt for s in stations.states if s.doubt and s.status != "next"}
        new = [name for name in doubted if name not in self._doubted]
        self._doubted = set(doubted)
        changed = before is not None and _taken(before) != _taken(stations)
        if new:
            self.page.show(alert=_alert(_place(new[-1]), doubted[new[-1]]))
        elif changed or not doubted:
            # It is being taken again, or was left as it is.
            self.page.show(alert=None)
        self._mark()
        if changed:
            self._worker.ask("determined", self._options.job)
        if self._options.free:
            self._show_goal(dict(self._goals).get(stations.next))
            if not self._emulate:
                self._worker.ask("posture", self._options.job)
        elif changed:
            self._arm.show_goal(None)

    def _show_goal(self, readings: FloatArray | None) -> None:
        """Where the arm is to go, if that is known."""
        self._arm.show_goal(readings)
        if readings is not None:
            self.page.show(ask="Bring the arm to where the pink one is")

    def _draw(self, live: Live) -> None:
        now = time.monotonic()
        # How often the arm is drawn, s.
        if now - self._drawn < 0.05:
            return
        self._drawn = now
        if live.angles is not None:
            self._open()
            self._arm.move(live.angles)
        share = min(live.recorded / self._seconds, 1.0) if live.resting else 0.0
        shown_live = {
            "resting": live.resting,
            "share": round(share, 2),
            "silence": round(live.silence, 1),
            "readings": live.angles is not None,
        }
        if shown_live != self.page.shown("live"):
            self.page.show(live=shown_live)

    def _mark(self) -> None:
        """The places in the scene: what was touched, what is next, what is planned."""
        marks = list[Mark]()
        stations = self._stations
        if stations is not None:
            status = {state.name: _mark_status(state) for state in stations.states}
            if stations.placed is not None and self._artefact is not None:
                places = dict(zip(self._artefact.landmarks, stations.placed, strict=True))
            else:
                places = dict(stations.tips)
            marks = [
                Mark(name, place, status.get(name, "open"))
                for name, place in places.items()
                if name in status
            ]
        if self._worst is not None:
            marks.append(self._worst)
        if self._planned is not None:
            names = ["here", *[""] * (len(self._planned.landmarks) - 1)]
            marks += [
                Mark(name, place, "planned")
                for name, place in zip(names, self._planned.landmarks, strict=True)
            ]
        self._arm.mark(marks)

    # ── between ─────────────────────────────────────────────────────────────────────────────
    def _after(self, measured: Measured | None) -> bool:
        """What becomes of a session that has ended; whether another one follows."""
        self._missing = () if measured is None else measured.missing or ()
        label = _label(self._options)
        headline = f"{label} is complete"
        if self._missing:
            headline = f"{label}: {_few(self._missing)} missing"
        if measured is not None and measured.look_at:
            headline += f". Look at {_few(tuple(measured.look_at))} again"
        while True:
            self._arm.show_goal(None)
            self._follow(next(iter(self._options.labels), ""))
            self.page.show(plan={"waiting": True}, phase="between", headline=headline, live=None)
            self._offer()
            self._worker.ask("posture" if self._options.free else "next", self._options.job)
            pressed = self._wait("next", "missing", "finish", "end")
            if pressed == "finish":
                pressed = self._calibrate()
            if pressed == "end":
                return False
            if pressed == "missing":
                sequence = None if self._artefact is None else self._missing
                self._options = replace(self._options, sequence=sequence)
                self._planned = None
                return True
            if pressed == "next" and self._following is not None:
                if self._planned is not None and self._planned.sort not in _sort(self._following):
                    self._planned = None
                if self._planned is not None and self._planned.count:
                    self._following = replace(self._following, rests=self._planned.count)
                self._options = self._following
                return True

    def _follow(self, sort: str) -> bool:
        """Offer a new place of this sort next, if the job has a row for one; whether it has."""
        options, self._following = replace(self._options, sequence=None), None
        if options.free:
            number = int(options.repeat) if options.repeat.isdecimal() else 1
            repeats = (replace(options, repeat=str(k)) for k in count(number + 1))
            self._following = next(each for each in repeats if stations_of(each)[1])
            return not sort
        try:
            labels = next_label(options, sort, after=options.labels)
        except JobError:
            return False
        self._following = replace(options, labels=labels)
        return True

    def _offer(self) -> None:
        """Show the buttons between two places."""
        offered = []
        if self._missing:
            offered.append(("missing", f"Measure {_few(self._missing)}"))
        if self._following is not None:
            offered.append(("next", f"Measure {_label(self._following)}"))
        offered += [("finish", "Calibrate"), ("end", "End")]
        self.page.show(buttons=_buttons(offered))

    def _calibrate(self) -> str:
        """Calibrate with what is there, show the verdict; the button that is pressed then."""
        self.page.show(phase="calibrating", headline="Calibrating", buttons=[], plan=None)
        self._say("calibrating")
        self._worker.ask("calibrated", self._options.job)
        self._wait("calibrated")
        self.page.show(
            phase="done", headline="", buttons=_buttons((("more", "Measure more"), ("end", "End")))
        )
        return self._wait("more", "end")

    def _wait(self, *buttons: str) -> str:
        """Which of these buttons is pressed."""
        while True:
            try:
                # Not for ever: Ctrl-C is heard only between.
                pressed = self.page.pressed.get(timeout=0.5)
            except Empty:
                continue
            if pressed in buttons:
                return pressed

    # ── answers of the other process ────────────────────────────────────────────────────────
    def _answered(self, what: str, answer: Any) -> None:
        measuring = self.page.shown("phase") == "measuring"
        if isinstance(answer, SoFar):
            self._worst = Mark("", answer.worst_at, "worst")
            self.page.show(determined=_so_far(answer))
            self._mark()
        elif what == "determined":
            self.page.show(determined={"state": f"Not yet: measure {self._needed()}"})
        elif isinstance(answer, NextPlace):
            if measuring and self._options.free:
                self._show_goal(answer.readings)
            elif self.page.shown("phase") == "between":
                self._show_planned(answer)
        elif isinstance(answer, GuidedCalibration):
            self.page.link(answer.files)
            self.page.show(verdict=_verdict(answer))
            self._say(f"{answer.assessment.word}. {answer.assessment.statement}")
            self._say(f"Report: {answer.files[0].parent / 'report.html'}")
        elif isinstance(answer, Unanswered) and what == "calibrated":
            self.page.show(verdict={"level": "bad", "word": "Not calibrated", "text": answer.why})
            self._say(answer.why)
        elif what != "calibrated" and not measuring:
            found = answer.found or answer.why if isinstance(answer, Unanswered) else ""
            why = f"None could be planned ({found or 'too few samples'}): measure {self._needed()}."
            self.page.show(plan={"head": "Choose the next place yourself", "why": why})
        if what == "calibrated":
            self.page.press("calibrated")

    def _needed(self) -> str:
        """What is to be measured where the samples do not yet determine anything."""
        if self._stations is None:
            return _label(self._options)
        left = sum(state.status != "taken" for state in self._stations.states)
        if left:
            return f"{left} more of {_label(self._options)}"
        if self._options.free:
            return "more postures, unlike the others"
        if self._artefact is None:
            return "another place"
        return "another placement, turned or elsewhere"

    def _show_planned(self, planned: NextPlace) -> None:
        """The place that tells most, and a button that goes there."""
        self._planned, why = planned, planned.why
        self._arm.show_goal(planned.readings)
        if not self._follow(planned.sort):
            kind = next(k.kind for k in KINDS.values() if k.place == planned.sort)
            why += f" The job has no row for it: add {{kind: {kind}, samples: '{kind}/*.csv'}} to "
            why += "observations, and start guide again."
            self._follow(next(iter(self._options.labels), ""))
        head = "You can stop" if planned.enough else f"Best next: {planned.what}"
        self.page.show(plan={"head": head, "why": why})
        self._offer()
        self._mark()


@contextmanager
def said_every_few_seconds(
    what: str, say: Callable[[str], None], pause: float = 3.0
) -> Iterator[None]:
    """Say what goes on within it, and after each pause, s, for how long it has gone on."""
    over, start = threading.Event(), time.monotonic()

    def repeat() -> None:
        while not over.wait(pause):
            say(f"{what}, {time.monotonic() - start:.0f} s so far")

    say(what)
    saying = threading.Thread(target=repeat, name="progress", daemon=True)
    saying.start()
    try:
        yield
    finally:
        over.set()
        saying.join()


def next_label(
    options: MeasureOptions, sort: str = "", after: Mapping[str, str] = MappingProxyType({})
) -> dict[str, str]:
    """A sort of place that a job touches, and a label of it that is not measured yet.

    Or one that this program has begun to measure and not finished.

    Args:
        options: of the measurement.
        sort: of place; that of the job's first row by default.
        after: the sort and label that were measured last.

    Raises:
        JobError: the job touches nothing, or nothing of this sort.
    """
    usable = kinds_of(sort) if sort else [k.kind for k in KINDS.values() if k.place]
    try:
        row = read_row(options.job, options.observation, usable, options.chain)
    except JobError as error:
        touched = any(row.kind in usable for row in read_outline(options.job).rows)
        if options.observation is not None or touched:
            raise
        hint = "for what a device sends of itself, add --free; for a camera, use suta-calib detect"
        raise JobError.of(error, error.file, error.line, hint=hint) from None
    place = KINDS[row.kind].place if row.kind in KINDS else ""
    if not place or (sort and place != sort):
        raise JobError(
            f"an observation of kind {row.kind}, in which nothing is touched",
            f"one of kind {', '.join(usable)}",
            file=options.job,
            where="observations",
        )
    # A fixed point is an F, for P is taken.
    letter = "F" if place == "point" else place[0].upper()
    taken = set[str]()
    try:
        for file in expand(row.pattern, options.job.parent):
            taken.update(map(str, read_csv_table(file).labels(place, "a label column")))
    except SamplesError:
        pass
    # Those of which the job says where they are come first, by the names that it has for them.
    for label in chain(row.given, (f"{letter}{number}" for number in count(1))):
        if not label:
            continue  # The pose of the only place, whatever it is called.
        if {place: label} == after:
            continue
        if label not in taken:
            return {place: label}
        chosen = replace(options, labels={place: label}, resume=True, sequence=None)
        if row.file(label, options.repeat).exists() and stations_of(chosen)[1]:
            return {place: label}
    raise AssertionError


def _label(options: MeasureOptions) -> str:
    """What is measured, in a word or two."""
    return " ".join(options.labels.values()) or f"Repeat {options.repeat}"


def _sort(options: MeasureOptions) -> tuple[str, ...]:
    """Of the place that is touched; an empty one where none is."""
    return tuple(options.labels) or ("",)


def _place(station: str) -> str:
    """A station as the page calls it."""
    return station.removeprefix("anywhere, ")


def _buttons(offered: Any) -> list[dict[str, str]]:
    return [{"do": button, "label": label} for button, label in offered]


def _few(names: tuple[str, ...]) -> str:
    most = 4
    return ", ".join(names[:most]) + (" …" if len(names) > most else "")


def _taken(stations: Stations) -> list[tuple[str, tuple[float, ...]]]:
    """What the samples are of, to see whether they have changed."""
    return [
        (s.name, tuple(stations.tips[s.name].tolist()) if s.name in stations.tips else ())
        for s in stations.states
        if s.status == "taken"
    ]


def _mark_status(state: StationState) -> MarkStatus:
    if state.status == "next":
        return "next"
    if state.doubt:
        return "doubted"
    return "taken" if state.status == "taken" else "open"


def _alert(name: str, doubt: str) -> dict[str, str]:
    return {"name": name, "title": f"{name} does not fit", "text": doubt}


def _map(artefact: Artefact | None) -> list[list[Any]] | None:
    """The landmarks from above, mm."""
    if artefact is None:
        return None
    marks = artefact.landmarks.values()
    return [[mark.name, *(round(float(x), 2) for x in mm(mark.position))] for mark in marks]


def _so_far(found: SoFar) -> dict[str, Any]:
    x, y, z = (f"{number:.0f}" for number in mm(found.worst_at))
    done, all_of_them = sum(p.share >= 1 for p in found.parameters), len(found.parameters)
    state = f"{done} of {all_of_them} parameters are determined"
    return {
        "parameters": [
            {
                "name": parameter.name,
                "text": f"± {std_text(parameter.std, parameter.unit)}",
                "share": round(parameter.share, 3),
            }
            for parameter in found.parameters
        ],
        "tip": f"± {std_text(found.tip, 'm')}",
        "worst": f"± {std_text(found.worst, 'm')} at x {x}, y {y}, z {z} mm",
        "samples": found.samples,
        "state": state if done else f"Not yet: {state}",
    }


def _verdict(answer: GuidedCalibration) -> dict[str, Any]:
    assessment = answer.assessment
    return {
        "level": assessment.level,
        "word": assessment.word,
        "headline": answer.headline,
        "text": assessment.statement,
        "notes": list(assessment.notes),
        "files": [file.name for file in answer.files],
        "folder": str(answer.files[0].parent) if answer.files else "",
    }
