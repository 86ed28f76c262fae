"""``suta-calib guide``: a page in the browser that leads through a measurement."""

from __future__ import annotations

from dataclasses import fields
from functools import partial
from typing import Any

import click

from suta_calib.acquisition.measuring import MeasureOptions
from suta_calib.acquisition.rest import RestSettings
from suta_calib.cli._options import (
    PATH,
    POSITIVE,
    FiniteRange,
    chain_option,
    flag,
    job_argument,
    option,
    page_options,
    urdf_option,
)
from suta_calib.cli._output import open_page, say_line
from suta_calib.cli.measure import PlaceCommand
from suta_calib.guide.guiding import Guide, GuideOptions
from suta_calib.units import from_deg


@click.command(cls=PlaceCommand)
@job_argument
@option("--device", "The device.yaml of the arm.", PATH)
@flag("--emulate", "Emulate an arm, to try the page; in the folder emulated/ next to the job.")
@option("--placement", "Label of the artefact's placement; default: the next one.")
@option("--point", "Label of a fixed point, such as F1; default: the next placement.")
@flag(
    "--free",
    "Rest wherever the arm is brought: for observations without touches, whose numbers the device "
    "sends (extra_columns in device.yaml).",
)
@option("--repeat", "Number of this repeat of the measurement.", default="1")
@option("--seconds", "How long each rest of the arm is recorded, in s.", FiniteRange(min=0.1), 2.0)
@option("--rests", "Number of rests, on a point or with --free.", click.IntRange(1, 10_000), 20)
@option(
    "--observation N|KIND", "Which observation of the job: its number, its kind, or validation."
)
@chain_option
@urdf_option("URDF for the arm that is shown; default: the job's.")
@page_options
@option("--drift-deg", "Largest drift of an arm at rest, in a quarter of a second.", POSITIVE, 0.02)
@option(
    "--tremble-deg",
    "Largest standard deviation of the trembling of an arm at rest.",
    POSITIVE,
    0.1,
)
def guide(**options: Any) -> None:
    """Lead through the measurement of JOB (a calibration.yaml), on a page in the browser.

    The page says which landmark is next, and shows the arm as it moves. Each rest is found and
    recorded without a key. A landmark that does not fit the others is named at once. Bars show what
    is determined so far. Between placements the page says where the next one tells most, and when
    to stop; at the end it calibrates, and shows the verdict, the report and the files. The buttons
    Retake, Skip, Take now and Stop are also the keys r, s, Enter and q.

    Each sample is on the disk as soon as it is recorded. The same command continues where an
    earlier one ended, however it ended. It is measure that records: see there for the options.
    """
    page = {name: options.pop(name) for name in ("emulate", "port", "host")}
    stays_closed = options.pop("no_open")
    rest = RestSettings(
        drift=from_deg(options.pop("drift_deg")), tremble=from_deg(options.pop("tremble_deg"))
    )
    stated = {field.name for field in fields(MeasureOptions)}
    places = [name for name in options if name not in stated]
    labels = {name: label for name in places if (label := options.pop(name)) is not None}
    measuring = MeasureOptions(labels=labels, rest=rest, **options)
    opened = partial(open_page, no_open=stays_closed)
    Guide(GuideOptions(measuring, **page), say_line, opened).run()
