"""Studies as JSON data: mm, degrees and percent by name."""

from __future__ import annotations

import math
from typing import Any, Final

from suta_calib.analysis.study.plan import StudyPlan
from suta_calib.analysis.study.sets import described
from suta_calib.analysis.study.sizes import SizeResult, SizeStudy
from suta_calib.analysis.study.spread import ParameterSpread, SpreadStudy
from suta_calib.analysis.study.trial import TOLD
from suta_calib.assessment import Assessment
from suta_calib.units import shown, unit_name

PERCENT: Final = 100.0
Json = dict[str, Any]


def study_dict(study: SizeStudy | SpreadStudy) -> Json:
    """What a study found. Nothing in it depends on how many workers did it, or how fast."""
    if isinstance(study, SizeStudy):
        found = _sizes(study)
    else:
        found = _spreads(study)
    failures = [{"problem": p, "count": n} for p, n in study.failures.items()]
    rest = {"failures": failures, "verdict": _verdict(study.assessment)}
    return _asked(study.plan) | found | rest


def held_out(plan: StudyPlan) -> str:
    """What the errors are of."""
    if plan.data.validation:
        return "validation data"
    return "nothing" if plan.data.kind == "monte-carlo" else "sets not drawn"


def _asked(plan: StudyPlan) -> Json:
    data = plan.data
    return {
        "kind": data.kind,
        "unit": data.sets.unit,
        "set_is": described(data.sets.unit),
        "sets": len(data.sets),
        "kept_whole": [data.terms[k].kind for k in data.sets.kept_whole],
        "seed": data.seed,
        "trials": plan.trials,
        "metric": {
            "name": f"RMS {data.judged_by.blocks[0].name} error",
            "kind": data.judged_by.kind,
            "held_out": held_out(plan),
        },
    }


def _sizes(study: SizeStudy) -> Json:
    return {
        "sizes": [_size(result) for result in study.sizes],
        "left_out_sizes": list(study.plan.left_out),
        "baseline_size": study.baseline,
        "tolerance_pct": PERCENT * study.tolerance,
        "recommended_size": study.recommended,
        "uncalibrated_mm": shown(study.uncalibrated, "m"),
    }


def _size(result: SizeResult) -> Json:
    return {
        "size": result.size,
        "trials": result.trials,
        "failed": result.failed,
        "distinct": result.distinct,
        "mean_mm": shown(result.mean, "m"),
        "std_mm": shown(result.std, "m"),
        "min_mm": shown(result.minimum, "m"),
        "max_mm": shown(result.maximum, "m"),
        "improvement_pct": PERCENT * result.improvement,
    }


def _spreads(study: SpreadStudy) -> Json:
    low, high = study.validation.interval
    return {
        "solved": study.solved,
        "parameters": {name: _parameter(p) for name, p in study.parameters.items()},
        "validation": {
            "rms_mm": shown(study.full_rms, "m"),
            "trials": len(study.validation.values),
            "mean_mm": shown(study.validation.mean, "m"),
            "std_mm": shown(study.validation.std, "m"),
            "interval_mm": [shown(low, "m"), shown(high, "m")],
        },
    }


def _parameter(parameter: ParameterSpread) -> Json:
    """SI as in ``result.json``, with the same in mm or degrees where people look."""
    e = parameter.estimate
    told: Json = {"unit": e.unit, "state": e.state, "told": len(parameter.spread.values)}
    if e.state not in TOLD:
        return told
    low, high = parameter.spread.interval
    suffix = unit_name(e.unit)
    spread, predicted = parameter.spread.std, parameter.predicted
    return told | {
        "value": e.value,
        "std": e.std,
        "mean": parameter.spread.mean,
        "spread": spread,
        "interval": [low, high],
        "predicted_std": predicted,
        "ratio": parameter.ratio if math.isfinite(parameter.ratio) else None,
        "as_predicted": parameter.as_predicted if math.isfinite(parameter.ratio) else None,
        f"spread_{suffix}": shown(spread, e.unit),
        f"predicted_std_{suffix}": shown(predicted, e.unit),
    }


def _verdict(assessment: Assessment) -> Json:
    return {
        "level": assessment.level,
        "usable": assessment.usable,
        "sentence": assessment.sentence,
        "notes": list(assessment.notes),
    }
