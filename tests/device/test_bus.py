from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Sequence
from itertools import repeat

import numpy as np
import pytest
import serial
from device_streams import RATE, ClockedPort, PortHere, PtyDevice, device, frames

from suta_calib.device import Bus, Reading
from suta_calib.device.formats import encode_frame
from suta_calib.errors import DeviceSilentError, DisconnectedError, WrongFormatError


def spec_of(arm: PtyDevice, **changes: object):
    return device(port=str(arm.link), **changes)


def read_until(bus: Bus, enough: Callable[[list[Reading]], bool], limit: float = 30.0):
    """Readings until there are enough; fails where that takes too long."""
    found: list[Reading] = []
    end = time.perf_counter() + limit
    while not enough(found):
        assert time.perf_counter() < end, f"only {len(found)} readings"
        found += bus.read(0.05)
    return found


def pieces(sequences: Sequence[int]) -> list[bytes]:
    """Frames, five in each hundredth of a second."""
    each = frames(sequences, start_us=round(sequences[0] * 1e6 / RATE))
    return [b"".join(each[k : k + 5]) for k in range(0, len(each), 5)]


def read_on(bus: Bus, until: Callable[[], bool]) -> None:
    """Leave out what comes."""
    end = time.perf_counter() + 30
    while not until():
        assert time.perf_counter() < end, "nothing is said"
        bus.read(0.02)


def never(found: list[Reading]) -> bool:
    """Reads on until something is raised."""
    return len(found) < 0


def test_readings_come_in_order_and_complete(arm: PtyDevice) -> None:
    arm.stream()
    with Bus(spec_of(arm)) as bus:
        readings = read_until(bus, lambda found: len(found) >= 100)
        assert bus.statistics.frames == len(readings)
        assert (bus.statistics.lost_frames, bus.statistics.garbage_bytes) == (0, 0)
    sequences = [reading.sequence for reading in readings]
    assert sequences == list(range(sequences[0], sequences[0] + len(readings)))
    np.testing.assert_allclose([r.time for r in readings], np.array(sequences) / RATE, atol=1e-9)
    now = time.perf_counter()
    assert all(0 <= now - reading.arrival < 30.0 for reading in readings)


def test_what_was_waiting_or_comes_from_a_cache_is_left_out(arm: PtyDevice) -> None:
    arm.write(b"".join(frames(range(100))))
    with Bus(spec_of(arm)) as bus:
        arm.write(b"".join(frames(range(100, 110))))  # the device's own cache: an old clock
        streamed = time.perf_counter()
        arm.stream(first=5000)
        readings = read_until(bus, lambda found: len(found) >= 20)
        # By this computer's clock: on a busy one a reading may come late.
        assert readings[0].sequence > 5000
        assert readings[0].arrival >= streamed + 0.1
        assert bus.statistics.stale_readings >= 10
        assert bus.statistics.lost_frames == 0
        assert bus.statistics.interruptions == 0


def test_without_settling_the_first_reading_is_taken(arm: PtyDevice) -> None:
    with Bus(spec_of(arm), settle=0) as bus:
        arm.write(b"".join(frames(range(5))))
        assert [reading.sequence for reading in bus.read(1.0)] == [0, 1, 2, 3, 4]


def test_a_read_ends_after_its_timeout(arm: PtyDevice) -> None:
    with Bus(spec_of(arm)) as bus:
        began = time.perf_counter()
        assert bus.read(0.05) == []
        assert 0.05 <= time.perf_counter() - began < 30.0


def test_who_was_away_can_do_without_old_readings(arm: PtyDevice) -> None:
    arm.stream()
    with Bus(spec_of(arm), absence=0.2) as opened:
        before = read_until(opened, lambda found: len(found) >= 10)[-1]
        time.sleep(0.3)
        back = time.perf_counter()
        after = read_until(opened, lambda found: bool(found))[0]
        assert after.arrival >= back
        passed = (after.sequence - before.sequence) / RATE
        assert after.time - before.time == pytest.approx(passed, abs=1e-6)
        assert passed > 0
        assert opened.statistics.lost_frames == 0


