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
@option("--out", "Folder for the results.", Folder(), required=True)
@flag("--dewarp", "Also correct the distortion of the EM tracker, and navigate.")
@click.option(
    "--robust/--no-robust",
    default=None,
    show_default=False,
    help="Leave out markers and frames that do not fit the others. Default: only in steps where "
    "this improves the prediction of left-out frames.",
)
def stereotactic(prefix: Path, dewarp: bool, robust: bool | None) -> Document:
    """Solve the stereotactic navigation problem of the files PREFIX-calbody.txt and so on.

    Writes NAME-output1.txt and a picture; with --dewarp also NAME-output2.txt, if the files of
    fiducials and navigation frames exist. NAME is the last part of PREFIX. Output files in the
    folder of the inputs are compared with the results. The exit code is 1 if the result must not be
    used.
    """
    data = StereotacticData.read(prefix, navigation=dewarp)
    with LateProgress("solving"):
        result = solve_stereotactic(data, dewarp=dewarp, robust=robust)
    answer = stereotactic_document(result, compare(result, read_given(result)))
    check_given(answer, results_folder(), data.prefix.parent)
    return answer
