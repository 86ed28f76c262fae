"""``suta-calib measure``: from an arm on a cable to a samples file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from suta_calib.cli._numbers import FiniteRange
from suta_calib.cli._output import check_folder, json_option, print_json
from suta_calib.cli._signals import ended_by_sigterm
from suta_calib.errors import InputError

if TYPE_CHECKING:
    from suta_calib.acquisition.rest import RestSettings
    from suta_calib.acquisition.touch_sequence import TouchSequence

INCOMPLETE: Final = 1
INTERRUPTED: Final = "interrupted"
PATIENCE_S: Final = 60.0
_RESTS: Final = 20


@dataclass(frozen=True)
class MeasureOptions:
    """What the command line asks for; see `measure`.

    Attributes:
        labels: by sort of place (``placement``, ``point``, …), the label given.
    """

    job: Path
    device: Path
    labels: Mapping[str, str]
    free: bool
    repeat: str
    seconds: float
    rests: int
    continuous: float | None
    every: float
    out: Path | None
    sequence: str | None
    observation: str | None
    resume: bool
    yes: bool
    patience: float | None
    raw: Path | None
    urdf: Path | None
    drift_deg: float
    tremble_deg: float
    as_json: bool

    @property
    def rest(self) -> RestSettings:
        """What counts as rest."""
        from suta_calib.acquisition.rest import RestSettings
        from suta_calib.units import from_deg

        return RestSettings(drift=from_deg(self.drift_deg), tremble=from_deg(self.tremble_deg))


class PlaceCommand(click.Command):
    """A command with a flag for every sort of place that a kind of observation touches.

    Two are always there. The others are added where one is used, or help is asked for: loading the
    kinds takes a second, in which the arm may be leaving the first landmark.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse, with flags added that are not known yet."""
        known = {name for parameter in self.params for name in parameter.opts}
        given = {word.partition("=")[0] for word in args if word.startswith("--")}
        if given - known:
            from suta_calib.terms import KINDS

            places = dict.fromkeys(kind.place for kind in KINDS.values() if kind.place)
            self.params += [
                click.Option([f"--{place}"], help=f"Label of a {place}, in place of --point.")
                for place in places
                if f"--{place}" not in known
            ]
        return super().parse_args(ctx, args)


@click.command(cls=PlaceCommand)
@click.argument("job", type=click.Path(path_type=Path), metavar="JOB")
@click.option("--device", type=click.Path(path_type=Path), required=True, help="The device.yaml.")
@click.option("--placement", help="Label of where the artefact stands, such as P1.")
@click.option("--point", help="Label of a fixed point, such as F1, in place of --placement.")
@click.option("--free", is_flag=True, help="Readings only, with no label: wherever the arm rests.")
@click.option("--repeat", default="1", show_default=True, help="Which time this is measured.")
@click.option(
    "--seconds",
    type=FiniteRange(min=0.1),
    default=2.0,
    show_default=True,
    help="How long the arm's rest on each landmark is recorded.",
)
@click.option(
    "--rests",
    type=click.IntRange(min=1),
    default=_RESTS,
    show_default=True,
    help="How many rests, with --point or --free.",
)
@click.option(
    "--continuous",
    type=FiniteRange(min=0.1),
    metavar="S",
    help="With --point or --free: sample for S seconds while the arm moves, in place of rests.",
)
@click.option(
    "--every",
    type=FiniteRange(min=0.01),
    default=0.1,
    show_default=True,
    help="Seconds between two samples of --continuous.",
)
@click.option("--out", type=click.Path(path_type=Path), help="The CSV; among the job's by default.")
@click.option("--sequence", help="Landmarks in order, such as O,M1,M2; the artefact's by default.")
@click.option(
    "--observation", metavar="N|KIND", help="Which of the job's: 0, landmark, validation."
)
@click.option("--resume", is_flag=True, help="Go on after the last confirmed landmark.")
@click.option("--yes", is_flag=True, help="Ask nothing: each rest after a motion is the next one.")
@click.option(
    "--patience",
    type=FiniteRange(min=1),
    metavar="S",
    help=f"Give up when nothing happens for S seconds; {PATIENCE_S:g} with --yes, else never.",
)
@click.option("--raw", type=click.Path(path_type=Path), help="The whole stream, as Parquet.")
@click.option(
    "--urdf", type=click.Path(path_type=Path), help="For the distances shown; the job's by default."
)
@click.option(
    "--drift-deg",
    type=FiniteRange(min=0, min_open=True),
    default=0.02,
    show_default=True,
    help="How far an arm at rest may drift within a quarter of a second.",
)
@click.option(
    "--tremble-deg",
    type=FiniteRange(min=0, min_open=True),
    default=0.1,
    show_default=True,
    help="Standard deviation of the tremor that a hand may pass on to an arm at rest.",
)
@json_option
@click.pass_context
def measure(context: click.Context, /, **options: Any) -> None:
    """Measure one placement of the artefact of JOB (a calibration.yaml), or one fixed point.

    Waits until the arm rests on each landmark, records it, shows its scatter and how far its
    distances are from the artefact's, and writes it to the samples file at once: whatever happens
    then, what was confirmed is there, and --resume goes on. Readings are averaged on the circle; a
    window in which the arm moved or an encoder raised its error flag is recorded again. Nothing
    that was measured is ever overwritten. Exits with 1 where --patience ended it. Until it ends,
    the file of --raw is called FILE.part.
    """
    stated = {field.name for field in fields(MeasureOptions)}
    labels = {name: options.pop(name) for name in [*options] if name not in stated}
    given = {name: label for name, label in labels.items() if label is not None}
    chosen = MeasureOptions(labels=given, **options)
    measured = _measure(chosen)
    if chosen.as_json:
        print_json(measured)
    if measured["status"] == INTERRUPTED:
        raise KeyboardInterrupt
    if measured["status"] == "incomplete":
        context.exit(INCOMPLETE)


def _measure(options: MeasureOptions) -> dict[str, Any]:
    from suta_calib.device.description import glance, read_device
    from suta_calib.device.remote_port import RemotePort

    # The arm may rest on the first landmark already, and loading the rest takes a second.
    glanced = glance(options.device)
    first = None if glanced is None else RemotePort(glanced)
    try:
        _check(options)
        spec = read_device(options.device)
        from suta_calib.device.read_ahead import ReadAhead
    except BaseException:
        if first is not None:
            first.close()
        raise
    with ended_by_sigterm(), ReadAhead(spec, reconnect=True, first=first) as source:
        from suta_calib.acquisition.samples_file import SamplesFile
        from suta_calib.acquisition.session import ArmReadings
        from suta_calib.cli._measuring import Measuring

        plan, out = _plan(options)
        check_folder(out.parent)
        joints = plan.arm.joints
        choose = ArmReadings(spec, joints)
        file = SamplesFile(out, joints, plan.label_columns, plan.key, resume=options.resume)
        return Measuring(options, plan, spec, source, choose, file).run()


def _plan(options: MeasureOptions) -> tuple[TouchSequence, Path]:
    """What to measure, and where it goes."""
    from suta_calib.acquisition.touch_sequence import (
        kinds_of,
        read_arm,
        read_row,
        repeated,
        touched,
    )
    from suta_calib.terms import KINDS

    arm = read_arm(options.job, options.urdf)
    if options.free:
        out = options.out or options.job.parent / f"free_{options.repeat}.csv"
        return repeated(arm, None, None, options.repeat, options.rests), out
    ((place, label),) = options.labels.items()
    row = read_row(options.job, options.observation, kinds_of(place))
    if row.kind not in kinds_of(place):
        raise _unfitting(options, row.kind)
    if row.artefact is None:
        plan = repeated(arm, KINDS[row.kind], label, options.repeat, options.rests)
    else:
        sequence = None if options.sequence is None else _names(options.sequence)
        plan = touched(arm, row, label, options.repeat, sequence)
    return plan, options.out or row.file(label, options.repeat)


def _check(options: MeasureOptions) -> None:
    """Options that contradict each other."""
    from suta_calib.acquisition.touch_sequence import checked_label

    if len(options.labels) + options.free != 1:
        raise click.UsageError("expected one of --placement LABEL, --point LABEL and --free")
    placed = "placement" in options.labels
    if placed and options.continuous is not None:
        raise click.UsageError("found --continuous with --placement; expected --point or --free")
    if not placed and options.sequence is not None:
        raise click.UsageError("found --sequence without --placement; expected both")
    checked_label(options.repeat, "--repeat")


def _unfitting(options: MeasureOptions, kind: str) -> InputError:
    from suta_calib.acquisition.touch_sequence import kinds_of, place_option
    from suta_calib.terms import KINDS

    places = dict.fromkeys(each.place for each in KINDS.values() if each.place)
    flag = place_option(KINDS[kind]) if kind in KINDS else ""
    return InputError(
        f"an observation of kind {kind}",
        ", ".join(f"{' or '.join(kinds_of(place))} for --{place}" for place in places),
        file=options.job,
        where="--observation",
        hint=f"use {flag or '--free, and add what was seen to the file'}",
    )


def _names(sequence: str) -> list[str]:
    return [name.strip() for name in sequence.split(",") if name.strip()]
