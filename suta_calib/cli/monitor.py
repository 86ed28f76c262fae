"""``suta-calib monitor``: what a device sends, live."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from suta_calib.cli._numbers import FiniteRange
from suta_calib.cli._output import json_option, print_json
from suta_calib.cli._signals import ended_by_sigterm

if TYPE_CHECKING:
    from suta_calib.cli._monitor_view import TipView, View
    from suta_calib.device import Bus, DeviceSpec
    from suta_calib.device.monitoring import Monitor

# With --json somebody waits for the answer.
_JSON_SECONDS: Final = 3.0
_LOOK_S: Final = 0.05


@click.command()
@click.option("--device", type=click.Path(path_type=Path), required=True, help="The device.yaml.")
@click.option("--urdf", type=click.Path(path_type=Path), help="Show this arm's tip pose too.")
@click.option("--tip", help="With --urdf: any link or frame of the arm.")
@click.option("--base", help="With --urdf: the link poses are given in; the root by default.")
@click.option(
    "--seconds",
    type=FiniteRange(min=0.1),
    help=f"Stop after this long; with --json after {_JSON_SECONDS:g} by default.",
)
@json_option
def monitor(
    device: Path,
    urdf: Path | None,
    tip: str | None,
    base: str | None,
    seconds: float | None,
    as_json: bool,
) -> None:
    """Show what a device sends: the first thing to run when nothing works.

    Each joint's angle, its noise over the last second and the flags its encoder raises; the
    frames' rate, and what was damaged or lost. In a terminal the table is live; elsewhere one
    line is printed per second. Ends with --seconds or Ctrl-C, and then says what is wrong and
    what to do. A port that cannot be opened, silence, and bytes that cannot be read are errors
    that say what was seen.
    """
    from suta_calib.cli._monitor_view import TipView
    from suta_calib.device.description import read_device

    if (urdf is None) != (tip is None):
        raise click.UsageError("found one of --urdf and --tip; expected both or none")
    if base is not None and urdf is None:
        raise click.UsageError("found --base without --urdf; expected both")
    spec = read_device(device)
    view = None if urdf is None or tip is None else TipView(urdf, tip, base, spec)
    if as_json and seconds is None:
        seconds = _JSON_SECONDS
    _monitor(spec, view, seconds, as_json)


def _monitor(spec: DeviceSpec, tip: TipView | None, seconds: float | None, as_json: bool) -> None:
    import time

    from suta_calib.cli._monitor_view import View, report
    from suta_calib.device import Bus
    from suta_calib.device.monitoring import Monitor

    watched = Monitor(spec)
    view = View(spec, tip, quiet=as_json)
    bus = Bus(spec, reconnect=True, on_event=view.event)
    try:
        with ended_by_sigterm(), view, bus:
            _watch(bus, watched, view, seconds)
    finally:
        # However it ended: who pressed Ctrl-C wants to know what was seen until then.
        if watched.last is not None:
            data = report(watched, bus.statistics, spec, tip, time.perf_counter())
            if as_json:
                print_json(data | {"events": view.events})
            else:
                view.conclude(data)


def _watch(bus: Bus, watched: Monitor, view: View, seconds: float | None) -> None:
    """Until the time is over; it begins with the first reading."""
    import time

    end = None
    while end is None or time.perf_counter() < end:
        readings = bus.read(_LOOK_S)
        if readings and end is None and seconds is not None:
            end = readings[0].arrival + seconds
        watched.add(readings)
        view.show(watched, bus.statistics, time.perf_counter())
