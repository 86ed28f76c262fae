"""``suta-calib emulate``: an arm without the arm, on a pseudo-terminal."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from suta_calib.cli._emulate_options import FAULTS_HELP, FILE, POSITIVE, EmulationOptions, described
from suta_calib.cli._output import check_folder
from suta_calib.errors import InputError

if TYPE_CHECKING:
    from suta_calib.cli._emulation import Emulated
    from suta_calib.emulation.player import Player


@click.command(epilog=FAULTS_HELP, context_settings={"show_default": True})
@described
@click.option("--link", type=FILE, metavar="PATH", help="Symbolic link to keep to the port.")
@click.option("--seconds", type=POSITIVE, help="Stop after so long, waiting included.")
@click.option(
    "--start",
    type=click.Choice(["open", "now"]),
    default="open",
    help="Begin when the port is first opened, or at once.",
)
@click.option("--continuous", is_flag=True, help="Do not wait between placements.")
@click.option("--device-out", type=FILE, help="Write the device.yaml to read it with.")
@click.option("--truth-out", type=FILE, help="Write the truth (YAML), to judge a result by.")
@click.option("--trajectory-out", type=FILE, help="Write the true tip poses (CSV) at the end.")
def emulate(
    link: Path | None,
    seconds: float | None,
    start: str,
    continuous: bool,
    device_out: Path | None,
    truth_out: Path | None,
    trajectory_out: Path | None,
    **options: Any,
) -> None:
    """Emulate ARM.urdf: encoder frames on a pseudo-terminal, in real time.

    The first line printed is the name of the port; what happens is told on stderr. Ends after
    --seconds, or on Ctrl-C.
    """
    from suta_calib.cli._emulation import build
    from suta_calib.emulation.player import Player
    from suta_calib.emulation.terminal import PseudoTerminal

    for file in filter(None, (device_out, truth_out, trajectory_out)):
        check_folder(file.parent)
    made = build(EmulationOptions(**options))
    if made.emulation.faults.absences and link is None:
        raise InputError(
            "a port that vanishes and comes back under another name",
            "--link PATH, by which it is found again",
            where="--faults",
        )
    with PseudoTerminal(link) as terminal:
        _write_descriptions(made, terminal.port, device_out, truth_out)
        click.echo(terminal.name)
        _tell(_describe(made))
        player = Player(
            made.emulation,
            terminal,
            _tell,
            gated=not continuous,
            recorded=trajectory_out is not None,
        )
        try:
            with _terminated() as terminated:
                player.run(seconds or math.inf, terminated, wait=start == "open")
        finally:
            _finish(made, player, trajectory_out)


def _write_descriptions(
    made: Emulated, port: str, device_out: Path | None, truth_out: Path | None
) -> None:
    from suta_calib.emulation.truth import device_text, truth_text
    from suta_calib.measurements import write_text

    emulation = made.emulation
    if device_out is not None:
        device = replace(emulation.device, port=str(Path(port).absolute()))
        write_text(device_out, device_text(device))
    if truth_out is not None:
        text = truth_text(made.arm, made.values, emulation.seed, made.plan, emulation.motion)
        write_text(truth_out, text)


def _finish(made: Emulated, player: Player, trajectory_out: Path | None) -> None:
    from suta_calib.emulation.truth import write_trajectory

    played = player.played
    _tell(
        f"{played.sent} frames sent, {played.unheard} that nobody read, {played.silent} withheld "
        f"by faults; at most {1e3 * played.late:.1f} ms late"
    )
    if trajectory_out is not None:
        motion = made.emulation.motion
        write_trajectory(trajectory_out, made.arm, made.values, player.trajectory, motion)


def _describe(made: Emulated) -> str:
    from suta_calib.emulation.motion import Stops

    emulation = made.emulation
    text = f"{len(emulation.device.joints)} joints at {emulation.rate:g} Hz"
    if isinstance(emulation.motion, Stops):
        motion = emulation.motion
        rounds = len(motion.rounds)
        text += f", {len(motion.labels)} rests in {rounds} round{'s' * (rounds != 1)}"
    departing = sum(v != made.arm.parameters[n].nominal for n, v in made.values.items())
    return f"{text}; {departing} true parameters depart from the URDF's"


@contextmanager
def _terminated() -> Iterator[Callable[[], bool]]:
    """Whether this process was asked to end: then files are still written."""
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield asked.is_set
        return
    before = signal.signal(signal.SIGTERM, lambda *_: asked.set())
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGTERM, before)


def _tell(text: str) -> None:
    click.echo(f"emulate: {text}", err=True)
