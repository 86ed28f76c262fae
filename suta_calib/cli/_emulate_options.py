"""The options of ``suta-calib emulate`` that describe the arm, in the order of --help."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import click

from suta_calib.cli._numbers import FiniteRange
from suta_calib.emulation.faults import WORDS

FILE: Final = click.Path(path_type=Path)
POSITIVE: Final = FiniteRange(min=0, min_open=True)
_NOT_NEGATIVE: Final = FiniteRange(min=0)
_SEED: Final = click.IntRange(min=0)
_COUNT: Final = click.IntRange(min=1)
_EPILOG: Final = "\b\nFaults, separated by commas; times are s after the port was first opened:\n"
FAULTS_HELP: Final = _EPILOG + "\n".join(f"  {k:<20} {v}" for k, v in WORDS.items())


@dataclass(frozen=True)
class EmulationOptions:
    """The options as typed: mm, degrees, s and Hz; what each means is in its help below."""

    urdf: Path
    tip: str | None
    base: str | None
    script: Path | None
    motion: str | None
    set_name: str | None
    placements: tuple[str, ...]
    points: tuple[str, ...]
    sequence: str
    repeats: int | None
    directions: int | None
    rest: float
    move: float
    seating_mm: float | None
    posture: str
    cone: float
    period: float
    amplitude: float
    frequency: tuple[float, float]
    duration: float
    csv: Path | None
    truth: Path | None
    errors_seed: int | None
    seed: int
    encoder_deg: float
    rate: float
    form: str
    unit: str
    counts_per_turn: int
    signs: str
    baudrate: int
    faults: tuple[str, ...]


_OPTIONS: Final = (
    click.argument("urdf", type=FILE, metavar="ARM.urdf"),
    click.option("--tip", metavar="FRAME", help="Tip of the arm; the script's by default."),
    click.option("--base", metavar="LINK", help="First link; the root by default."),
    click.option("--rate", default=768.0, type=POSITIVE, help="Frames per second."),
    # What it does.
    click.option(
        "--script",
        type=FILE,
        metavar="JOB.yaml",
        help="Rest on the landmarks (or points) of a calibration.yaml or simulation.yaml, "
        "one after the other. After each placement the arm waits until the port is closed "
        "and opened again.",
    ),
    click.option(
        "--motion",
        type=click.Choice(["still", "pivot", "trajectory"]),
        help="Without a script: rest (default), pivot on a point, or swing every joint.",
    ),
    click.option("--set", "set_name", help="Which set of a simulation; the first."),
    click.option(
        "--placement",
        "placements",
        multiple=True,
        metavar="P1=x,y,z,roll,pitch,yaw",
        help="Where the artefact stands, mm and degrees. A label alone: as in the simulation, "
        "or for a job somewhere within reach.",
    ),
    click.option(
        "--point",
        "points",
        multiple=True,
        metavar="F1=x,y,z",
        help="A fixed point, mm, to be touched (script) or pivoted on; or what else a set touches, "
        "such as a plane, with its roll, pitch, yaw. A label alone: as in the simulation.",
    ),
    click.option(
        "--sequence", default="", show_default=False, help="Landmarks in order; as in the artefact."
    ),
    click.option("--repeats", type=_COUNT, help="How often each placement is gone through."),
    click.option("--directions", type=_COUNT, help="Rests on each fixed point; 20."),
    click.option("--rest", default=4.0, type=POSITIVE, help="Duration of a rest, s."),
    click.option("--move", default=1.5, type=POSITIVE, help="Of a motion between two, s."),
    click.option("--seating-mm", type=_NOT_NEGATIVE, help="Seating noise per axis; 0.05."),
    click.option(
        "--posture",
        default="",
        show_default=False,
        metavar="JOINT=DEG,…",
        help="Where it rests or starts, or the search does; the middle of the ranges.",
    ),
    click.option("--cone", default=30.0, type=POSITIVE, help="Largest tilt, degrees."),
    click.option("--period", default=40.0, type=POSITIVE, help="Of a pivoting, s."),
    click.option("--amplitude", default=20.0, type=POSITIVE, help="Of swings, degrees."),
    click.option(
        "--frequency",
        default=(0.05, 0.5),
        type=(POSITIVE, POSITIVE),
        metavar="FROM TO",
        help="Of swings at the start and at the end, Hz.",
    ),
    click.option("--duration", default=60.0, type=POSITIVE, help="Of the swings, s."),
    click.option("--csv", type=FILE, help="A trajectory: time (s) and every joint (rad)."),
    # What is true, and what is read.
    click.option(
        "--truth",
        type=FILE,
        help="True parameters: a truth.yaml, or a simulation.yaml for its errors.",
    ),
    click.option(
        "--errors-seed",
        type=_SEED,
        help="Draw the true parameters: a job's unknowns, or offsets and lengths "
        "(0.75 deg, 1 mm, tilts 0.1 deg).",
    ),
    click.option("--seed", default=0, type=_SEED, help="Of noise, seating and faults."),
    click.option("--encoder-deg", default=0.001, type=_NOT_NEGATIVE, help="Noise of a reading."),
    # What is sent.
    click.option("--format", "form", type=click.Choice(["frames", "lines"]), default="frames"),
    click.option("--unit", type=click.Choice(["counts", "rad", "deg"]), default="counts"),
    click.option("--counts-per-turn", default=1 << 22, type=click.IntRange(min=2)),
    click.option(
        "--signs", default="", show_default=False, metavar="1,-1,…", help="Of the encoders; all 1."
    ),
    click.option("--baudrate", default=921600, type=_COUNT, help="For device.yaml only."),
    click.option("--faults", multiple=True, metavar="LIST", help="What goes wrong; see below."),
)


def described(command: Callable[..., Any]) -> Callable[..., Any]:
    """The command with these options, which it takes as keyword arguments."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command
