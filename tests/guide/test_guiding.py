"""From one session to the next: what the page offers, and what its buttons do."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from suta_calib.acquisition.measuring import Measured, MeasureOptions, stated_elsewhere, stations_of
from suta_calib.acquisition.session_events import Live, Opened, Said, Stations, StationState
from suta_calib.assessment import Assessment
from suta_calib.atomic import inputs_kept
from suta_calib.device.device_file import read_device
from suta_calib.emulation import Emulation, Stops
from suta_calib.errors import DeviceError, InputError, JobError
from suta_calib.guide import emulating, guiding
from suta_calib.guide.calibrating import GuidedCalibration
from suta_calib.guide.determined import Determined, NextPlace, SoFar
from suta_calib.guide.guiding import Guide, GuideOptions, next_label, said_every_few_seconds
from suta_calib.guide.work import Unanswered, Worker

pytest.importorskip("viser")
DEVICE = "port: /dev/no-such-port\njoints: [{}]\n"
SO_FAR = SoFar(
    (Determined("joint_2.offset", "rad", 1e-3, 2e-4, 0.8),), 2e-3, 4e-3, np.array([0.1, 0.2, 0]), 2
)
POINT = NextPlace(
    *("point", "one point", "Good.", False, 30, np.zeros((1, 3)), np.zeros(3), np.eye(3)),
    np.zeros(6),
)


@pytest.fixture
def options(job: Path) -> GuideOptions:
    device = job.parent / "device.yaml"
    device.write_text(DEVICE.format(", ".join(f"{{name: joint_{k}}}" for k in range(1, 7))))
    return GuideOptions(MeasureOptions(job, device), port=0)


class Answering:
    """A worker that knows all answers, and a user who presses buttons."""

    presses: tuple[tuple[str, str], ...] = ()
    answers: dict[str, Any] = {}  # noqa: RUF012
    page: Any = None

    def __init__(self, answered: Callable[[str, Any], None]) -> None:
        self._answered = answered

    def __enter__(self) -> Answering:
        return self

    def __exit__(self, *_: object) -> None: ...

    def ask(self, what: str, job: Path) -> None:
        del job
        self._answered(what, self.answers.get(what, Unanswered("nothing is known")))
        for after, button in self.presses:
            if after == what:
                self.page.press(button)


@pytest.fixture
def guide(options: GuideOptions, monkeypatch: pytest.MonkeyPatch) -> Iterator[Guide]:
    monkeypatch.setattr(guiding, "Worker", Answering)
    guide = Guide(options, lambda _: None)
    monkeypatch.setattr(Answering, "page", guide.page)
    yield guide
    guide._arm.__exit__()


def session(*statuses: str, doubt: str = "", status: str = "complete") -> Callable[..., Measured]:
    """One that finds its stations so, in turn."""

    def measure(options: MeasureOptions, listen: Any, **_: Any) -> Measured:
        plan, _left = stations_of(options)
        names = [station.name for station in plan.stations]
        listen(Opened(plan, 2.0))
        for now in statuses:
            states = (
                StationState(name, word, doubt if word == "taken" else "")  # type: ignore[arg-type]
                for name, word in zip(names, now.split(), strict=False)
            )
            tips = {name: np.zeros(3) for name, _ in zip(names, now.split(), strict=False)}
            listen(Stations(tuple(states), tips))
        listen(Said("a sentence"))
        listen(Live("moving", np.zeros(6), True, 1.0, 0.0))
        missing = tuple(n for n, w in zip(names, now.split(), strict=False) if w == "skipped")
        return Measured(status, Path("x.csv"), 1, missing=missing)  # type: ignore[arg-type]

    return measure


def test_from_a_placement_to_the_verdict(guide: Guide, monkeypatch: pytest.MonkeyPatch) -> None:
    files = tuple(guide._options.job.parent / name for name in ("report.html", "result.json"))
    answer = GuidedCalibration("5 to 1 mm", Assessment.of("fine"), files, files[0])
    monkeypatch.setattr(
        Answering, "answers", {"determined": SO_FAR, "next": POINT, "calibrated": answer}
    )
    monkeypatch.setattr(Answering, "presses", (("next", "finish"), ("calibrated", "end")))
    monkeypatch.setattr(guiding, "measure", session("next open", "taken next", "taken taken"))
    opened = list[str]()
    guide._opened = opened.append
    guide.run()
    assert opened == [guide._arm.url]
    shown = guide.page.shown
    assert shown("label") == "P1"
    assert [row[1] for row in shown("stations")] == ["taken", "taken"]
    assert shown("live") is None
    assert shown("lines") == ["a sentence"]
    assert shown("determined")["tip"] == "± 2.0 mm"
    assert shown("determined")["worst"] == "± 4.0 mm at x 100, y 200, z 0 mm"
    assert shown("determined")["parameters"][0]["text"] == "± 0.057 deg"
    assert shown("verdict")["word"] == "Good"
    assert shown("verdict")["files"] == ["report.html", "result.json"]
    assert shown("phase") == "done"


def test_the_place_that_tells_most_is_offered(
    guide: Guide, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = list[dict[str, str]]()

    def measure(options: MeasureOptions, **more: Any) -> Measured:
        measured.append(dict(options.labels))
        if len(measured) > 1:
            assert (options.rests, options.sequence) == (30, None)
            monkeypatch.setattr(Answering, "presses", (("next", "end"),))
        return session("taken taken")(options, **more)

    monkeypatch.setattr(Answering, "answers", {"next": POINT})
    monkeypatch.setattr(Answering, "presses", (("next", "next"),))
    monkeypatch.setattr(guiding, "measure", measure)
    guide.run()
    assert measured == [{"placement": "P1"}, {"point": "F1"}]
    assert guide.page.shown("plan")["head"] == "Best next: one point"


def test_a_place_that_the_job_has_no_row_for_is_explained(
    guide: Guide, monkeypatch: pytest.MonkeyPatch
) -> None:
    plane = replace(POINT, sort="plane")
    monkeypatch.setattr(Answering, "answers", {"next": plane})
    monkeypatch.setattr(Answering, "presses", (("next", "end"),))
    monkeypatch.setattr(guiding, "measure", session("taken taken"))
    guide.run()
    assert "The job has no row for it: add {kind: plane," in guide.page.shown("plan")["why"]
    assert guide.page.shown("buttons")[0]["label"] == "Measure P2"


def test_what_is_missing_is_offered(guide: Guide, monkeypatch: pytest.MonkeyPatch) -> None:
    sequences = list[Any]()

    def measure(options: MeasureOptions, **more: Any) -> Measured:
        sequences.append(options.sequence)
        if len(sequences) == 1:
            return session("taken skipped skipped")(options, **more)
        monkeypatch.setattr(Answering, "presses", (("next", "end"),))
        return session("taken taken")(options, **more)

    monkeypatch.setattr(Answering, "presses", (("next", "missing"),))
    monkeypatch.setattr(guiding, "measure", measure)
    guide.run()
    assert sequences == [None, ("M1", "M2")]
    # Why nothing is proposed is said.
    why = (
        "None could be planned (nothing is known): measure another placement, turned or elsewhere."
    )
    assert guide.page.shown("plan")["why"] == why


def test_what_does_not_fit_is_said_until_it_is_taken_again(
    guide: Guide, monkeypatch: pytest.MonkeyPatch
) -> None:
    alerts = list[Any]()
    monkeypatch.setattr(Answering, "presses", (("next", "end"),))

    def measure(options: MeasureOptions, listen: Any, **more: Any) -> Measured:
        def heard(event: Any) -> None:
            listen(event)
            if isinstance(event, Stations):
                alerts.append(guide.page.shown("alert"))

        return session("next", "taken", doubt="it is off")(options, listen=heard, **more)

    monkeypatch.setattr(guiding, "measure", measure)
    guide.run()
    assert alerts == [None, {"name": "O", "title": "O does not fit", "text": "it is off"}]
    # Taken again, and no better.
    for status, alert in (("next", None), ("taken", alerts[1]), ("taken", alerts[1])):
        state = StationState("O", status, "it is off")  # type: ignore[arg-type]
        guide._listen(Stations((state,), {}))
        assert guide.page.shown("alert") == alert
    # Left as it is.
    states = state, StationState("M1", "taken")
    guide._listen(Stations(states, {}))
    assert guide.page.shown("alert") is None


def test_a_device_that_is_lost_later_is_waited_for(
    guide: Guide, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = list[int]()

    def measure(options: MeasureOptions, **more: Any) -> Measured:
        calls.append(1)
        if len(calls) == 2:
            guide.page.press("again")
            raise DeviceError("no such port")
        if len(calls) == 3:
            assert guide.page.shown("label") == "P2"
            monkeypatch.setattr(Answering, "presses", (("next", "end"),))
        return session("taken")(options, **more)

    monkeypatch.setattr(Answering, "presses", (("next", "next"),))
    monkeypatch.setattr(guiding, "measure", measure)
    guide.run()
    assert len(calls) == 3


def test_ctrl_c_and_a_device_that_was_never_there_end_it(
    guide: Guide, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guiding, "measure", session("next", status="interrupted"))
    with pytest.raises(KeyboardInterrupt):
        guide.run()


def test_no_device_no_page(options: GuideOptions) -> None:
    opened = list[str]()
    with pytest.raises(DeviceError, match="no-such-port"):
        Guide(options, lambda _: None, opened.append).run()
    assert not opened


def test_rests_anywhere(options: GuideOptions, monkeypatch: pytest.MonkeyPatch) -> None:
    goals, asked = list[Any](), list[str]()
    monkeypatch.setattr(guiding, "Worker", Answering)
    free = replace(options, measuring=replace(options.measuring, free=True, rests=3))
    guide = Guide(free, lambda _: None)
    posture = replace(POINT, sort="", what="the posture with the tip at x = 0", count=0)
    monkeypatch.setattr(Answering, "page", guide.page)
    monkeypatch.setattr(Answering, "answers", {"posture": posture})
    monkeypatch.setattr(Answering, "presses", (("posture", "end"),))
    monkeypatch.setattr(guide._arm, "show_goal", lambda q: goals.append(q is not None))

    def measure(options: MeasureOptions, listen: Any, **more: Any) -> Measured:
        def heard(event: Any) -> None:
            listen(event)
            asked.append(guide.page.shown("ask"))

        return session("next open open", "taken next open", "taken taken taken")(
            options, listen=heard, **more
        )

    monkeypatch.setattr(guiding, "measure", measure)
    guide.run()
    assert guide.page.shown("label") == "Repeat 1"
    assert [row[0] for row in guide.page.shown("stations")] == ["rest 1", "rest 2", "rest 3"]
    # Nothing is known before; then a second arm shows where to go.
    assert asked[:2] == [
        "Rest in a posture unlike the others",
        "Bring the arm to where the pink one is",
    ]
    assert goals[:2] == [False, True]
    assert guide.page.shown("plan")["head"] == "Best next: the posture with the tip at x = 0"
    assert guide.page.shown("buttons")[0]["label"] == "Measure Repeat 2"


class Standing:
    """In place of an emulated arm: what it would do, and on which port."""

    arms: list[tuple[Emulation, Path]] = []  # noqa: RUF012

    def __init__(self, emulation: Emulation, *, link: Path, patient: bool) -> None:
        assert patient
        self.arms.append((emulation, link))

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...


def test_an_arm_is_emulated_that_rests_anywhere(
    job: Path, repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job.write_text(
        f"arm: {{urdf: {repository}/urdf/suta.urdf, tip: tip}}\n"
        "parameters: [{select: ['joint_[2-5].offset'], bound_deg: 5}]\n"
        "observations: [{kind: gravity, samples: 'tilts/*.csv'}]\n"
    )
    monkeypatch.setattr(Standing, "arms", [])
    monkeypatch.setattr(emulating, "EmulatedArm", Standing)
    monkeypatch.setattr(guiding, "Worker", Answering)
    monkeypatch.setattr(Answering, "presses", (("posture", "next"),))

    def measure(options: MeasureOptions, listen: Any, **_: Any) -> Measured:
        assert options.device is not None
        device = read_device(options.device)
        assert device.extra_columns == ("ax", "ay", "az")
        plan, left = stations_of(options)
        listen(Opened(plan, 2.0))
        listen(Stations(tuple(StationState(s.name, "next") for s in left[:1]), {}))
        # It goes where the second arm is.
        assert Answering.page.shown("ask") == "Bring the arm to where the pink one is"
        emulation, link = Standing.arms[-1]
        assert link == Path(device.port)
        assert isinstance(emulation.motion, Stops)
        assert len(emulation.motion.posture) == len(left) + 1 == 5
        ended = "complete" if len(Standing.arms) == 1 else "interrupted"
        return Measured(ended, Path("x.csv"), 4)  # type: ignore[arg-type]

    monkeypatch.setattr(guiding, "measure", measure)
    measuring = MeasureOptions(job, free=True, rests=4)
    # As a command does, which does not write what it has read.
    with inputs_kept():
        guide = Guide(GuideOptions(measuring, emulate=True, port=0), lambda _: None)
        monkeypatch.setattr(Answering, "page", guide.page)
        with pytest.raises(KeyboardInterrupt):
            guide.run()
    assert len(Standing.arms) == 2
    # Nothing of it is beside the job.
    assert not (job.parent / "device.yaml").exists()


def test_a_device_or_an_emulated_one(options: GuideOptions) -> None:
    for wrong in (
        replace(options, emulate=True),
        replace(options, measuring=replace(options.measuring, device=None)),
    ):
        with pytest.raises(InputError, match=r"one of --device device\.yaml and --emulate"):
            Guide(wrong, lambda _: None)


def test_the_next_label(options: GuideOptions) -> None:
    measuring, folder = options.measuring, options.measuring.job.parent
    assert next_label(measuring) == {"placement": "P1"}
    assert next_label(measuring, "point") == {"point": "F1"}
    assert next_label(measuring, after={"placement": "P1"}) == {"placement": "P2"}
    joints = ",".join(f"joint_{k}" for k in range(1, 7))
    (folder / "calibration").mkdir()
    file = folder / "calibration" / "P1_1.csv"
    rows = f"{joints},placement,repeat,landmark\n0,0,0,0,0,0,P1,1,O\n"
    file.write_text(rows)
    # Begun here, and not finished.
    assert next_label(measuring) == {"placement": "P1"}
    # Of another program.
    file.rename(file.with_name("all.csv"))
    assert next_label(measuring) == {"placement": "P2"}
    with pytest.raises(JobError, match="plane"):
        next_label(measuring, "plane")


def test_a_place_that_the_job_states_comes_first_by_its_name(options: GuideOptions) -> None:
    measuring = options.measuring
    text = measuring.job.read_text()
    pose = "pose: {sheet: {position_mm: [170, 0, 0], rotation_rpy_deg: [0, 0, 0]}}"
    row = "{kind: pairwise_distance, "
    assert row in text
    measuring.job.write_text(text.replace(row, f"{row}{pose}, ", 1))
    assert next_label(measuring) == {"placement": "sheet"}
    assert next_label(measuring, after={"placement": "sheet"}) == {"placement": "P1"}
    # `measure` is told a label; it says what the job calls the place.
    assert stated_elsewhere(replace(measuring, labels={"placement": "sheet"})) == ""
    note = stated_elsewhere(replace(measuring, labels={"placement": "P1"}))
    assert note.endswith("not of P1: if this placement stands there, give --placement sheet")


def test_what_takes_long_is_said_again_and_again() -> None:
    lines = list[str]()
    twice = threading.Event()

    def say(line: str) -> None:
        lines.append(line)
        if len(lines) > 2:
            twice.set()

    with said_every_few_seconds("looking", say, pause=0.01):
        assert twice.wait(10)
    assert lines[:2] == ["looking", "looking, 0 s so far"]


def test_a_plan_that_fails_is_one_sentence_and_no_message_of_a_file(
    guide: Guide, monkeypatch: pytest.MonkeyPatch
) -> None:
    why = Unanswered(
        "/tmp/x/calibration.yaml:16: pose: found a pose; expected none", "found a pose"
    )
    monkeypatch.setattr(Answering, "answers", {"determined": why, "next": why})
    monkeypatch.setattr(Answering, "presses", (("next", "end"),))
    monkeypatch.setattr(guiding, "measure", session("taken next"))
    guide.run()
    assert guide.page.shown("plan") == {
        "head": "Choose the next place yourself",
        "why": "None could be planned (found a pose): measure 1 more of P1.",
    }
    assert guide.page.shown("determined") == {"state": "Not yet: measure P1"}


def test_a_job_in_which_nothing_is_touched(options: GuideOptions) -> None:
    job = options.measuring.job
    text = job.read_text().replace("pairwise_distance", "tracked_point")
    job.write_text(text.replace('  - {kind: fixed_point, samples: "fixed_point/*.csv"}\n', ""))
    with pytest.raises(JobError, match="add --free; for a camera, use suta-calib detect"):
        Guide(options, lambda _: None)


def test_what_is_wrong_is_said_of_the_job_and_not_of_its_copy(options: GuideOptions) -> None:
    job = options.measuring.job
    (job.parent / "artefact.yaml").unlink()
    with pytest.raises(InputError, match=rf"{job}:\d+: .*artefact.yaml; expected a file") as caught:
        Guide(replace(options, measuring=MeasureOptions(job), emulate=True), lambda _: None)
    assert "detect" not in str(caught.value)
    assert not (job.parent / "emulated").exists()


@pytest.mark.slow
def test_the_worker_says_why_it_has_no_answer(job: Path) -> None:

    answers, there = list[tuple[str, Any]](), threading.Event()

    def answered(what: str, answer: Any) -> None:
        answers.append((what, answer))
        there.set()

    with Worker(answered) as worker:
        worker.ask("calibrated", job)
        assert there.wait(60)
    ((what, answer),) = answers
    assert what == "calibrated"
    assert "found no samples yet" in answer.why
