"""Servos on a bus are asked where they are; a pseudo-terminal answers as they would."""

from __future__ import annotations

import math
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from servo_bus import ServoBus

from suta_calib.device import Bus, DeviceSpec, Reading, read_device
from suta_calib.device.formats import servos
from suta_calib.device.formats.servos import DynamixelFormat, FeetechFormat
from suta_calib.errors import DeviceFileError, DeviceSilentError, DisconnectedError

pytest.importorskip("dynamixel_sdk")

FORMS = {"dynamixel": DynamixelFormat(), "feetech": FeetechFormat()}


def register(name: str, counts: int) -> bytes:
    """Counts as the servo keeps them."""
    if name == "dynamixel":
        return counts.to_bytes(4, "little", signed=True)
    return (abs(counts) | (0x8000 if counts < 0 else 0)).to_bytes(2, "little")


def bus_of(name: str, positions: dict[int, int]) -> ServoBus:
    form = FORMS[name]
    registers = {number: register(name, counts) for number, counts in positions.items()}
    return ServoBus(int(form.protocol), registers, form.address)


def described(folder: Path, name: str, servos: ServoBus, joints: str) -> DeviceSpec:
    file = folder / "device.yaml"
    file.write_text(f"port: {servos.port}\nformat: {name}\njoints: [{joints}]\n")
    return read_device(file)


THREE = "{name: a, id: 7, zero: 2048}, {name: b, id: 3, sign: -1}, {name: c, id: 12, ratio: 3}"


def first(bus: Bus) -> Reading:
    end = time.perf_counter() + 20
    while time.perf_counter() < end:
        if readings := bus.read(0.1):
            return readings[-1]
    raise AssertionError("no reading")


def until_it_ends(bus: Bus) -> None:
    while True:
        bus.read(0.1)


@pytest.mark.parametrize("name", FORMS)
def test_positions_of_servos_are_readings(name: str, tmp_path: Path) -> None:
    """By their numbers, each with its own zero, sign and gear; negative positions too."""
    with bus_of(name, {7: 3072, 3: 1024, 12: -2048}) as servos:
        spec = described(tmp_path, name, servos, THREE)
        assert (spec.baudrate, spec.counts_per_turn) == (1_000_000, 4096)
        with Bus(spec) as bus:
            reading = first(bus)
            expected = [math.pi / 2, -math.pi / 2, -math.pi / 3]
            np.testing.assert_allclose(reading.angles, expected, atol=1e-12)
            servos.registers[7] = register(name, 2048)
            end = time.perf_counter() + 20
            while first(bus).angles[0] != 0.0:
                assert time.perf_counter() < end
            assert bus.statistics.frame_crc_errors == 0
        # Nothing was written to them.
        assert not servos.other


@pytest.mark.parametrize("name", FORMS)
def test_a_servo_that_does_not_answer_is_named(name: str, tmp_path: Path) -> None:
    with bus_of(name, {7: 1, 12: 1}) as servos:
        spec = described(tmp_path, name, servos, THREE)
        with pytest.raises(
            DeviceSilentError, match=rf"no answer from servo 3 \(b\).*'format: {name}"
        ):
            Bus(spec).__enter__()


@pytest.mark.parametrize("name", FORMS)
def test_damaged_answers_are_left_out(name: str, tmp_path: Path) -> None:
    with bus_of(name, {1: 10, 2: 20}) as servos:
        servos.noisy = 5
        spec = described(tmp_path, name, servos, "{name: a}, {name: b}")
        with Bus(spec) as bus:
            for _ in range(5):
                expected = np.array([10, 20]) * math.tau / 4096
                np.testing.assert_allclose(first(bus).angles, expected, atol=1e-12)


def test_a_servo_that_goes_is_told(tmp_path: Path) -> None:
    with bus_of("feetech", {1: 10, 2: 20}) as servos:
        spec = described(tmp_path, "feetech", servos, "{name: a}, {name: b}")
        with Bus(spec) as bus:
            first(bus)
            del servos.registers[2]
            with pytest.raises(DisconnectedError, match="servo 2 does not answer any more"):
                until_it_ends(bus)


def test_one_that_misses_a_packet_is_not_blamed_for_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(servos, "_SILENT_S", 0.0)
    with bus_of("feetech", {1: 10, 2: 20}) as bus:
        spec = described(tmp_path, "feetech", bus, "{name: a}, {name: b}")
        with closing(FORMS["feetech"].port(spec)) as port:
            assert port.read(0.0)
            first_heard = port._heard[1]
            positions = iter([10, "none"])
            monkeypatch.setattr(port, "_position", lambda _: next(positions))
            with pytest.raises(DisconnectedError, match="servo 2 does not answer any more"):
                port.read(0.0)
            assert port._heard[1] > first_heard
            # The first misses one long after the second has gone: it was heard a moment ago.
            monkeypatch.setattr(servos, "_SILENT_S", 0.5)
            port._heard[2] -= 10.0
            monkeypatch.setattr(port, "_position", lambda _: "none")
            assert port.read(0.0) == b""


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("format: feetech\njoints: [{name: a, id: 1}, {name: b, id: 1}]", "id.*different for each"),
        ("format: dynamixel\njoints: [{name: a, id: 253}]", "id.*below 253"),
        ("format: dynamixel\njoints: [{name: a, id: -1}]", "id"),
        ("joints: [{name: a, id: 1}]", "id.*joints of frames are not polled"),
        ("format: feetech\nunit: deg\njoints: [{name: a}]", "unit.*counts"),
    ],
)
def test_numbers_of_servos_are_checked(text: str, says: str, tmp_path: Path) -> None:
    file = tmp_path / "device.yaml"
    file.write_text(f"port: x\n{text}\n")
    with pytest.raises(DeviceFileError, match=says):
        read_device(file)
