"""The group of commands, and what becomes of their errors.

Commands are imported only when they are called: ``--help`` must not wait for Pinocchio.
"""

from __future__ import annotations

import codecs
import importlib
import io
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from keyword import iskeyword
from pathlib import Path
from typing import Any, Final

import click
from click.exceptions import Exit

from suta_calib import __version__
from suta_calib.atomic import inputs_kept
from suta_calib.cli._process import PROGRAM, discard_stdout, say_interrupted
from suta_calib.errors import (
    InputError,
    SutaCalibError,
    did_you_mean,
    is_interrupt,
    shortened,
)

# What --help says of each; the module of its name holds the click command.
COMMANDS: Final = {
    "demo": "Calibrate examples that come with the package.",
    "calibrate": "Calibrate an arm, or many, with everything that the job asks for.",
    "observe": "Show which parameters the data of a job can determine.",
    "study": "Study how many sets are enough, and how results scatter.",
    "extend": "Find errors other than geometry that are worth modelling.",
    "budget": "Split the error into encoders, seating, artefact and model.",
    "view": "Show the arm in 3-D with touches, errors and uncertainty.",
    "check": "Check by a few new rows whether a calibration is still right.",
    "validate": "Test any URDF with the validation data of a job.",
    "outliers": "Find the data of a job that contradict the rest.",
    "init": "Start a job for a URDF: write commented files to fill in.",
    "simulate": "Simulate measurements of an arm with known errors.",
    "pivot": "Find the tip of a tracked tool that pivots about a point.",
    "detect": "Find the corners of a board in pictures, and the camera.",
    "balls": "Find balls in clouds of points from a depth camera.",
    "planes": "Find a plane in clouds of points from a depth camera or a scanner.",
    "hand-eye": "Find the pose of a camera: AX=XB or AX=ZB.",
    "rig": "Find the poses between cameras that saw a board together.",
    "register": "Find the rigid transform between corresponding points.",
    "stereotactic": "Navigate with two trackers, distortion and CT (JHU files).",
    "certify": "Make an artefact (a body with certified landmarks) from raw tracker points.",
    "monitor": "Show live what a device sends and what is wrong with it.",
    "emulate": "Emulate an arm: send its frames to a virtual port.",
    "track": "Send the live tip to console, files, OpenIGTLink or UDP.",
    "path-accuracy": "Compare a recorded motion with a reference.",
    "measure": "Record a samples file from a connected arm.",
    "guide": "Lead through a measurement on a page in the browser.",
    "plan": "Choose where to measure next, and when to stop.",
    "tip-map": "Show the uncertainty of the tip in the workspace.",
    "residual-map": "Correct what the calibration leaves, where left-out data prove it.",
    "zero-offsets": "Find encoder offsets from known poses of the tip.",
    "motors": "Find which motor moves which joint, from touches of a sheet.",
    "repeatability": "Measure the repeatability of an arm and its encoder noise.",
    "iso10360": "Acceptance test of a measuring arm by ISO 10360-12.",
    "certificate": "Write an answer as a document to sign and file (PDF, JSON).",
    "import": "Convert recordings, tables and robots of other programs.",
    "export": "Write a result in the format of another program.",
}

# Earlier names of commands, which scripts still use.
ALIASES: Final = {"dynamics": "path-accuracy", "baseline": "zero-offsets"}


@contextmanager
def _ended_by_reader() -> Iterator[None]:
    """Within it a reader of stdout that goes away, as ``| head`` does, ends the command well.

    What was to be done is done, or is of use to nobody any more. Click would end with 1, which
    means an answer that must not be used.
    """
    try:
        yield
    except BrokenPipeError:
        discard_stdout()
        raise Exit(0) from None