def test_what_comes_while_nobody_reads_is_not_lost(arm: PtyDevice) -> None:
    """A second and a half of six joints at 500 Hz is six times what a pseudo-terminal holds."""
    arm.stream()
    with Bus(spec_of(arm)) as opened:
        before = read_until(opened, lambda found: len(found) >= 10)
        enough, end = arm.sent + 700, time.perf_counter() + 30
        while arm.sent < enough:
            assert time.perf_counter() < end, "what nobody asks for is not read"
            time.sleep(0.05)
        away = time.perf_counter()
        after = read_until(opened, lambda found: bool(found) and found[-1].arrival > away)
        assert opened.statistics.lost_frames == 0
    sequences = [reading.sequence for reading in before + after]
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))
    arrivals = [reading.arrival for reading in after]
    assert arrivals == sorted(arrivals)
    assert sum(arrival < away for arrival in arrivals) > 500


def test_a_device_that_falls_silent_is_named() -> None:
    with Bus(device(), silence=0.1, port=ClockedPort(pieces(range(100)))) as opened:
        read_until(opened, bool)
        with pytest.raises(DeviceSilentError, match="power"):
            read_until(opened, never)


@pytest.mark.parametrize(
    ("given", "sent", "words"),
    [
        ({}, bytes(range(60, 250)), ["found bytes such as", "AA 55", "baudrate (921600)"]),
        ({}, b"\x00\xf8" * 50, ["00 F8", "another speed", "baudrate"]),
        ({}, b"1.5,2.5,3.5\n" * 9, ["'1.5,2.5,3.5'", "format: lines"]),
        ({}, frames([3])[0][:-1] * 9, ["headers AA 55", "CRC", "shield"]),
        ({"format": "lines"}, b"".join(frames(range(9))), ["such as AA 55", "format: frames"]),
        ({"format": "lines"}, b"hello there\n" * 9, ["'hello there'", "6 numbers"]),
    ],
)
def test_bytes_that_are_something_else_are_described(
    given: dict[str, str], sent: bytes, words: list[str]
) -> None:
    port = ClockedPort(repeat(sent))
    with (
        Bus(device(**given), silence=0.1, reconnect=True, port=port) as opened,
        pytest.raises(WrongFormatError) as caught,
    ):
        read_until(opened, bool)
    for word in words:
        assert word in str(caught.value)


