"""What a measuring session tells a page: stations, doubts, and what buttons change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from acquisition_scenes import SECONDS, Guidance, Scene
from measuring_bench import Bench

from suta_calib.acquisition import MeasureOptions, measure
from suta_calib.acquisition.guided import ENTER
from suta_calib.acquisition.session_events import (
    ConsoleListener,
    Live,
    Opened,
    Said,
    SessionEvent,
    Stations,
)
from suta_calib.acquisition.unattended import Unattended
from suta_calib.arrays import FloatArray

LANDMARKS = "O,M1,M2,M3,M4,M5"


class Attended(Guidance):
    """Somebody moves an arm, and presses a button now and then."""

    def __init__(self, scene: Scene, start: FloatArray) -> None:
        plan = scene.plan(LANDMARKS)
        super().__init__(plan, scene.file(plan), start)
        self.guided = Unattended(self.run, self.finder, SECONDS, attended=True)  # type: ignore[assignment]

    def go(self, to: FloatArray, rest: float = 0.9) -> None:
        self.script.move(to, 0.6).rest(rest)
        self.arm_does()

    @property
    def doubts(self) -> dict[str, str]:
        return {state.name: state.doubt for state in self.run.state.states if state.doubt}

    @property
    def status(self) -> str:
        return " ".join(state.status for state in self.run.state.states)


@pytest.fixture
def attended(scene: Scene) -> Attended:
    attended = Attended(scene, scene["S4"])
    attended.script.rest(1.5)
    attended.arm_does()
    return attended


def test_no_rest_counts_before_the_arm_has_moved(attended: Attended, scene: Scene) -> None:
    assert attended.status == "next open open open open open"
    attended.go(scene["O"])
    assert attended.rows() == ["O"]
    assert attended.status == "taken next open open open open"


def test_a_button_takes_the_rest_as_it_is(attended: Attended) -> None:
    attended.guided.press(ENTER)
    attended.script.rest(0.9)
    attended.arm_does()
    assert attended.rows() == ["O"]


def test_a_wrong_landmark_is_doubted_at_once_and_taken_again(
    attended: Attended, scene: Scene
) -> None:
    for name in ("O", "M1", "M2", "M3"):
        attended.go(scene[name])
    assert attended.run.state.placed is not None
    # Too high: distances in the plane of the landmarks hardly change.
    off = scene["M4"] + np.array([0.0, 0.05, 0.0, 0.0, 0.0, 0.0])
    attended.go(off)
    assert list(attended.doubts) == ["M4"]
    assert "seat it again" in attended.doubts["M4"]
    attended.guided.press("r")
    attended.script.rest(0.9)
    attended.arm_does()
    assert attended.status == "taken taken taken taken next open"
    attended.go(scene["M4"])
    assert attended.doubts == {}
    assert attended.rows() == ["O", "M1", "M2", "M3", "M4"]
    assert np.abs(attended.run.file.rows[4][1] - scene["M4"]).max() < 1e-5
    # Seated anew at the same place it is still the same landmark.
    attended.guided.press("r")
    attended.go(scene["M4"] + 0.01, rest=0.2)
    attended.go(scene["M4"])
    assert attended.status == "taken taken taken taken taken next"


def test_a_landmark_that_does_not_fit_is_seated_again_without_a_key(
    attended: Attended, scene: Scene
) -> None:
    for name in ("O", "M1", "M2", "M3"):
        attended.go(scene[name])
    attended.go(scene["M4"] + np.array([0.0, 0.05, 0.0, 0.0, 0.0, 0.0]))
    assert list(attended.doubts) == ["M4"]
    attended.go(scene["M4"])
    assert attended.doubts == {}
    attended.go(scene["M5"])
    assert attended.rows() == ["O", "M1", "M2", "M3", "M4", "M5"]
    assert np.abs(attended.run.file.rows[4][1] - scene["M4"]).max() < 1e-5


def test_skip_and_stop(attended: Attended, scene: Scene) -> None:
    attended.guided.press("s")
    attended.go(scene["M1"])
    assert attended.status == "skipped taken next open open open"
    attended.guided.press("q")
    assert attended.guided.done
    attended.guided.press("s")
    assert attended.run.missing == ("O", "M2", "M3", "M4", "M5")


class Recorded:
    """Keeps the kinds of events, and the sentences."""

    def __init__(self) -> None:
        self.events: list[SessionEvent] = []

    def __call__(self, event: SessionEvent) -> None:
        self.events.append(event)

    def of(self, kind: type[SessionEvent]) -> list[SessionEvent]:
        return [event for event in self.events if isinstance(event, kind)]


def test_console_and_page_hear_the_same(tmp_path: Path, repository: Path) -> None:
    bench = Bench.made(tmp_path, repository)
    recording = bench.folder / "recording.csv"
    names = bench.arm.joints
    first, second = bench.postures["O"], bench.postures["M1"]
    share = np.clip((np.arange(0, 4, 0.01) - 1.5) / 0.5, 0, 1)[:, None]
    rows = np.column_stack([np.arange(0, 4, 0.01), first + share * (second - first)])
    np.savetxt(recording, rows, delimiter=",", header="time," + ",".join(names), comments="")
    said: list[str] = []
    heard = Recorded()
    options = MeasureOptions(
        bench.job,
        labels={"placement": "P1"},
        sequence=("O", "M1"),
        seconds=0.5,
        recording=recording,
    )
    assert measure(options, say=said.append, listen=heard).missing == ()
    assert [event.text for event in heard.of(Said)] == said  # type: ignore[union-attr]
    assert len(heard.of(Opened)) == 1
    statuses = [" ".join(s.status for s in event.states) for event in heard.of(Stations)]  # type: ignore[union-attr]
    assert statuses == ["next open", "taken next", "taken taken"]
    live = heard.of(Live)[-1]
    assert isinstance(live, Live)
    assert live.resting
    assert live.angles == pytest.approx(second, abs=1e-9)


def test_the_console_shows_lines_and_what_the_arm_does() -> None:
    said: list[str] = []
    shown: list[str] = []
    console = ConsoleListener(said.append, shown.append)
    console(Said("a line"))
    console(Live("moving", None, False, 0.0, 0.0))
    ConsoleListener(said.append)(Live("moving", None, False, 0.0, 0.0))
    assert (said, shown) == (["a line"], ["moving"])