class LazyGroup(click.Group):
    """A group that imports a command's module when the command is asked for."""

    def make_context(self, *args: Any, **extra: Any) -> click.Context:
        with _ended_by_reader():
            return super().make_context(*args, **extra)

    def invoke(self, ctx: click.Context) -> Any:
        with _ended_by_reader():
            return super().invoke(ctx)

    def list_commands(self, ctx: click.Context) -> list[str]:
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        del ctx
        cmd_name = ALIASES.get(cmd_name, cmd_name)
        if cmd_name not in COMMANDS:
            return None
        name = cmd_name.replace("-", "_") + "_" * iskeyword(cmd_name)
        command = getattr(importlib.import_module(f"suta_calib.cli.{name}"), name)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if name not in COMMANDS and name not in ALIASES and not name.startswith("-"):
            hint = did_you_mean(name, COMMANDS) or f"{PROGRAM} --help lists them"
            raise click.UsageError(f"found {name!r}; expected a command; {hint}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(
    cls=LazyGroup,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(__version__, prog_name=PROGRAM)
@click.pass_context
def app(context: click.Context) -> None:
    """Calibrate the kinematics of serial arms: URDF and measurements in, calibrated URDF out.

    Exit codes: 0 done; 1 done, but the result must not be used; 2 wrong usage or input.
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command line.

    Args:
        arguments: without the program's name; those of this process by default.

    Returns:
        The exit code. Bad input, bad usage and an interrupt are one line on stderr.
    """
    _forgive_encodings()
    with warnings.catch_warnings(), inputs_kept():
        warnings.showwarning = _show_warning
        try:
            code = app.main(arguments, prog_name=PROGRAM, standalone_mode=False)
            sys.stdout.flush()
        except SutaCalibError as error:
            hint = _of_another_format(error, arguments)
            return _failed(f"{error}{hint}", error.exit_code)
        except click.ClickException as error:
            return _failed(shortened(_one_line(error.format_message())), error.exit_code)
        except (click.Abort, KeyboardInterrupt, SystemError) as error:
            if isinstance(error, SystemError) and not is_interrupt(error):
                raise
            return say_interrupted()
        except BrokenPipeError:
            discard_stdout()
            return 0
        except OSError as error:
            return _failed(_of_system(error))
        except MemoryError as error:
            too_large = _one_line(error) or "no details given"
            return _failed(
                f"found too little memory for these data ({too_large}); expected as much as they "
                "need; give fewer rows, or use a larger computer"
            )
    return code if isinstance(code, int) else 0


# What stands for a character that a terminal's encoding lacks; a question mark for any other.
_PLAIN: Final = {
    **{"±": "+-", "−": "-", "–": "-", "…": "...", "°": " deg", "µ": "u", "·": ".", "•": "*"},
    **{"→": "->", "←": "<-", "≤": "<=", "σ": "sigma", "×": "x", "²": "^2", "“": '"', "”": '"'},
}

# What has another name click does not take for a mistake: where it reads "ascii", it writes UTF-8.
_ASCII: Final = codecs.lookup("ascii")
_PLAIN_ASCII: Final = codecs.CodecInfo(
    _ASCII.encode,
    _ASCII.decode,
    incrementalencoder=_ASCII.incrementalencoder,
    incrementaldecoder=_ASCII.incrementaldecoder,
    name="plain_ascii",
)


def _forgive_encodings() -> None:
    """From now on, what stdout and stderr cannot encode is written in plain letters."""

    def plain(error: UnicodeError) -> tuple[str, int]:
        if not isinstance(error, UnicodeEncodeError):
            raise error
        lacking = error.object[error.start : error.end]
        return "".join(_PLAIN.get(character, "?") for character in lacking), error.end

    codecs.register_error("suta_calib.plain", plain)
    codecs.register({"plain_ascii": _PLAIN_ASCII}.get)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            is_ascii = codecs.lookup(stream.encoding).name == "ascii"
            encoding = "plain_ascii" if is_ascii else stream.encoding
            stream.reconfigure(encoding=encoding, errors="suta_calib.plain")


def _of_another_format(error: SutaCalibError, arguments: Sequence[str] | None) -> str:
    """What a file is that a command took for another, and the command that reads it."""
    if not isinstance(error, InputError):
        return ""
    words = sys.argv[1:] if arguments is None else arguments
    command = next((word for word in words if not word.startswith("-")), "")
    # Takes longer to import than most errors to be found.
    recognition = importlib.import_module("suta_calib.exchange.recognition")
    hint = recognition.other_format(error, ALIASES.get(command, command))
    return f"; {hint}" if hint else ""


def _of_system(error: OSError) -> str:
    """What the system said, and of what."""
    try:
        Path.cwd()
    except OSError:
        return (
            "found that the working folder no longer exists; expected an existing one; change "
            "to another folder"
        )
    name = f"{error.filename}: " if error.filename else ""
    return f"{name}{error.strerror or error}"


def _failed(message: object, code: int = 2) -> int:
    """The exit code, after a line on stderr that says why."""
    click.echo(f"{PROGRAM}: error: {_one_line(message)}", err=True)
    return code


def _one_line(message: object) -> str:
    return " ".join(str(message).split())


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """One line on stderr; where in the source it was raised helps nobody who has a job to run."""
    click.echo(f"{PROGRAM}: warning: {_one_line(message)}", err=True)
