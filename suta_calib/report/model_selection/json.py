"""Errors beside geometry that are worth having: verdict and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from suta_calib.analysis.model_selection import ModelSelection
from suta_calib.analysis.model_selection.candidate import ModelCandidate
from suta_calib.analysis.model_selection.cross_validation import limited_rms
from suta_calib.assessment import Assessment
from suta_calib.diagnostics.accuracy import TermAccuracy
from suta_calib.diagnostics.score_tests import ScoreTest
from suta_calib.model.nongeometric import Family
from suta_calib.model.parameters import Selection
from suta_calib.units import shown, text, unit_name
from suta_calib.words import listed

NAME: Final = "extend"
COMMAND: Final = "suta-calib extend"
LOOKS_LIKE: Final[dict[Family, str]] = {
    "ecc_1": "an eccentric encoder (first harmonic)",
    "ecc_2": "an eccentric encoder (second harmonic)",
    "compliance": "a joint that yields to gravity",
}
Validated = tuple[Sequence[TermAccuracy], Sequence[TermAccuracy]]


def extend_verdict(choice: ModelSelection) -> Assessment:
    """Whether anything should be added to the job, and what must be known."""
    gain = f"held-out RMS {_mm(choice.job)} → {_mm(choice.chosen)}"
    wider = choice.chosen.geometry and not choice.job.geometry
    if choice.added:
        more = "all of the geometry, " if wider else ""
        sentence = f"Add {more}{listed(list(choice.added))}: {gain}"
    elif wider:
        sentence = f"Free all of the geometry: {gain}; nothing beside geometry is worth having"
    else:
        sentence = "No error beside geometry predicts left-out data better: leave the job as it is"
    return Assessment.of(sentence, care=_notes(choice))


def _notes(choice: ModelSelection) -> list[str]:
    notes = []
    if choice.chosen is not choice.job:
        notes.append("The rows below, put into the job's parameters, make it so.")
    if choice.added:
        notes.append(
            "A URDF cannot hold these: calibrated.urdf will be the geometry only, and its tip is "
            "right only with the corrections of result.json (track --result applies them)."
        )
    if choice.undecided:
        notes.append(
            "Something beside the job's unknowns helps, but these data cannot tell whether it is "
            "geometry or an error beside it: tilt the artefact, use other heights, or touch one "
            "point from many directions."
        )
    bounded = [n for n in choice.added if choice.chosen.solution.estimates[n].state == "at_bound"]
    if bounded:
        notes.append(f"{listed(bounded)} ended at a bound: larger than is plausible.")
    return notes


def extend_dict(choice: ModelSelection, validated: Validated | None = None) -> dict[str, Any]:
    """The choice as data; lengths in mm.

    Args:
        choice: the result.
        validated: errors on the job's validation data with the job's and the chosen model.
    """
    assessment = extend_verdict(choice)
    return {
        "verdict": {
            "level": assessment.level,
            "sentence": assessment.sentence,
            "notes": assessment.notes,
        },
        "chosen": choice.chosen.name,
        "added": list(choice.added),
        "all_geometry": choice.chosen.geometry,
        "undecided": choice.undecided,
        "rows": [row_dict(row) for row in choice.rows],
        "estimates": _estimates(choice),
        "models": [_model(choice, each) for each in choice.tried],
        "folds": list(choice.folds),
        "residual_tests": [_test(each) for each in choice.tests],
        "validation": None if validated is None else validation_rms(validated),
    }


def validation_rms(validated: Validated) -> dict[str, float]:
    """RMS on the validation data with either model, mm; Huber-limited as those held out."""
    names = ("job_rms_mm", "chosen_rms_mm")
    return {n: shown(limited_rms(t), "m") for n, t in zip(names, validated, strict=True)}


def row_dict(row: Selection) -> dict[str, Any]:
    """A row of a job's ``parameters``."""
    sizes = {
        "bound_mm": row.bound_m and shown(row.bound_m, "m"),
        "bound_deg": row.bound_rad and shown(row.bound_rad, "rad"),
        "bound_deg_per_nm": row.bound_rad_per_nm and shown(row.bound_rad_per_nm, "rad/Nm"),
    }
    told = {key: float(f"{value:.6g}") for key, value in sizes.items() if value}
    return {"select": list(row.select), **told}


def row_text(row: Selection) -> str:
    """The same as a line of YAML."""
    entries = row_dict(row)
    names = ", ".join(f'"{n}"' if "*" in n else n for n in entries.pop("select"))
    rest = "".join(f", {key}: {value:g}" for key, value in entries.items())
    return f"- {{select: [{names}]{rest}}}"


def estimate_text(choice: ModelSelection, name: str) -> str:
    """``0.1998 ± 0.0021 deg``, or why there is no such number."""
    e = choice.chosen.solution.estimates[name]
    if e.std is None:
        return e.state.replace("_", " ")
    return f"{text(e.value, e.unit)} ± {text(e.std, e.unit)} {unit_name(e.unit)}"


def _estimates(choice: ModelSelection) -> dict[str, Any]:
    found = choice.chosen.solution.estimates
    return {
        n: {"unit": found[n].unit, "value": found[n].value, "std": found[n].std}
        | {"state": found[n].state}
        for n in choice.added
    }


def _model(choice: ModelSelection, each: ModelCandidate) -> dict[str, Any]:
    gain, error = each.gain_over(choice.job)
    loss = choice.job.held_out.loss
    return {
        "name": each.name,
        "unknowns": len(each.parameters),
        "all_geometry": each.geometry,
        "beside_geometry": list(each.added),
        "fitted_rms_mm": shown(each.fitted, "m"),
        "held_out_rms_mm": shown(each.held_out.rms, "m"),
        "held_out_variance_change_pct": -100 * gain / loss,
        "standard_error_pct": 100 * error / loss,
        "outdoes_job": each is not choice.job and each.outdoes(choice.job),
        "chosen": each is choice.chosen,
    }


def _test(each: ScoreTest) -> dict[str, Any]:
    return {
        "joint": each.joint,
        "family": each.family,
        "parameters": list(each.names),
        "p": each.p,
        "p_beside_geometry": each.p_beside_geometry,
        "suspicious": each.suspicious,
    }


def _mm(candidate: ModelCandidate) -> str:
    return text(candidate.held_out.rms, "m", with_unit=True)
