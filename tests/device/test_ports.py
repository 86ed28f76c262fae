from __future__ import annotations

import errno
from dataclasses import replace
from pathlib import Path

import pytest
import serial
from device_streams import PtyDevice, device
from serial.tools import list_ports

from suta_calib import optional_packages
from suta_calib.device import Bus, port
from suta_calib.device.port import opening_error
from suta_calib.errors import (
    DeviceError,
    DeviceFileError,
    MissingExtraError,
    PortBusyError,
    PortNotFoundError,
    PortPermissionError,
)


def spec_of(arm: PtyDevice):
    return device(port=str(arm.link))


def refused(spec, kind: type[Exception]) -> str:
    with pytest.raises(kind) as caught, Bus(spec):
        pass
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2  # type: ignore[attr-defined]
    return str(caught.value)


def test_a_port_in_use_is_named_with_its_user(arm: PtyDevice) -> None:
    with Bus(spec_of(arm)):
        message = refused(spec_of(arm), PortBusyError)
    assert "in use by" in message
    with Bus(spec_of(arm)):
        pass  # and free again


def test_a_port_that_is_not_there_lists_those_that_are(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = device(port="/dev/no-such-port")

    def said() -> str:
        with pytest.raises(PortNotFoundError) as caught:
            port.Port(spec)
        return str(caught.value)

    monkeypatch.setattr(port, "existing_ports", lambda: ["/dev/ttyACM7 (encoder)"])
    message = said()
    assert "/dev/no-such-port" in message
    assert "/dev/ttyACM7 (encoder)" in message
    monkeypatch.setattr(port, "existing_ports", list)
    assert "has none" in said()
    assert "/dev/no-such-port: found no such port" in refused(spec, PortNotFoundError)


def test_the_ports_that_are_there_are_asked_of_the_system() -> None:
    assert all(isinstance(name, str) and name for name in port.existing_ports())


def test_a_link_to_nowhere_says_where(tmp_path: Path) -> None:
    (tmp_path / "arm").symlink_to(tmp_path / "gone")
    message = refused(device(port=str(tmp_path / "arm")), PortNotFoundError)
    assert str(tmp_path / "gone") in message


def test_a_file_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert "not a serial port" in refused(device(port=str(tmp_path / "file")), PortNotFoundError)


def test_nobody_at_a_socket_is_named() -> None:
    assert "no answer" in refused(device(port="socket://127.0.0.1:1"), PortNotFoundError)


@pytest.mark.parametrize(
    ("number", "kind", "word"),
    [
        (errno.EACCES, PortPermissionError, "usermod"),
        (errno.EBUSY, PortBusyError, "close the other program"),
        (errno.ENODEV, PortNotFoundError, "no such port"),
    ],
)
def test_what_the_system_says_becomes_its_own_error(
    number: int, kind: type[DeviceError], word: str
) -> None:
    error = opening_error(device(port="/dev/ttyX"), serial.SerialException(number, "said"))
    assert type(error) is kind
    assert word in str(error)


def test_a_baud_rate_the_port_lacks_is_the_files_error() -> None:
    assert "baudrate: found -5" in refused(device(baudrate=-5), DeviceFileError)


def test_a_missing_package_names_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def absent(name: str) -> None:
        raise ModuleNotFoundError("No module named 'pyarrow'", name="pyarrow")

    monkeypatch.setattr(optional_packages, "import_module", absent)
    with pytest.raises(MissingExtraError, match=r"pip install 'suta_calib\[parquet\]'") as caught:
        optional_packages.load("pyarrow.parquet", "parquet")
    assert caught.value.exit_code == 2


def test_an_installed_package_that_is_broken_is_not_called_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(name: str) -> None:
        raise ModuleNotFoundError("No module named 'numpy'", name="numpy")

    monkeypatch.setattr(optional_packages, "import_module", broken)
    with pytest.raises(ModuleNotFoundError):
        optional_packages.load("pyarrow", "parquet")


def test_bus_of_a_spec_keeps_nothing_open_after_an_error(arm: PtyDevice) -> None:
    with pytest.raises(ZeroDivisionError), Bus(spec_of(arm)):
        raise ZeroDivisionError
    with Bus(replace(spec_of(arm), baudrate=115200)):
        pass


@pytest.mark.parametrize(
    "name",
    [
        "spy:///dev/ttyACM0?file={file}",
        "SPY:///dev/ttyACM0?file={file}",
        "spy://{arm}?file={file}",
        "alt://{arm}?class=PosixPollSerial",
        "socket://127.0.0.1:{port}?logging=debug",
        "socket://127.0.0.1:{port}/?logging=debug",
        "rfc2217://127.0.0.1:{port}?logging=debug",
        "rfc2217://127.0.0.1:{port}?timeout=1&logging=debug",
        "loop://?logging=debug",
        "socket://127.0.0.1:70000",
        "cp2110:///dev/hidraw0",
        "hwgrep://(a+)+$",
        "hwgrep://ttyACM&skip_busy",
    ],
)
def test_a_url_that_does_more_than_open_a_port_is_refused(
    name: str, arm: PtyDevice, tmp_path: Path
) -> None:
    precious = tmp_path / "precious.txt"
    precious.write_text("mine", encoding="utf-8")
    name = name.format(file=precious, arm=arm.link, port=5000)
    message = refused(device(port=name), DeviceFileError)
    assert name in message
    assert "device.yaml: port: found" in message
    assert "socket://" in message or name.partition("://")[0] in message.partition("expected")[2]
    assert precious.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    "name",
    [
        "/dev/serial/by-id/usb-Arduino_0043_7573-if00",
        "COM12",
        r"\\.\COM12",
        "/dev/cu.usbmodem14201",
        "socket://arm.local:5000",
        "socket://[::1]:5000/",
        "rfc2217://192.168.0.7:2217",
        "rfc2217://arm:2217?ign_set_control&timeout=3",
        "loop://",
        "hwgrep://VID:PID=2341:0043",
        "hwgrep://ttyACM&n=2",
    ],
)
def test_names_of_ports_are_accepted(name: str) -> None:
    assert port.expected_name(name) is None


@pytest.mark.skipif(not Path("/sys/dev/char/1:3").exists(), reason="needs Linux's /sys")
def test_a_device_that_is_no_port_is_not_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    # To open some devices does something: /dev/watchdog restarts the computer.
    monkeypatch.setattr(port.serial, "serial_for_url", lambda *_, **__: pytest.fail("opened"))
    assert "'mem'" in refused(device(port="/dev/null"), PortNotFoundError)


def test_a_port_is_found_by_its_usb_number(arm: PtyDevice, monkeypatch: pytest.MonkeyPatch) -> None:
    listed = [(str(arm.link), "an arm", "USB VID:PID=2341:0043")]
    monkeypatch.setattr(list_ports, "comports", lambda *_: listed)
    opened = port.Port(device(port="hwgrep://2341:0043"))
    opened.close()
