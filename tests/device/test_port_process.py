"""A port in a process of its own: nothing is lost while this process does something else."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

from device_streams import PtyDevice, device

from suta_calib.device import Bus
from suta_calib.device.device_file import glance
from suta_calib.device.port_process import PortProcess


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
