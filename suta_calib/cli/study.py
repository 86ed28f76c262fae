"""``suta-calib study``: how many sets are enough, and how far the answer scatters."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import click
from joblib import cpu_count

from suta_calib.analysis.study import DriftOptions, Request
from suta_calib.cli._fleet import answer_of_many, answer_of_one, many_jobs
from suta_calib.cli._options import (
    POSITIVE,
    FiniteRange,
    anyway_option,
    option,
    seed_option,
)
from suta_calib.cli._output import answer_command, results_folder
from suta_calib.report.document import Document
from suta_calib.units import from_deg, from_mm, stored
from suta_calib.words import enumerated

if TYPE_CHECKING:
    from suta_calib.analysis.study.trial import Kind

_RANGE: Final = re.compile(r"(\d{1,6})(?:-(\d{1,6})(?::(\d{1,6}))?)?")


def _sizes(
    context: click.Context, parameter: click.Parameter, value: str | None
) -> tuple[int, ...] | None:
    """Numbers and ranges, a step after a colon, as sizes, ascending, each once."""
    if value is None:
        return None
    numbers: set[int] = set()
    for part in value.split(","):
        match = _RANGE.fullmatch(part.strip())
        first, last, step = match.groups() if match is not None else ("0", None, None)
        start, by = int(first), int(step or 1)
        sizes = range(start, int(last or first) + 1, by) if start and by else ()
        if not sizes:
            expected = "numbers from 1 and ranges, such as 1-10, 2,4,8 or 10-100:10"
            raise click.BadParameter(f"found {value!r}; expected {expected}", context, parameter)
        numbers.update(sizes)
    return tuple(sorted(numbers))


@answer_command
@many_jobs(of_one_too=True)
@option(
    "--kind",
    "What is studied.",
    click.Choice(["size", "bootstrap", "monte-carlo", "drift"]),
    "size",
)
@option("--trials", "Number of trials; for sizes: of each size.", click.IntRange(1, 100_000), 100)
@option("--sizes LIST", "Numbers of sets, such as 1-10 or 2,4,8; default: 1-10.", callback=_sizes)
@option(
    "--unit [set|placement|point|…|sample]",
    "What is drawn at random as a whole, such as all rows of one placement and repeat (set); "
    "default: set, if the data have sets.",
)
@option("--tolerance-pct", "Allowed error above the mean of the largest size, in %.", POSITIVE, 5.0)
@option("--walk-deg", "drift: change of each angle in one day (1 std).", FiniteRange(0, 360))
@option("--walk-mm", "drift: change of each length in one day (1 std).", FiniteRange(0, 1e6))
@option("--days", "drift: number of days to simulate.", FiniteRange(1e-6, 1e5), 90.0)
@seed_option("Seed of all random draws.")
@anyway_option
def study(job: tuple[Path, ...], kind: str, anyway: bool, **asked: Any) -> Document:
    """Repeat the calibration of JOB many times over parts of its data.

    size: random subsets of the measurement sets, judged on validation data, show how many sets are
    enough. bootstrap: sets drawn with replacement show how the estimates scatter. monte-carlo: data
    simulated at the solution show whether the predicted standard deviations are right. drift: the
    estimated parameters drift randomly by --walk-deg and --walk-mm, growing with the square root of
    time; the arm should be calibrated again when the validation error of 5 % of the arms has grown
    by --tolerance-pct.

    Every trial has its own random numbers, so that the result does not depend on the number of
    processes or on a cluster. Finished trials are kept in a .trials.csv next to the result; without
    --resume the study starts again. The exit code is 1 if no trial gave a result.

    With several JOBs each has a study of its own. The processes are shared between them. The files
    that end in _summary (JSON, CSV) have a row for each job. No job stops another. The exit code is
    that of the worst.
    """
    several = len(job) > 1
    trials, tolerance, seed = asked["trials"], stored(asked["tolerance_pct"], "%"), asked["seed"]
    walk_deg, walk_mm = asked["walk_deg"], asked["walk_mm"]
    # Loads what the help does not need.
    from suta_calib.fleet import Study

    if kind == "drift":
        of_sets = ("unit", "sizes") if several else ("unit", "sizes", "jobs", "dask", "resume")
        if any(asked[name] for name in of_sets):
            raise click.UsageError(
                "--kind drift draws no sets and runs in one process for each job: leave out "
                f"{enumerated([f'--{name}' for name in of_sets])}"
            )
        if not walk_deg and not walk_mm:
            raise click.UsageError(
                "--kind drift needs --walk-deg or --walk-mm, the drift of the parameters in one day"
            )
        walk = from_deg(walk_deg or 0.0), from_mm(walk_mm or 0.0)
        drift = DriftOptions(*walk, asked["days"], tolerance, trials, seed=seed)
        work = Study(drift=drift, anyway=anyway)
        return answer_of_many(work, "walking") if several else answer_of_one(work)
    if walk_deg is not None or walk_mm is not None:
        raise click.UsageError("--walk-deg and --walk-mm are for --kind drift")
    if asked["sizes"] is not None and kind != "size":
        raise click.UsageError(f"--sizes is for --kind size; {kind} uses all sets")

    chosen = cast("Kind", kind)
    request = Request(chosen, trials, asked["sizes"], asked["unit"], seed, tolerance)
    work = Study(request=request, anyway=anyway, processes=asked["jobs"] or int(cpu_count()))
    if several:
        return answer_of_many(work, "studying")
    try:
        return answer_of_one(work)
    except KeyboardInterrupt:
        log = results_folder() / request.log_name
        if log.exists():
            click.echo(f"finished trials are in {log}: continue with --resume", err=True)
        raise
