from __future__ import annotations

import os
import threading
import time
from contextlib import suppress
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from emulated import TRUTH, angles, device_of, landmark_stops, listen, true_landmarks

from suta_calib.device import Bus, Reading, read_device
from suta_calib.emulation import EmulatedArm, Emulation, Faults, PseudoTerminal, Still, Stops, Sweep
from suta_calib.emulation.player import Player, RoundClock
from suta_calib.emulation.stream import STALE_TURN, packets
from suta_calib.errors import SutaCalibError
from suta_calib.geometry.numbers import wrap
from suta_calib.model.arm import ArmModel

PATIENCE_S = 30.0
POSTURE = np.array([0.3, -1.0, 3.1, -3.1, 2.0, 0.0])


def moving(arm: ArmModel, text: str = "") -> Emulation:
    motion = Sweep(POSTURE, np.full(6, 0.4), 0.2, 1.0, 20.0)
    return Emulation(device_of(arm), motion, faults=Faults.parse(text))


def test_a_port_streams_in_real_time_and_tells_the_truth_afterwards(arm: ArmModel) -> None:
    with EmulatedArm(moving(arm)) as emulator:
        port = emulator.port
        time.sleep(0.1)
        began = time.perf_counter()
        readings = listen(port, emulator.device, PATIENCE_S, lambda found: len(found) > 300)
    assert not os.path.lexists(port)
    found = np.array([each.time for each in readings])
    sequence = np.array([each.sequence for each in readings])
    assert len(readings) > 300
    np.testing.assert_array_equal(np.diff(sequence), 1)
    assert found[0] > 0.05, "the device's clock runs before anybody listens"
    arrival = np.array([each.arrival for each in readings])
    # In real time: nothing comes before its time, whatever a busy machine makes late.
    moved = np.interp(found, emulator.trajectory.time, emulator.trajectory.motion_time)
    assert (arrival - began > moved).all()
    true = emulator.trajectory.at(found)
    assert np.abs(wrap(angles(readings) - true)).max() < 6 * 2e-5
    assert np.ptp(true, axis=0).min() > 1e-3
    # Moved only once somebody listened.
    np.testing.assert_allclose(
        true[0], emulator.emulation.motion.readings(np.zeros(1))[0], atol=1e-3
    )
    assert emulator.played.sent >= len(readings)
    assert emulator.events == ["the port was opened"]


