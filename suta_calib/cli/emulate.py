"""``suta-calib emulate``: an arm without the arm, on a pseudo-terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import click

from suta_calib.cli._options import PATH, POSITIVE, WRITTEN, FiniteRange
from suta_calib.cli._output import noted_sigterm
from suta_calib.device.description import UNITS
from suta_calib.device.formats import FORMATS
from suta_calib.emulation.emulated import EmulationOptions, PlayOptions, emulated_device
from suta_calib.emulation.faults import WORDS, Faults
from suta_calib.emulation.script import Timing, parse_pose
from suta_calib.errors import InputError
from suta_calib.units import from_deg, from_mm

if TYPE_CHECKING:
    from suta_calib.simulation import PoseSpec

_NOT_NEGATIVE: Final = FiniteRange(min=0)
_SEED: Final = click.IntRange(min=0)
# As many rests as a day has seconds.
_COUNT: Final = click.IntRange(1, 86_400)
# Who speaks only when asked cannot be stood for by a stream.
_SENT: Final = [name for name, form in FORMATS.items() if not form.asked]
_EPILOG: Final = "\b\nFaults, separated by commas; times are s after the port was first opened:\n"
_FAULTS_HELP: Final = _EPILOG + "\n".join(f"  {k:<20} {v}" for k, v in WORDS.items())


@click.command(epilog=_FAULTS_HELP)
@click.argument("urdf", type=PATH, metavar="ARM.urdf")
@click.option("--tip", metavar="FRAME", help="Tip of the arm; the script's by default.")
@click.option("--base", metavar="LINK", help="First link; the root by default.")
@click.option("--rate", default=768.0, type=FiniteRange(1e-3, 1e5), help="Frames per second.")
# What it does.
@click.option(
    "--script",
    type=PATH,
    metavar="JOB.yaml",
    help="Rest on the landmarks (or points) of a calibration.yaml or simulation.yaml, "
    "one after the other. After each placement the arm waits until the port is closed "
    "and opened again.",
)
@click.option(
    "--motion",
    type=click.Choice(["still", "pivot", "trajectory"]),
    help="Without a script: rest (default), pivot on a point, or swing every joint.",
)
@click.option("--set", "set_name", help="Which set of a simulation; the first.")
@click.option(
    "--placement",
    "placements",
    multiple=True,
    metavar="P1=x,y,z,roll,pitch,yaw",
    help="Where the artefact stands, mm and degrees. A label alone: as in the simulation, "
    "or for a job somewhere within reach.",
)
@click.option(
    "--point",
    "points",
    multiple=True,
    metavar="F1=x,y,z",
    help="A fixed point, mm: to be touched (script) or pivoted on.",
)
@click.option(
    "--sequence", default="", show_default=False, help="Landmarks in order; as in the artefact."
)
@click.option("--repeats", type=_COUNT, help="How often each placement is gone through.")
@click.option("--directions", type=_COUNT, help="Rests on each fixed point; 20.")
@click.option("--rest", default=4.0, type=POSITIVE, help="Duration of a rest, s.")
@click.option("--move", default=1.5, type=POSITIVE, help="Of a motion between two, s.")
@click.option("--seating-mm", type=_NOT_NEGATIVE, help="Seating noise per axis; 0.05.")
@click.option(
    "--posture",
    default="",
    show_default=False,
    metavar="JOINT=DEG,…",
    help="Where it rests or starts, or the search does; the middle of the ranges.",
)
@click.option("--cone", default=30.0, type=POSITIVE, help="Largest tilt, degrees.")
@click.option("--period", default=40.0, type=POSITIVE, help="Of a pivoting, s.")
@click.option("--amplitude", default=20.0, type=POSITIVE, help="Of swings, degrees.")
@click.option(
    "--frequency",
    default=(0.05, 0.5),
    type=(POSITIVE, POSITIVE),
    metavar="FROM TO",
    help="Of swings at the start and at the end, Hz.",
)
@click.option("--duration", default=60.0, type=POSITIVE, help="Of the swings, s.")
@click.option("--csv", type=PATH, help="A trajectory: time (s) and every joint (rad).")
# What is true, and what is read.
@click.option(
    "--truth", type=PATH, help="True parameters: a truth.yaml, or a simulation.yaml for its errors."
)
@click.option(
    "--errors-seed",
    type=_SEED,
    help="Draw the true parameters: a job's unknowns, or offsets and lengths "
    "(0.75 deg, 1 mm, tilts 0.1 deg).",
)
@click.option("--seed", default=0, type=_SEED, help="Of noise, seating and faults.")
@click.option("--encoder-deg", default=0.001, type=_NOT_NEGATIVE, help="Noise of a reading.")
# What is sent.
@click.option("--format", "form", type=click.Choice(_SENT), default="frames")
@click.option("--unit", type=click.Choice(UNITS), default="counts")
@click.option("--counts-per-turn", default=1 << 22, type=click.IntRange(2, 1 << 32))
@click.option(
    "--signs", default="", show_default=False, metavar="1,-1,…", help="Of the encoders; all 1."
)
@click.option(
    "--baudrate", default=921600, type=click.IntRange(1, 1 << 31), help="For device.yaml only."
)
@click.option("--faults", multiple=True, metavar="LIST", help="What goes wrong; see below.")
@click.option("--link", type=PATH, metavar="PATH", help="Symbolic link to keep to the port.")
@click.option("--seconds", type=POSITIVE, help="Stop after so long, waiting included.")
@click.option(
    "--start",
    type=click.Choice(["open", "now"]),
    default="open",
    help="Begin when the port is first opened, or at once.",
)
@click.option("--continuous", is_flag=True, help="Do not wait between placements.")
@click.option("--device-out", type=WRITTEN, help="Write the device.yaml to read it with.")
@click.option("--truth-out", type=WRITTEN, help="Write the truth (YAML), to judge a result by.")
@click.option("--trajectory-out", type=WRITTEN, help="Write the true tip poses (CSV) at the end.")
def emulate(**options: Any) -> None:
    """Emulate ARM.urdf: encoder frames on a pseudo-terminal, in real time.

    The first line printed is the name of the port; what happens is told on stderr. Ends after
    --seconds, or on Ctrl-C. A bus of servos is not emulated: they speak only when they are asked,
    each by its number, and whoever listens would have to be answered in their maker's protocol.
    """
    playing = PlayOptions(
        link=options.pop("link"),
        seconds=options.pop("seconds") or math.inf,
        wait=options.pop("start") == "open",
        gated=not options.pop("continuous"),
        device_out=options.pop("device_out"),
        truth_out=options.pop("truth_out"),
        trajectory_out=options.pop("trajectory_out"),
    )
    seating = options.pop("seating_mm")
    arm = EmulationOptions(
        placements=_places(options.pop("placements"), "--placement"),
        points=_places(options.pop("points"), "--point"),
        sequence=_listed(options.pop("sequence")),
        timing=Timing(options.pop("rest"), options.pop("move")),
        seating=None if seating is None else from_mm(seating),
        cone=from_deg(options.pop("cone")),
        amplitude=from_deg(options.pop("amplitude")),
        encoder=from_deg(options.pop("encoder_deg")),
        signs=_signs(options.pop("signs")),
        faults=Faults.parse(",".join(options.pop("faults"))),
        **options,
    )

    def say(text: str) -> None:
        click.echo(f"emulate: {text}", err=True)

    with noted_sigterm() as stopped:
        emulated_device(arm).play(playing, announce=click.echo, say=say, stopped=stopped)


def _listed(text: str) -> tuple[str, ...]:
    return tuple(filter(None, (word.strip() for word in text.split(","))))


def _signs(text: str) -> tuple[int, ...]:
    signs = {"1": 1, "+1": 1, "+": 1, "-1": -1, "-": -1}
    words = _listed(text)
    if not all(word in signs for word in words):
        raise InputError(repr(text), "1 or -1 for each joint", where="--signs")
    return tuple(signs[word] for word in words)


def _places(texts: tuple[str, ...], where: str) -> dict[str, PoseSpec | None]:
    """``P1=x,y,z…`` as label and pose, ``P1`` as a label alone."""
    return dict(parse_pose(text, where) if "=" in text else (text, None) for text in texts)
