"""A port in a process of its own: nothing is lost while this process does something else."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from device_streams import PtyDevice, device

from suta_calib.device import Bus
from suta_calib.device.device_file import glance
from suta_calib.device.port_process import PortProcess
from suta_calib.errors import DeviceFileError, PortNotFoundError


def test_what_comes_while_nobody_reads_is_kept_with_its_time(arm: PtyDevice) -> None:
    """Half a second of six joints at 500 Hz is twice what a pseudo-terminal holds."""
    port = PortProcess(device(port=str(arm.link)))
    try:
        port.open()
        arm.stream(lambda n, _: b"%09d\n" % n * 4)
        # A pseudo-terminal that nobody reads takes no more than 4 kB of it.
        end = time.perf_counter() + 30
        while arm.sent < 250:
            assert time.perf_counter() < end, "what nobody asks for is not read"
            time.sleep(0.05)
        arm.stop()
        while not arm.taken:
            assert time.perf_counter() < end, "the rest is not read"
            time.sleep(0.01)
        # Between a read and its time the reader may be kept waiting.
        time.sleep(0.2)
        stopped = time.perf_counter()
        pieces = []
        while data := port.read(0.2):
            pieces.append((port.arrived, data))
    finally:
        port.close()
    numbers = [int(line) for line in b"".join(data for _, data in pieces).split(b"\n") if line][::4]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    times = [at for at, _ in pieces]
    assert times == sorted(times)
    assert times[-1] <= stopped


@pytest.mark.parametrize(
    ("change", "kind", "said"),
    [
        ({"port": "/dev/no_such_port"}, PortNotFoundError, "no such port"),
        ({"port": "loop://", "baudrate": -5}, DeviceFileError, "-5"),
    ],
)
def test_a_port_that_cannot_be_opened_is_told_as_anywhere(
    change: dict[str, object], kind: type[Exception], said: str
) -> None:
    with pytest.raises(kind, match=said), Bus(device(**change)):
        pass


def test_another_port_than_the_one_glanced_at_is_opened_instead(arm: PtyDevice) -> None:
    arm.stream()
    first = PortProcess(device(port="/dev/no_such_port"))
    found = []
    with Bus(device(port=str(arm.link)), port=first) as source:
        for _ in range(100):
            found += source.read(0.1)
            if found:
                break
    assert found


def test_its_process_ends_with_this_one_even_if_that_is_killed(arm: PtyDevice) -> None:
    """Who was killed must not keep the port from whoever goes on."""
    arm.stream()
    code = (
        "import pickle, sys\n"
        "from suta_calib.device.port_process import PortProcess\n"
        "port = PortProcess(pickle.load(sys.stdin.buffer))\n"
        "port.open()\n"
        "print(port._process.pid, flush=True)\n"
        "sys.stdin.buffer.read()\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert parent.stdin is not None
    assert parent.stdout is not None
    with parent:
        pickle.dump(device(port=str(arm.link)), parent.stdin)
        parent.stdin.flush()
        child = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
    end = time.perf_counter() + 60
    while _runs(child):
        assert time.perf_counter() < end, "the reader outlives its parent"
        time.sleep(0.02)


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except (ProcessLookupError, FileNotFoundError):
        return False
    return state != "Z"


def test_a_glance_is_no_more_than_one(tmp_path: Path) -> None:
    """Merged nine times nine times …, these few lines would be a billion."""
    merged = [f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 9)}]}}" for k in range(1, 10)]
    file = tmp_path / "device.yaml"
    file.write_text("\n".join(["port: /dev/arm", "a0: &a0 {x: 1}", *merged]))
    seen = glance(file)
    assert seen is not None
    assert seen.port == "/dev/arm"


def test_a_glance_sees_port_and_speed_and_complains_of_nothing(tmp_path: Path) -> None:
    file = tmp_path / "device.yaml"
    (tmp_path / "arm").touch()
    file.write_text("port: arm\nbaudrate: 9600\nformat: lines\nunit: nonsense\n", encoding="utf-8")
    seen = glance(file)
    assert seen is not None
    assert (seen.port, seen.baudrate) == (str(tmp_path / "arm"), 9600)
    for text in ("", "- 1", "port: 5", "port: a\nbaudrate: fast", "port: [", "baudrate: 9600"):
        file.write_text(text, encoding="utf-8")
        assert glance(file) is None
    assert glance(tmp_path / "none.yaml") is None