def test_a_patient_arm_loses_nothing_to_a_reader_that_lags(arm: ArmModel) -> None:
    """A second of frames is many times what a port holds; nobody reads for a third of it."""
    emulation = moving(arm)
    _, frame = next(packets(emulation, 0))
    with PseudoTerminal() as terminal:
        listener = os.open(terminal.name, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        player = Player(emulation, terminal, patient=True)
        playing = Thread(target=player.run, args=(1.0,))
        playing.start()
        time.sleep(0.33)
        read = b""
        while playing.is_alive():
            time.sleep(0.01)
            with suppress(BlockingIOError):
                while data := os.read(listener, 65536):
                    read += data
        with suppress(BlockingIOError):
            read += os.read(listener, 65536)
        os.close(listener)
    played = player.played
    assert played.unheard == 0
    # Of the last one a part may still be on its way.
    assert 2 * 4096 < len(read) <= played.sent * len(frame) < len(read) + len(frame)


def test_a_port_that_vanishes_comes_back_under_its_name(arm: ArmModel, tmp_path: Path) -> None:
    emulation = moving(arm, "disconnect=0.3@0.3")
    with EmulatedArm(emulation, link=tmp_path / "arm") as emulator:
        assert emulator.port == str(tmp_path / "arm")
        before = listen(emulator.port, emulator.device, PATIENCE_S)
        gone = time.perf_counter()
        while not os.path.lexists(emulator.port):
            assert time.perf_counter() - gone < PATIENCE_S
            time.sleep(0.005)
        after = listen(emulator.port, emulator.device, PATIENCE_S, bool)
    truth = emulator.trajectory
    moved = [np.interp([r.time for r in x], truth.time, truth.motion_time) for x in (before, after)]
    assert moved[0].max() < 0.3
    assert moved[1].min() >= 0.6 - 1e-3
    assert emulator.played.silent == pytest.approx(0.3 * 768, abs=1)
    assert [text.partition(" as ")[0] for text in emulator.events] == [
        *("the port was opened", "the port disappeared", "the port is back")
    ]


def test_a_bus_is_not_fooled_by_a_cache(arm: ArmModel, tmp_path: Path) -> None:
    still = Emulation(
        device_of(arm), Still(POSTURE), faults=Faults.parse("stale=10"), first_time_us=60_000_000
    )
    readings, end = list[Reading](), time.perf_counter() + PATIENCE_S
    with (
        EmulatedArm(still) as emulator,
        Bus(read_device(emulator.write_device(tmp_path / "device.yaml"))) as bus,
    ):
        while len(readings) < 100 and time.perf_counter() < end:
            readings += bus.read()
    assert len(readings) >= 100
    assert np.abs(wrap(angles(readings) - POSTURE)).max() < STALE_TURN / 100
    assert bus.statistics.stale_readings >= 10


def test_an_arm_waits_between_placements_for_the_next_listener(
    arm: ArmModel, tmp_path: Path
) -> None:
    motion = landmark_stops(arm, tmp_path, rest=0.3, move=0.1)
    marks = true_landmarks(tmp_path, [dict(each) for each in motion.labels])

    def rests_on_c(found: list[Reading]) -> bool:
        """For longer than half a rest."""
        if len(found) < 200:
            return False
        tips = arm.forward(angles(found[-200:]), TRUTH)[1]
        return bool(np.abs(tips - marks[2]).max() < 2e-4)

    with EmulatedArm(Emulation(device_of(arm), motion)) as emulator:
        first = listen(emulator.port, emulator.device, PATIENCE_S, rests_on_c)
        end = time.perf_counter() + PATIENCE_S
        while not any("end of the round" in event for event in emulator.events):
            assert time.perf_counter() < end
            time.sleep(0.01)
        second = listen(emulator.port, emulator.device, PATIENCE_S, bool)
    tip = [arm.forward(angles(each)[[0, -1]], TRUTH)[1] for each in (first, second)]
    # Through P1 from A to C, where it stayed; then at rest on A of P2 at once.
    np.testing.assert_allclose(tip[0], marks[[0, 2]], atol=2e-4)
    np.testing.assert_allclose(tip[1], marks[[3, 3]], atol=2e-4)


def motion_times(clock: RoundClock, *times: float) -> list[float]:
    return [float(clock(np.array([time]))[0]) for time in times]


@pytest.fixture
def rounds(arm: ArmModel, tmp_path: Path) -> Stops:
    return landmark_stops(arm, tmp_path, rest=4.0, move=1.0)


def test_a_round_ends_when_the_port_closes_after_half_the_last_rest(rounds: Stops) -> None:
    heard = True
    clock = RoundClock(rounds, lambda: heard)
    assert motion_times(clock, 0.0, 9.0, 13.0, 20.0) == [0.0, 9.0, 13.0, 14.0]
    heard = False
    assert motion_times(clock, 21.0, 50.0) == [15.0, 15.0]
    heard = True
    assert motion_times(clock, 60.0, 61.0) == [15.0, 16.0]
    # The last round has nothing after it: nothing is held.
    heard = False
    assert motion_times(clock, 100.0) == [55.0]


def test_a_round_that_is_not_over_goes_on_unheard(rounds: Stops) -> None:
    clock = RoundClock(rounds, lambda: False)
    assert motion_times(clock, 0.0, 11.9, 12.1) == [0.0, 11.9, 15.0]


def test_a_round_begins_when_whoever_listens_is_ready(rounds: Stops) -> None:
    heard, ready = True, False
    clock = RoundClock(rounds, lambda: heard, lambda: ready)
    assert motion_times(clock, 0.0, 9.0) == [0.0, 0.0]
    ready = True
    assert motion_times(clock, 10.0, 11.0) == [0.0, 1.0]
    # Who falls behind within a round is waited for by the stream, not by the arm.
    ready = False
    assert motion_times(clock, 12.0, 23.0, 25.0) == [2.0, 13.0, 14.0]
    heard = False
    assert motion_times(clock, 26.0) == [15.0]
    heard = True
    assert motion_times(clock, 30.0) == [15.0]
    ready = True
    assert motion_times(clock, 31.0, 32.0) == [15.0, 16.0]


def test_a_patient_arm_rests_on_its_first_place_until_its_reader_has_kept_up(
    arm: ArmModel, tmp_path: Path
) -> None:
    """However late that is: a busy computer takes its time to believe what it reads."""
    emulation = Emulation(device_of(arm), landmark_stops(arm, tmp_path, rest=0.05, move=0.05))
    with PseudoTerminal(tmp_path / "port") as terminal:
        player = Player(emulation, terminal, patient=True, recorded=True)
        reader = os.open(terminal.port, os.O_RDONLY | os.O_NOCTTY)
        thread = threading.Thread(target=player.run, args=(3600.0, lambda: done))
        done = False
        thread.start()
        try:
            # Full, and full again: whoever reads by fits and starts has not kept up.
            for _ in range(3):
                time.sleep(0.3)
                os.read(reader, 4096)
            late = player.played.sent
            end = time.perf_counter() + PATIENCE_S
            while player.trajectory.motion_time.max() < 0.2:
                assert time.perf_counter() < end
                os.read(reader, 65536)
        finally:
            done = True
            thread.join()
            os.close(reader)
    moved = player.trajectory.motion_time
    assert moved[:late].max() == 0.0
    began = int(np.flatnonzero(moved)[0])
    assert began >= late + 0.3 * emulation.rate - 64
    # Whoever looks late finds it waiting again, at the end of the round.
    under_way = moved[began : np.searchsorted(moved, 0.2)]
    np.testing.assert_allclose(np.diff(under_way), 1 / emulation.rate, atol=1e-9)


def test_an_arm_that_cannot_start_says_why(arm: ArmModel, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    emulator = EmulatedArm(moving(arm), link=tmp_path / "taken")
    with pytest.raises(SutaCalibError, match="not a link"), emulator:
        pass
