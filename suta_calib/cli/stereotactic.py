"""``suta-calib stereotactic``: the JHU CIS stereotactic navigation problem, file to file."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.assessment import NOT_USABLE
from suta_calib.cli._output import check_folder, console, json_option, print_json
from suta_calib.cli._poses import LateStatus


@click.command()
@click.argument("prefix", type=click.Path(path_type=Path), metavar="PREFIX")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder to write into.")
@click.option("--dewarp", is_flag=True, help="Correct the EM tracker's distortion, and navigate.")
@click.option(
    "--robust/--no-robust",
    default=False,
    show_default=True,
    help="Find markers and frames that do not fit the others, and leave them out.",
)
@json_option
@click.pass_context
def stereotactic(
    context: click.Context, prefix: Path, out: Path, dewarp: bool, robust: bool, as_json: bool
) -> None:
    """Solve the stereotactic navigation problem of the files PREFIX-calbody.txt and so on.

    Writes NAME-output1.txt and a picture; with --dewarp also NAME-output2.txt, where the fiducials
    and navigation frames are there. NAME is the last part of PREFIX. Output files that stand beside
    the inputs are compared with. Exits with 1 where the answer must not be used.
    """
    from suta_calib.report.stereotactic.report import (
        stereotactic_dict,
        stereotactic_tables,
        write_stereotactic,
    )
    from suta_calib.stereotactic.assessment import judge_stereotactic
    from suta_calib.stereotactic.comparison import compare, read_given
    from suta_calib.stereotactic.data import StereotacticData
    from suta_calib.stereotactic.solve import solve_stereotactic

    data = StereotacticData.read(prefix, navigation=dewarp)
    check_folder(out)
    with LateStatus("solving"):
        result = solve_stereotactic(data, dewarp=dewarp, robust=robust)
    comparison, assessment = compare(result, read_given(result)), judge_stereotactic(result)
    files = write_stereotactic(result, assessment, out)
    if as_json:
        answer = stereotactic_dict(result, assessment, comparison)
        print_json(answer | {"files": {name: str(path) for name, path in files.items()}})
    else:
        to = console()
        to.print(stereotactic_tables(result, assessment, comparison))
        to.print(f"Written to {out}: {', '.join(files)}", soft_wrap=True)
    if not assessment.usable:
        context.exit(NOT_USABLE)
