"""``suta-calib demo``: what the package does, on examples that come with it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from shlex import join
from typing import Final

import click

from suta_calib.cli._formats import read_poses
from suta_calib.cli._options import Folder, option
from suta_calib.cli._output import LateProgress, console, printing, say_line
from suta_calib.cli._process import PROGRAM
from suta_calib.cli.calibrate import calibration_of
from suta_calib.demo import EXAMPLES, PICTURES, write_examples
from suta_calib.measurements.pose_files import read_pose_pairs
from suta_calib.pose_calibration import hand_eye_from_pairs
from suta_calib.report.console import rendered
from suta_calib.report.document import Document
from suta_calib.report.files import REPORT, write_document
from suta_calib.report.hand_eye import hand_eye_document


def _hand_eye(poses: Path) -> Document:
    pairs = read_pose_pairs(read_poses(poses))
    with LateProgress("calibrating"):
        return hand_eye_document(hand_eye_from_pairs(pairs), pairs)


_ANSWERS: Final[dict[str, Callable[[Path], Document]]] = {
    "calibrate": calibration_of,
    "hand-eye": _hand_eye,
}


@click.command()
@option(
    "--out",
    "Folder for the examples and their results.",
    Folder(),
    "suta-calib-demo",
)
def demo(out: Path) -> None:
    """Calibrate examples that come with the package: no file of yours is needed.

    A measured UR5, a simulated arm on a cable, a camera on a hand, and an arm with the camera on
    its hand from pictures. For each, the folder gets its files, and a report to open in a browser.
    The exit code is 1 if one of the results must not be used.
    """
    began = time.monotonic()
    write_examples(out)
    say_line(f"Examples written to {out}")
    codes = []
    for number, example in enumerate(EXAMPLES, start=1):
        say_line(f"\n[{number} of {len(EXAMPLES)}] {example.title}")
        say_line(f"$ {PROGRAM} {join(example.command)}")
        codes.append(_try(out / example.file, _ANSWERS[example.command[0]]))
    say_line(f"\nDone in {time.monotonic() - began:.0f} s. Open the reports in a browser:")
    for example in EXAMPLES:
        say_line(f"  {_results(out / example.file) / REPORT}")
    say_line(f"The commands above work in {out}. Corners in pictures, with suta_calib[vision]:")
    say_line(f"$ {PROGRAM} {join(PICTURES)}")
    say_line("Your own arm:\n$ suta-calib init YOUR.urdf")
    click.get_current_context().exit(max(codes))


def _results(file: Path) -> Path:
    """Where the answer on a job or a table of poses is written."""
    return file.parent / "results"


def _try(file: Path, answer_on: Callable[[Path], Document]) -> int:
    """Answer, show the verdict, write the results; the exit code."""
    began = time.monotonic()
    answer = answer_on(file)
    with printing():
        console().print(rendered(replace(answer, parts=())), crop=False, end="")
    hashes = {str(file): sha256(file.read_bytes()).hexdigest()}
    written = write_document(answer, _results(file), hashes)
    say_line(f"Report: {written['files'][REPORT]} ({time.monotonic() - began:.1f} s)")
    return answer.assessment.exit_code
