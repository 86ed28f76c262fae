"""``suta-calib measure``: from an arm on a cable to a samples file."""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import fields
from typing import Any

import click

from suta_calib.acquisition.measuring import MeasureOptions
from suta_calib.acquisition.measuring import measure as run
from suta_calib.acquisition.rest import RestSettings
from suta_calib.cli._options import (
    PATH,
    POSITIVE,
    FiniteRange,
    chain_option,
    flag,
    job_argument,
    json_option,
    numbers_of,
    option,
    urdf_option,
)
from suta_calib.cli._output import console, print_json, printing
from suta_calib.device.port_process import open_ahead
from suta_calib.terms import KINDS
from suta_calib.units import from_deg


class PlaceCommand(click.Command):
    """A command with a flag for every sort of place that a kind of observation touches.

    Two are always there. The others are added where one is used, or help is asked for: loading the
    kinds takes a second, in which the arm may be leaving the first landmark.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse, with flags added that are not known yet, and a sweep that has no time as 0."""
        for k, word in enumerate(args):
            if word == "--continuous" and not numbers_of(args[k + 1] if k + 1 < len(args) else ""):
                args[k] = "--continuous=0"
        declared = {name for parameter in self.params for name in parameter.opts}
        given = {word.partition("=")[0] for word in args if word.startswith("--")}
        if given - declared:
            places = dict.fromkeys(kind.place for kind in KINDS.values() if kind.place)
            self.params += [
                click.Option([f"--{place}"], help=f"Label of the {place}, instead of --point.")
                for place in places
                if f"--{place}" not in declared
            ]
        return super().parse_args(ctx, args)


@click.command(cls=PlaceCommand)
@job_argument
@option("--device", "The device.yaml of the arm.", PATH)
@option(
    "--recording FILE",
    "Readings that were recorded, instead of --device: a file of --raw, or a CSV with time and "
    "one column per joint.",
    PATH,
)
@option("--placement", "Label of the artefact's placement, such as P1.")
@option("--point", "Label of a fixed point, such as F1, instead of --placement.")
@flag(
    "--free",
    "Record only readings, without labels, wherever the arm rests. If the device sends what an "
    "observation needs (extra_columns in device.yaml, such as ax, ay, az), the samples are of this "
    "observation.",
)
@option("--repeat", "Number of this repeat of the measurement.", default="1")
@option(
    "--seconds",
    "How long each rest of the arm is recorded, in s; default: 2. With --continuous: how long the "
    "sweep is recorded; default: until a key is pressed.",
    FiniteRange(min=0.1),
)
@option("--rests", "Number of rests, with --point or --free.", click.IntRange(1, 10_000), 20)
@option(
    "--continuous [S]",
    "With --point or --free: record while the arm moves, instead of rests, for S seconds.",
    FiniteRange(min=0),
)
@option("--every", "Least time in s between two samples of --continuous.", FiniteRange(min=0), 0.0)
@option("--out", "The samples file; default: the one of the job.", PATH)
@option("--sequence", "Landmarks in order, such as O,M1,M2; default: as in the artefact.")
@option(
    "--observation N|KIND", "Which observation of the job: its number, its kind, or validation."
)
@chain_option
@flag("--resume", "Continue after the last confirmed landmark.")
@flag("--yes", "Ask no questions: each rest after a motion is the next landmark.")
@option(
    "--patience S",
    "Stop if nothing happens for S seconds; default: 60 with --yes, else never.",
    FiniteRange(min=1),
)
@option(
    "--camera NAME=SOURCE",
    "With --free: take a picture at each rest, with the camera of this number (0, 1, ...) or URL. "
    "Samples and pictures go to the folder NAME beside the job. If the job has a row of this "
    "camera, its board is sought at once: corners go to the row's file, and a rest without the "
    "board does not count.",
)
@option("--raw", "File for all readings, as Parquet.", PATH)
@urdf_option("URDF for the distances that are shown; default: the job's.")
@option("--drift-deg", "Largest drift of an arm at rest, in a quarter of a second.", POSITIVE, 0.02)
@option(
    "--tremble-deg",
    "Largest standard deviation of the trembling of an arm at rest.",
    POSITIVE,
    0.1,
)
@json_option
@click.pass_context
def measure(context: click.Context, /, **options: Any) -> None:
    """Measure one placement of the artefact of JOB (a calibration.yaml), or one fixed point.

    The command waits until the arm rests on each landmark, records it, shows its scatter and its
    distance errors, and writes it to the samples file at once. If the run is interrupted, the
    confirmed samples are kept, and --resume continues. Readings are averaged on the circle. If the
    arm moved or an encoder set its error flag, the rest is recorded again. Existing samples are
    never overwritten, and rows that another program adds meanwhile are kept. The exit code is 1 if
    --patience ended the run. Until the end, the file of --raw is called FILE.part.

    Other numbers that the device sends (extra_columns in device.yaml) are averaged too, and become
    columns of the samples. A rest in which such a sensor was shaken is recorded again.

    With --continuous, sweep the arm by hand while its tip is in a socket (--point) or on a plate
    (--plane). Postures that are 2 deg apart count, and nothing else. The whole stream is recorded
    beside the samples (.parquet). At the end, rows are left out that were read while the tip was
    off its place, and rows after a slip get a label of their own.
    """
    # The arm may rest on the first landmark already, and loading the rest takes a second.
    port = None if options["device"] is None else open_ahead(options["device"])
    with ExitStack() as stack:
        if port is not None:
            stack.callback(port.close)

        as_json = options.pop("as_json")
        stated = {field.name for field in fields(MeasureOptions)} | {"sequence", "yes"}
        places = [name for name in options if name not in stated and not name.endswith("_deg")]
        labels = {name: label for name in places if (label := options.pop(name)) is not None}
        rest = RestSettings(
            drift=from_deg(options.pop("drift_deg")), tremble=from_deg(options.pop("tremble_deg"))
        )
        if (sequence := options.pop("sequence")) is not None:
            options["sequence"] = tuple(
                filter(None, (name.strip() for name in sequence.split(",")))
            )
        seconds, continuous = options.pop("seconds"), options.pop("continuous")
        if continuous is not None:
            options["continuous"] = continuous or seconds or math.inf
        elif seconds is not None:
            options["seconds"] = seconds
        chosen = MeasureOptions(labels=labels, unattended=options.pop("yes"), rest=rest, **options)
        to = console(stderr=as_json)
        show = None
        if to.is_terminal:
            show = stack.enter_context(to.status("waiting for readings")).update

        def say(line: str) -> None:
            """At once: through a pipe, what is confirmed must not wait in a buffer."""
            with printing():
                to.print(line, soft_wrap=True)

        measured = run(chosen, say=say, show=show, port=port)
    if as_json:
        with printing():
            print_json(measured.as_dict())
    if measured.status == "interrupted":
        raise KeyboardInterrupt
    if measured.status == "incomplete":
        incomplete = 1
        context.exit(incomplete)
