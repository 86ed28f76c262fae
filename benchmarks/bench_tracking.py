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
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from limits import BY_KEY, record
from matplotlib.figure import Figure
from rich.console import Console
from tables import number_table

from suta_calib import ArmModel
from suta_calib.device import Bus, DeviceSpec, JointSpec, Statistics
from suta_calib.emulation import EmulatedArm, Emulation, sweep
from suta_calib.plotting import BLUE, GREY, ORANGE, WIDTH, plain_log, style
from suta_calib.report import svg_text
from suta_calib.tracking import (
    CsvRecorder,
    IgtlPublisher,
    LatencyStatistics,
    TipKinematics,
    Tracker,
    TrackingSession,
    UdpPublisher,
    low_latency,
)
from suta_calib.units import ms

URDF = Path(__file__).parents[1] / "urdf" / "suta.urdf"
RATES = (768.0, 5000.0)
TARGET_MS = BY_KEY["live"].bound
_COLOURS = (BLUE, ORANGE, "black", GREY)
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
    title = "From the frame's last byte to publication (IGTL, UDP, CSV), ms"
    columns = ("poses", "lost", "client got", "p50", "p95", "p99", "max", "jitter")
    table = number_table(title, "Hz", *columns)
    for run in runs:
        figures = run.session.latency.summary()
        row = [figures[f"{key}_ms"] for key in columns[3:]]
        counts = (run.session.latency.count, run.stream.lost_frames, run.received)
        table.add_row(f"{run.rate:.0f}", *map(str, counts), *(f"{value:.3f}" for value in row))
    Console(width=100).print(table)
    record("live", [ms(run.session.latency.percentile(99)) for run in runs if run.rate == RATES[0]])
    slow = [r for r in runs if r.session.latency.percentile(99) * 1e3 > TARGET_MS]
    said = ", ".join(f"{run.rate:.0f} Hz" for run in slow)
    print(f"p99 above {TARGET_MS:g} ms at {said}" if slow else f"p99 below {TARGET_MS:g} ms")


def latency_figure(found: Mapping[str, LatencyStatistics], target_ms: float | None = None) -> str:
    """An SVG document: histograms on logarithmic axes, with the 99th percentiles.

    Args:
        found: latencies by the name of what was run.
        target_ms: a limit to draw.
    """
    with style("latency"):
        figure = Figure(figsize=(WIDTH, 3.4), layout="constrained")
        axes = figure.subplots()
        for (name, each), colour in zip(found.items(), _COLOURS, strict=False):
            edges, counts = each.histogram()
            p99 = ms(each.percentile(99))
            label = f"{name}: p50 {ms(each.percentile(50)):.3g}, p99 {p99:.3g}, max "
            axes.stairs(
                np.maximum(counts, 0.5),
                ms(edges),
                color=colour,
                baseline=0.5,
                label=f"{label}{ms(each.maximum):.3g} ms ({each.count} poses)",
            )
            axes.axvline(p99, color=colour, lw=0.9, ls=":")
        if target_ms is not None:
            axes.axvline(target_ms, color=GREY, lw=1.2, ls="--")
        plain_log(axes.xaxis, axes.set_xscale)
        plain_log(axes.yaxis, axes.set_yscale)
        axes.set_title(
            "From the frame's last byte to publication (dotted: p99)", pad=12 + 11 * len(found)
        )
        axes.set_xlabel("latency, ms")
        axes.set_ylabel("poses per 2 % bin")
        axes.grid()
        axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
        return svg_text(figure, "latency", "Histogram of the latency of published poses") + "\n"


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
