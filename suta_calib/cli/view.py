"""``suta-calib view``: an arm one can look at."""

from __future__ import annotations

import math
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from suta_calib.atomic import write_bytes_atomically
from suta_calib.cli._options import PATH, POSITIVE, WRITTEN, anyway_option, json_option, option
from suta_calib.cli._output import LateProgress, console, print_json, printing
from suta_calib.device.device_file import read_device
from suta_calib.job.calibration import CalibrationJob
from suta_calib.tracking.read_back import read_calibrated
from suta_calib.tracking.viewing import LiveArm
from suta_calib.view.calibration import calibration_page, view_calibration

if TYPE_CHECKING:
    from suta_calib.device import DeviceSpec
    from suta_calib.view.calibrated import Calibrated
    from suta_calib.view.server import Viewer


@click.command()
@click.argument("job", type=PATH, metavar="JOB|RESULT")
@option("--html FILE.html", "Write one HTML file instead of starting a server.", WRITTEN)
@option("--port", "Port of the server; 0 for any free port.", click.IntRange(0, 65535), 8080)
@option(
    "--host ADDRESS",
    "Address of the server. Default: only this computer can look; with 0.0.0.0 everybody in the "
    "network who has the printed address.",
    default="127.0.0.1",
)
@option("--device", "device.yaml of a device that moves the arm live.", PATH)
@option("--seconds", "Stop after this time, in s.", POSITIVE)
@anyway_option
@json_option
@click.pass_context
def view(
    context: click.Context,
    /,
    job: Path,
    html: Path | None,
    port: int,
    host: str,
    device: Path | None,
    seconds: float | None,
    anyway: bool,
    as_json: bool,
) -> None:
    """Show a calibration in 3-D: in the browser, or in one file that opens offline.

    JOB (a calibration.yaml) is calibrated first; RESULT is a result.json, or its folder, as
    calibrate wrote it. The view shows the nominal and the calibrated arm (with their meshes, if
    these are found), the touched or seen points, errors and the uncertainty of the tip, magnified,
    and every sample; a click shows its name. Outliers are red. It ends after --seconds or with
    Ctrl-C. The exit code is 1 if the calibration must not be used.
    """
    if html is not None and device is not None:
        raise click.UsageError(
            "found --html with --device; expected only one: a file cannot show a live arm"
        )

    spec = None if device is None else read_device(device)
    calibrated = _calibrated(job, anyway=anyway)
    answer = {
        "title": calibrated.title,
        "samples": sum(len(term.poses) for terms in calibrated.terms.values() for term, _ in terms),
        "verdict": calibrated.assessment.as_dict(),
    }
    if html is not None:
        write_bytes_atomically(html, calibration_page(calibrated))
        _say(calibrated, {**answer, "html": str(html)}, f"Written: {html}", as_json=as_json)
        context.exit(calibrated.assessment.exit_code)

    serving = view_calibration(calibrated, port, host)
    with suppress(KeyboardInterrupt), serving as viewer:
        where = f"Open {viewer.url} in a browser; Ctrl-C ends it"
        _say(calibrated, {**answer, "url": viewer.url}, where, as_json=as_json)
        _serve(viewer, calibrated, spec, seconds)
    context.exit(calibrated.assessment.exit_code)


def _calibrated(job: Path, *, anyway: bool) -> Calibrated:
    """A job's calibration, made now; or a result's, read back."""
    if job.is_dir() or job.suffix.lower() == ".json":
        return read_calibrated(job, anyway=anyway)

    with LateProgress("calibrating") as progress:
        return CalibrationJob.load(job).run(progress).calibrated


def _say(calibrated: Calibrated, answer: dict[str, Any], where: str, *, as_json: bool) -> None:
    with printing():
        if as_json:
            print_json(answer)
            return
        verdict, to = calibrated.assessment, console()
        to.print(f"{verdict.word}. {verdict.statement}", soft_wrap=True)
        to.print(f"{calibrated.title}: {calibrated.summary}", soft_wrap=True)
        to.print(where, soft_wrap=True)


def _serve(
    viewer: Viewer, calibrated: Calibrated, device: DeviceSpec | None, seconds: float | None
) -> None:
    """Until the time is over: as it is, or as the device reads."""
    if device is None:
        # No clock waits for longer than this, some 290 years.
        wait = None if seconds is None else min(seconds, threading.TIMEOUT_MAX)
        threading.Event().wait(wait)
        return

    end = time.monotonic() + (math.inf if seconds is None else seconds)
    live = LiveArm(viewer, calibrated, device)
    live.follow(
        lambda: time.monotonic() > end,
        lambda message: click.echo(f"suta-calib: {message}", err=True),
    )
