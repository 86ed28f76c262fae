"""``suta-calib emulate``: an arm without the arm, on a pseudo-terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import click

from suta_calib.cli._options import (
    PATH,
    POSITIVE,
    WRITTEN,
    FiniteRange,
    flag,
    option,
    urdf_argument,
)
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
@urdf_argument("ARM.urdf")
@option("--tip FRAME", "Tip of the arm; the script's by default.")
@option("--base LINK", "First link; the root by default.")
@option("--rate", "Frames per second.", FiniteRange(1e-3, 1e5), 768.0)
# What it does.
@option(
    "--script JOB.yaml",
    "Rest on the landmarks (or points) of a calibration.yaml or simulation.yaml, "
    "one after the other. After each placement the arm waits until the port is closed "
    "and opened again.",
    PATH,
)
@option(
    "--motion",
    "Without a script: rest (default), pivot on a point, or swing every joint.",
    click.Choice(["still", "pivot", "trajectory"]),
)
@option("--set", "Which set of a simulation; the first.", name="set_name")
@option(
    "--placement P1=x,y,z,roll,pitch,yaw",
    "Where the artefact stands, mm and degrees. A label alone: as in the simulation, "
    "or for a job somewhere within reach.",
    name="placements",
    multiple=True,
)
@option(
    "--point F1=x,y,z",
    "A fixed point, mm: to be touched (script) or pivoted on.",
    name="points",
    multiple=True,
)
@option("--sequence", "Landmarks in order; as in the artefact.", default="")
@option("--repeats", "How often each placement is gone through.", _COUNT)
@option("--directions", "Rests on each fixed point; 20.", _COUNT)
@option("--rest", "Duration of a rest, s.", POSITIVE, 4.0)
@option("--move", "Of a motion between two, s.", POSITIVE, 1.5)
@option("--seating-mm", "Seating noise per axis; 0.05.", _NOT_NEGATIVE)
@option(
    "--posture JOINT=DEG,…",
    "Where it rests or starts, or the search does; the middle of the ranges.",
    default="",
)
@option("--cone", "Largest tilt, degrees.", POSITIVE, 30.0)
@option("--period", "Of a pivoting, s.", POSITIVE, 40.0)
@option("--amplitude", "Of swings, degrees.", POSITIVE, 20.0)
@option(
    "--frequency FROM TO",
    "Of swings at the start and at the end, Hz.",
    (POSITIVE, POSITIVE),
    (0.05, 0.5),
)
@option("--duration", "Of the swings, s.", POSITIVE, 60.0)
@option("--csv", "A trajectory: time (s) and every joint (rad).", PATH)
# What is true, and what is read.
@option("--truth", "True parameters: a truth.yaml, or a simulation.yaml for its errors.", PATH)
@option(
    "--errors-seed",
    "Draw the true parameters: a job's unknowns, or offsets and lengths "
    "(0.75 deg, 1 mm, tilts 0.1 deg).",
    _SEED,
)
@option("--seed", "Of noise, seating and faults.", _SEED, 0)
@option("--encoder-deg", "Noise of a reading.", _NOT_NEGATIVE, 0.001)
# What is sent.
@option("--format", "", click.Choice(_SENT), "frames", name="form")
@option("--unit", "", click.Choice(UNITS), "counts")
@option("--counts-per-turn", "", click.IntRange(2, 1 << 32), 1 << 22)
@option("--signs 1,-1,…", "Of the encoders; all 1.", default="")
@option("--baudrate", "For device.yaml only.", click.IntRange(1, 1 << 31), 921600)
@option("--faults LIST", "What goes wrong; see below.", multiple=True)
@option("--link PATH", "Symbolic link to keep to the port.", PATH)
@option("--seconds", "Stop after so long, waiting included.", POSITIVE)
@option(
    "--start",
    "Begin when the port is first opened, or at once.",
    click.Choice(["open", "now"]),
    "open",
)
@flag("--continuous", "Do not wait between placements.")
@option("--device-out", "Write the device.yaml to read it with.", WRITTEN)
@option("--truth-out", "Write the truth (YAML), to judge a result by.", WRITTEN)
@option("--trajectory-out", "Write the true tip poses (CSV) at the end.", WRITTEN)
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
