"""``suta-calib stereotactic``: the JHU CIS stereotactic navigation problem, file to file."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.cli._options import PATH, Folder, flag, option
from suta_calib.cli._output import LateProgress, answer_command, results_folder
from suta_calib.report.document import Document
from suta_calib.report.stereotactic import check_given, stereotactic_document
from suta_calib.stereotactic import StereotacticData, compare, read_given, solve_stereotactic


@answer_command
@click.argument("prefix", type=PATH, metavar="PREFIX")
@option("--out", "Folder to write into.", Folder(), required=True)
@flag("--dewarp", "Correct the EM tracker's distortion, and navigate.")
@click.option(
    "--robust/--no-robust",
    default=None,
    show_default=False,
    help="Leave out markers and frames that do not fit the others. Without this option: only in "
    "steps where that predicts left-out frames better.",
)
def stereotactic(prefix: Path, dewarp: bool, robust: bool | None) -> Document:
    """Solve the stereotactic navigation problem of the files PREFIX-calbody.txt and so on.

    Writes NAME-output1.txt and a picture; with --dewarp also NAME-output2.txt, where the fiducials
    and navigation frames are there. NAME is the last part of PREFIX. Output files that stand beside
    the inputs are compared with. Exits with 1 where the answer must not be used.
    """
    data = StereotacticData.read(prefix, navigation=dewarp)
    with LateProgress("solving"):
        result = solve_stereotactic(data, dewarp=dewarp, robust=robust)
    answer = stereotactic_document(result, compare(result, read_given(result)))
    check_given(answer, results_folder(), data.prefix.parent)
    return answer
