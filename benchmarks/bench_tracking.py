"""From a frame's last byte to the published pose: latency over a pty, with a histogram.

An emulated SUTA in a process of its own sends frames; the tracker publishes every pose to an
OpenIGTLink client in another process, to UDP and to a CSV file, as `suta-calib track` does. Run by
`make bench` for a few seconds each; `--seconds 60` for figures to quote, `--picture FILE.svg` for
the histogram.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from suta_calib.device import Bus, DeviceSpec, JointSpec, Statistics
from suta_calib.emulation import EmulatedArm, Emulation, sweep
from suta_calib.model.arm import ArmModel
from suta_calib.report.path_accuracy.latency_plots import latency_figure
from suta_calib.tracking import (
    CsvRecorder,
    IgtlPublisher,
    TipKinematics,
    Tracker,
    TrackingSession,
    UdpPublisher,
    low_latency,
)

URDF = Path(__file__).parents[1] / "urdf" / "suta.urdf"
RATES = (768.0, 5000.0)
TARGET_MS = 2.0
LOCAL = "127.0.0.1"
# Counts the messages it receives until the server hangs up: 106 bytes each.
CLIENT = """
import socket, sys
received, connection = 0, socket.create_connection(("127.0.0.1", int(sys.argv[1])))
while data := connection.recv(1 << 16):
    received += len(data)
print(received // 106)
"""


@dataclass(frozen=True)
class Run:
    """One rate's figures."""

    rate: float
    session: TrackingSession
    stream: Statistics
    received: int


def measure(rate: float, seconds: float, folder: Path) -> Run:
    """Track an emulated arm for some seconds, everything published everywhere."""
    arm = ArmModel.from_urdf(URDF, "tip")
    joints = tuple(JointSpec(name, 1) for name in arm.joints)
    device = DeviceSpec(folder / "device.yaml", "", 921600, "frames", "counts", 1 << 22, joints)
    emulation = Emulation(device, sweep(arm), rate=rate)
    with ExitStack() as stack:
        emulator = stack.enter_context(EmulatedArm(emulation))
        igtl = IgtlPublisher(0, host=LOCAL)
        client = subprocess.Popen(
            [sys.executable, "-c", CLIENT, str(igtl.port)], stdout=subprocess.PIPE, text=True
        )
        while not igtl.statistics()["clients"]:
            pass
        publishers = [
            igtl,
            stack.enter_context(UdpPublisher(LOCAL, 9)),
            stack.enter_context(CsvRecorder(folder / f"{rate:.0f}.csv", arm.joints)),
        ]
        tracker = Tracker(arm, arm.joints, TipKinematics(arm))
        session = TrackingSession(tracker, publishers)
        with low_latency(), Bus(emulator.device) as bus:
            session.run(bus, seconds)
        igtl.close()
        received = int(client.communicate(timeout=10)[0])
        return Run(rate, session, bus.statistics, received)


def show(runs: list[Run]) -> None:
    """The table, and whether the target is met."""
    table = Table(title="From the frame's last byte to publication (IGTL, UDP, CSV), ms")
    for name in ("Hz", "poses", "lost", "client got", "p50", "p95", "p99", "max", "jitter"):
        table.add_column(name, justify="right")
    for run in runs:
        figures = run.session.latency.summary()
        row = [figures[f"{key}_ms"] for key in ("p50", "p95", "p99", "max", "jitter")]
        counts = (run.session.latency.count, run.stream.lost_frames, run.received)
        table.add_row(f"{run.rate:.0f}", *map(str, counts), *(f"{value:.3f}" for value in row))
    Console(width=100).print(table)
    slow = [r for r in runs if r.session.latency.percentile(99) * 1e3 > TARGET_MS]
    said = ", ".join(f"{run.rate:.0f} Hz" for run in slow)
    print(f"p99 above {TARGET_MS:g} ms at {said}" if slow else f"p99 below {TARGET_MS:g} ms")


def main() -> None:
    """Run every rate."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0, help="for each rate")
    parser.add_argument("--picture", type=Path, help="SVG of the histogram")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        runs = [measure(rate, options.seconds, Path(folder)) for rate in RATES]
    show(runs)
    if options.picture is not None:
        found = {f"{run.rate:.0f} Hz": run.session.latency for run in runs}
        options.picture.write_text(latency_figure(found, TARGET_MS), encoding="utf-8")
        print(f"histogram: {options.picture}")


if __name__ == "__main__":
    main()