def test_a_clock_in_another_unit_is_named(arm: PtyDevice) -> None:
    arm.stream(lambda n, us: encode_frame(n, us // 1000, [0] * 6))
    with (
        Bus(spec_of(arm), settling=0.3) as opened,
        pytest.raises(WrongFormatError, match="microseconds"),
    ):
        read_until(opened, bool)


def test_a_cable_that_is_pulled_out_is_named(arm: PtyDevice) -> None:
    arm.stream()
    with Bus(spec_of(arm)) as opened:
        read_until(opened, bool)
        arm.unplug()
        with pytest.raises(DisconnectedError, match="disappeared"):
            read_until(opened, never)


def test_it_reconnects_where_that_is_asked_for(arm: PtyDevice) -> None:
    said: list[str] = []
    arm.stream(first=60_000)  # two minutes on
    with Bus(spec_of(arm), reconnect=True, on_event=said.append) as opened:
        before = read_until(opened, lambda found: len(found) >= 20)[-1]
        arm.unplug()
        while not said:  # what was sent before is still read
            before = (opened.read(0.02) or [before])[-1]
        assert opened.read(0.02) == []
        arm.plug()
        arm.stream(first=0)  # a device that was without power begins anew
        after = read_until(opened, lambda found: len(found) >= 20)
        assert opened.statistics.interruptions == 1
        assert opened.statistics.lost_frames == 0
    assert "disappeared" in said[0]
    assert "connected again after" in said[1]
    assert len(said) == 2
    # One clock for the user: it goes on by as much as this computer's.
    assert after[0].sequence > before.sequence
    passed = after[0].arrival - before.arrival
    assert after[0].time - before.time == pytest.approx(passed, abs=5.0)


def test_a_stall_is_said_and_survived(arm: PtyDevice) -> None:
    said: list[str] = []
    arm.stream()
    with Bus(spec_of(arm), reconnect=True, silence=0.1, on_event=said.append) as opened:
        read_until(opened, bool)
        arm.stop()
        # A busy machine may stall too: what is said of it is over once frames come again.
        read_on(opened, lambda: len(said) % 2 == 1)
        # It is not said again, unless frames that were under way came in between.
        end = time.perf_counter() + 0.2
        while time.perf_counter() < end:
            opened.read(0.02)
        arm.stream()
        read_until(opened, bool)
    assert len(said) % 2 == 0
    assert all("no byte" in sentence for sentence in said[::2])
    assert all("received again" in sentence for sentence in said[1::2])


def test_a_burst_of_garbage_is_said_and_survived() -> None:
    said: list[str] = []
    burst = [b"\x99" * 100] * 20
    port = ClockedPort([*pieces(range(100)), *burst, *pieces(range(200, 300))])
    with Bus(device(), reconnect=True, silence=0.1, on_event=said.append, port=port) as opened:
        read_on(opened, lambda: "none of them in the expected format" in "".join(said))
        read_until(opened, bool)
    assert "received again" in said[-1]


def test_a_clock_that_jumps_is_said_and_settled_again(arm: PtyDevice) -> None:
    said: list[str] = []
    arm.stream(first=50_000)
    with Bus(spec_of(arm), on_event=said.append) as opened:
        before = read_until(opened, lambda found: len(found) >= 20)[-1]
        arm.stop()
        while rest := opened.read(0.1):
            before = rest[-1]
        arm.stream(first=0)  # a reset that keeps the port open
        after = read_until(opened, lambda found: len(found) >= 20)
        assert opened.statistics.interruptions == 1
        assert opened.statistics.lost_frames == 0
    (sentence,) = said
    assert "clock jumped" in sentence
    passed = after[0].arrival - before.arrival
    assert after[0].time - before.time == pytest.approx(passed, abs=5.0)
    assert np.all(np.diff([r.sequence for r in after]) == 1)


def test_a_socket_is_a_port(arm: PtyDevice) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        spec = device(port=f"socket://127.0.0.1:{server.getsockname()[1]}")

        listening = threading.Event()

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                assert listening.wait(10)
                for frame in frames(range(50)):
                    connection.sendall(frame)
                    time.sleep(1 / RATE)

        thread = threading.Thread(target=serve)
        thread.start()
        with Bus(spec, settle=0) as opened:
            listening.set()
            assert len(read_until(opened, lambda found: len(found) >= 50)) == 50
            with pytest.raises(DisconnectedError, match="connection was closed"):
                read_until(opened, never)
        thread.join()


def test_any_other_pyserial_url_is_a_port(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    original = serial.serial_for_url

    def remember(*args: object, **options: object):
        made.append(original(*args, **options))
        return made[-1]

    monkeypatch.setattr(serial, "serial_for_url", remember)
    spec = device(port="loop://")
    with Bus(spec, settle=0, port=PortHere(spec)) as opened:
        made[0].write(b"".join(frames(range(30))))
        assert len(read_until(opened, lambda found: len(found) >= 30)) == 30
        assert opened.read(0.01) == []


def test_a_device_that_was_off_for_long_is_settled_again() -> None:
    """However long that lasted: it is no reason to doubt its clock."""
    off = [b""] * 220
    port = ClockedPort([*pieces(range(50_000, 50_100)), *off, *pieces(range(100))])
    with Bus(device(), reconnect=True, silence=0.2, settling=2.0, port=port) as opened:
        before = read_until(opened, bool)[-1]
        after = read_until(opened, lambda found: any(r.arrival > before.arrival + 2 for r in found))
        assert after[-1].sequence > before.sequence
