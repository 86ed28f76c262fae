"""Report of a repair: a whole result, in which what changed was estimated again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from suta_calib.assessment import Assessment, read_assessment
from suta_calib.check.read_back import ReadBack
from suta_calib.check.repair import Repair
from suta_calib.job import inputs_copy
from suta_calib.report.calibration import CALIBRATED, matrices_of
from suta_calib.report.calibration_tables import EXTERNAL_POSES
from suta_calib.report.check import CHANGED, ERRORS, error_rows, errors_of
from suta_calib.report.document import Document, File, Part, Text, section
from suta_calib.report.listing import Column, Json, Listing
from suta_calib.report.observability import PARAMETERS, Outcome
from suta_calib.trust.external_poses import external_poses
from suta_calib.units import Unit, text, unit_name
from suta_calib.words import enumerated

NAME: Final = "result"
_OLD_ERRORS: Final = (
    "The new rows say nothing about the rows of the calibration: metrics, noise, repeatability and "
    "validation in this result are of those rows, with the parameters as they were before the "
    "repair. To see the errors now, validate it with rows measured since (suta-calib validate)."
)
# Entries that the new rows renew; all others are of the calibration.
_RENEWED: Final = ("parameters", "external_poses", "unidentified", "correlations", "covariance")
# What is of the run that wrote it.
_OF_A_RUN: Final = ("files", "run", "verdict")


@dataclass(frozen=True)
class _Renewed:
    """A parameter that was estimated again."""

    name: str
    unit: Unit
    before: float
    after: float
    std: float | None


RENEWED: Final = Listing[_Renewed](
    "Estimated again",
    Column("name", "parameter"),
    Column("before", "before", unit=lambda row: row.unit, si=True),
    Column("after", "now", unit=lambda row: row.unit, si=True),
    Column("std", "± std", unit=lambda row: row.unit, si=True),
    Column("unit", "unit", cell=lambda row: unit_name(row.unit)),
)


def repair_document(repair: Repair, written: ReadBack, samples: Sequence[Path]) -> Document:
    """Document of the repaired result: what `calibrate` writes, and where it comes from."""
    parts: list[Part] = [
        *section("what was estimated again", lambda: _shown(repair)),
        *_files(repair, written),
    ]
    title = f"Calibration of {written.job.title}, repaired"
    record = _record(repair, written, samples)
    return Document(NAME, title, _assessment(repair, written), parts, record, "opening")


def _shown(repair: Repair) -> Iterator[Part]:
    yield CHANGED.of(repair.check.changed)
    yield errors_of(repair.check)
    yield RENEWED.of(_renewed(repair))
    yield Text(
        "All other parameters keep their value and their ± but for what the new rows add. "
        f"{_OLD_ERRORS}",
        place="page",
    )


def _renewed(repair: Repair) -> list[_Renewed]:
    now, old = repair.solution.estimates, repair.before.values
    return [
        _Renewed(name, e.unit, old.get(name, e.nominal), e.value, e.std)
        for name, e in now.items()
        if name in repair.names
    ]


def _assessment(repair: Repair, written: ReadBack) -> Assessment:
    """That of the calibration, with what the repair rests on."""
    before, check = read_assessment(written.content), repair.check
    what = enumerated([change.what for change in check.changed])
    notes = [
        f"The {what} was estimated again from {repair.rows} new rows; all else is the calibration "
        f"of {written.file}.",
        *_errors_now(repair),
    ]
    untold = [
        f"These rows cannot tell a change of the {change.what} from one of the "
        f"{enumerated(change.instead, 'or')}: what was estimated again may be the wrong one. "
        "Measure rows that tell them apart (suta-calib plan --for check)."
        for change in check.changed
        if change.instead
    ]
    answer = Assessment(before.level, before.sentence, (*notes, *before.notes))
    return answer.with_care([*untold, *check.notes])


def _errors_now(repair: Repair) -> Iterator[str]:
    """The errors of the rows that it rests on, and that all others in the result are old."""
    for kind, before, after, unit in error_rows(repair.check):
        yield (
            f"Errors of the new rows ({kind}): {text(before, unit, with_unit=True)} RMS before the "
            f"repair, {text(after, unit, with_unit=True)} after. metrics and validation in "
            f"{NAME}.json are those of the calibration's rows, before the repair."
        )


def _record(repair: Repair, written: ReadBack, samples: Sequence[Path]) -> Json:
    solution = repair.solution
    parameters = solution.problem.parameters
    every = [Outcome(e, parameters[name], True) for name, e in solution.estimates.items()]
    old: Mapping[str, Any] = written.content
    names, covariance = solution.told
    return {
        **{key: value for key, value in old.items() if key not in _OF_A_RUN},
        "parameters": {
            **old["parameters"],
            **_renewed_records(PARAMETERS.records(every), old["parameters"], solution.again),
        },
        "external_poses": EXTERNAL_POSES.records(external_poses(solution)),
        "unidentified": [n for n in old.get("unidentified", []) if n not in solution.again],
        **matrices_of(solution),
        "repaired": {
            "from": str(written.file),
            "from_run": (old.get("run") or {}).get("id"),
            "what": [change.what for change in repair.check.changed],
            "parameters": list(repair.names),
            "samples": [str(path) for path in samples],
            "rows": repair.rows,
            "errors": ERRORS.records(error_rows(repair.check)),
            "of_calibration": [key for key in old if key not in (*_RENEWED, *_OF_A_RUN)],
            # Of the rows that were calibrated: a check learns the noise from them.
            "before": dict(repair.before.values),
            "covariance": {"parameters": list(names), "unit": "m, rad", "matrix": covariance},
        },
    }


def _renewed_records(
    records: Any, old: Mapping[str, Any], again: Sequence[str]
) -> Mapping[str, Mapping[str, Any]]:
    """New records of parameters by name, with what only the calibration knows of them."""
    fields = ("prior", "bounds", "given")
    return {
        name: {
            **record,
            **{k: v for k, v in old.get(name, {}).items() if k in fields and name not in again},
        }
        for name, record in records.items()
        if record.get("std") is not None or name in again or name not in old
    }


def _files(repair: Repair, written: ReadBack) -> Iterator[File]:
    values, job = repair.solution.values, written.job
    yield File(CALIBRATED, lambda: job.arm.calibrated_urdf(values))
    for robot, content in job.arm.calibrated_urdfs(values).items():
        name = f"{CALIBRATED.removesuffix('.urdf')}_{robot}.urdf"
        yield File(name, partial(bytes, content))
    for name in ("residuals.csv", inputs_copy.NAME):
        there = written.file.with_name(name)
        if there.is_file():
            yield File(name, there.read_bytes)
