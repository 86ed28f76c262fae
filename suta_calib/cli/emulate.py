"""``suta-calib emulate``: an arm without the arm, on a pseudo-terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import click
import numpy as np

from suta_calib.cli._options import (
    PATH,
    POSITIVE,
    WRITTEN,
    FiniteRange,
    chain_option,
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
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.units import from_deg, from_mm

if TYPE_CHECKING:
    from suta_calib.simulation import PoseSpec

_NOT_NEGATIVE: Final = FiniteRange(min=0)
_SEED: Final = click.IntRange(min=0)
# As many rests as a day has seconds.
_COUNT: Final = click.IntRange(1, 86_400)
# Who speaks only when asked cannot be stood for by a stream.
_SENT: Final = [name for name, form in FORMATS.items() if not form.asked]
_EPILOG: Final = "\nFaults, separated by commas; times are in s after the port was first opened:\n"
_FAULTS_HELP: Final = _EPILOG + "\n\b\n" + "\n".join(f"{k:<20} {v}" for k, v in WORDS.items())


@click.command(epilog=_FAULTS_HELP)
@urdf_argument("ARM.urdf")
@option("--tip FRAME", "Tip of the arm; default: the script's.")
@chain_option
@option("--base LINK", "First link of the chain; default: the root link.")
@option("--rate", "Frames per second.", FiniteRange(1e-3, 1e5), 768.0)
# What it does.
@option(
    "--script JOB.yaml",
    "Rest on the landmarks (or points) of a calibration.yaml or simulation.yaml in turn. After "
    "each placement the arm waits until the port is closed and opened again.",
    PATH,
)
@option(
    "--motion",
    "Motion without a script: rest (default), pivot about a point, swing every joint, rest in "
    "random postures, or sweep as by hand with the tip in a socket or on a plate.",
    click.Choice(["still", "pivot", "trajectory", "postures", "socket", "plate"]),
)
@option("--set", "Name of the simulation's set; default: the first.", name="set_name")
@option(
    "--placement P1=x,y,z,roll,pitch,yaw",
    "Pose of a placement of the artefact, in mm and degrees. With only the label: the pose in the "
    "simulation, or for a job any pose within reach.",
    name="placements",
    multiple=True,
)
@option(
    "--point F1=x,y,z",
    "A fixed point in mm, to be touched (with a script), pivoted about or swept on. Of a plate: "
    "its middle; with roll,pitch,yaw its z axis is square to it.",
    name="points",
    multiple=True,
)
@option("--sequence", "Landmarks in order; default: as in the artefact.", default="")
@option("--repeats", "How often each placement is measured.", _COUNT)
@option(
    "--directions",
    "Number of rests on each fixed point, or of random postures; default 20.",
    _COUNT,
)
@option("--rest", "Duration of a rest, in s.", POSITIVE, 4.0)
@option("--move", "Duration of the motion between two rests, in s.", POSITIVE, 1.5)
@option("--seating-mm", "Seating noise per axis; default 0.05.", _NOT_NEGATIVE)
@option(
    "--posture JOINT=DEG,…",
    "Posture in which the arm rests or starts, or the search for postures starts; default: the "
    "middle of the ranges.",
    default="",
)
@option("--cone", "Largest tilt, in degrees.", POSITIVE, 30.0)
@option("--period", "Duration of one pivoting motion, in s.", POSITIVE, 40.0)
@option("--amplitude", "Amplitude of the swings, in degrees.", POSITIVE, 20.0)
@option(
    "--frequency FROM TO",
    "Frequency of the swings at the start and at the end, in Hz.",
    (POSITIVE, POSITIVE),
    (0.05, 0.5),
)
@option("--size-mm", "Edge of the square on a plate that is swept.", POSITIVE, 150.0)
@option("--duration", "Duration of the swings, or of the sweep, in s.", POSITIVE, 60.0)
@option("--csv", "A trajectory: columns time (s) and every joint (rad).", PATH)
# What is true, and what is read.
@option("--truth", "True parameters: a truth.yaml, or the errors of a simulation.yaml.", PATH)
@option(
    "--errors-seed",
    "Seed of random true parameters: the unknowns of a job, or offsets and lengths (0.75 deg, 1 "
    "mm, tilts 0.1 deg).",
    _SEED,
)
@option("--seed", "Seed of noise, seating and faults.", _SEED, 0)
@option("--encoder-deg", "Standard deviation of a reading.", _NOT_NEGATIVE, 0.001)
@option(
    "--accelerometer ROLL PITCH YAW",
    "Send ax, ay, az of an accelerometer that is strapped to the tip's link, after the joints "
    "(--format lines); its orientation there, in degrees, as in a URDF.",
    (FiniteRange(), FiniteRange(), FiniteRange()),
)
@option("--accelerometer-deg", "Standard deviation of its direction.", _NOT_NEGATIVE, 0.2)
# What is sent.
@option(
    "--format", "Format of the bytes that are sent.", click.Choice(_SENT), "frames", name="form"
)
@option("--unit", "Unit of the readings that are sent.", click.Choice(UNITS), "counts")
@option("--counts-per-turn", "Counts of an encoder per turn.", click.IntRange(2, 1 << 32), 1 << 22)
@option("--signs 1,-1,…", "Signs of the encoders; default: all 1.", default="")
@option(
    "--baudrate", "Baud rate that is written to device.yaml.", click.IntRange(1, 1 << 31), 921600
)
@option("--faults LIST", "Faults of the connection; see below.", multiple=True)
@option("--link PATH", "Symbolic link that always points to the port.", PATH)
@option("--seconds", "Stop after this time in s, including waiting.", POSITIVE)
@option(
    "--start",
    "Start when the port is first opened, or immediately.",
    click.Choice(["open", "now"]),
    "open",
)
@flag("--continuous", "Do not wait between placements.")
@option("--device-out", "Write the device.yaml for reading this port.", WRITTEN)
@option("--truth-out", "Write the true parameters (YAML), to compare results with.", WRITTEN)
@option("--trajectory-out", "Write the true tip poses (CSV) at the end.", WRITTEN)
def emulate(**options: Any) -> None:
    """Emulate ARM.urdf: send encoder frames to a pseudo-terminal, in real time.

    The first line printed is the name of the port; messages go to stderr. It ends after --seconds
    or with Ctrl-C. Servos on a bus are not emulated, because they must be polled one by one in
    their manufacturer's protocol.
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
    seating, mounting = options.pop("seating_mm"), options.pop("accelerometer")
    arm = EmulationOptions(
        placements=_places(options.pop("placements"), "--placement"),
        points=_places(options.pop("points"), "--point"),
        sequence=_listed(options.pop("sequence")),
        timing=Timing(options.pop("rest"), options.pop("move")),
        seating=None if seating is None else from_mm(seating),
        cone=from_deg(options.pop("cone")),
        amplitude=from_deg(options.pop("amplitude")),
        size=from_mm(options.pop("size_mm")),
        encoder=from_deg(options.pop("encoder_deg")),
        accelerometer=None if mounting is None else rotation_from_rpy(from_deg(np.array(mounting))),
        accelerometer_noise=from_deg(options.pop("accelerometer_deg")),
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
