"""``result.json``: the whole result for programs, SI inside, ``_mm`` and ``_deg`` where not."""

from __future__ import annotations

import math
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final

import numpy as np

from suta_calib.diagnostics.accuracy import Metrics, TermAccuracy
from suta_calib.model.parameters import Parameter
from suta_calib.report.errors_by import KindErrors, by_kind
from suta_calib.report.result import Result, labelled_terms
from suta_calib.solver.solution import Estimate, Solution
from suta_calib.units import Unit, shown, unit_name

DISTRIBUTIONS: Final = ("suta_calib", "pin", "casadi", "numpy")
Json = dict[str, Any]


def result_dict(result: Result) -> Json:
    """A calibration as the content of ``result.json``.

    A result that did not converge carries no values: ``value``, ``std`` and the metrics ``after``
    are null, so that nobody uses them by accident.

    Args:
        result: job, solution and accuracy.

    Returns:
        Only dict, list, str, int, finite float, bool and None: ready for `json.dumps`.
    """
    solution = result.solution
    content = {
        "status": "converged" if solution.converged else "not_converged",
        "verdict": solution.sentence,
        "job": result.job.spec.path.name,
        "parameters": {name: _parameter(solution, name) for name in solution.problem.names},
        "unidentified": list(solution.unidentified),
        "unobservable": _combinations(solution),
        "excluded": _excluded(result),
        "metrics": _metrics(result),
        "timing_s": _timing(solution),
        "correlations": _correlations(solution),
        "covariance": _covariance(solution),
        "noise": _noise(result),
        "solver": _solver(solution),
        "versions": versions(),
    }
    return {key: _finite(value) for key, value in content.items()}


def metrics_dict(metrics: Metrics, unit: Unit = "m") -> Json:
    """RMS, mean, standard deviation and maximum in mm (or deg), and the count."""
    suffix = unit_name(unit)
    values = {
        "rms": metrics.rms,
        "mean": metrics.mean,
        "std": metrics.std,
        "max": metrics.maximum,
    }
    known = {f"{key}_{suffix}": _finite(shown(value, unit)) for key, value in values.items()}
    return known | {"count": metrics.count}


def accuracy_dict(terms: Sequence[TermAccuracy]) -> Json:
    """Metrics ``before`` and ``after`` of all terms of the first one's kind."""
    if not terms:
        nothing = metrics_dict(Metrics.of(np.zeros(0)))
        return {"before": nothing, "after": dict(nothing)}
    found = by_kind(terms)
    first = [errors for errors in found if errors.kind == terms[0].term.kind]
    return {"before": _of_kind(first, 0), "after": _of_kind(first, 1)}


def versions() -> dict[str, str]:
    """Versions of what computed the result."""
    found = {"python": platform.python_version()}
    for name in DISTRIBUTIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    return found


def _of_kind(found: Sequence[KindErrors], which: int) -> Json:
    content: Json = {}
    for errors in found:
        part = metrics_dict(errors.metrics[which], errors.unit)
        content |= {key: value for key, value in part.items() if key not in content}
    # Orientations are told by one figure beside the positions.
    return {k: v for k, v in content.items() if not k.endswith("_deg") or k == "rms_deg"}


def _parameter(solution: Solution, name: str) -> Json:
    estimate = solution.estimates[name]
    content: Json = {"unit": estimate.unit, "nominal": estimate.nominal}
    content |= _outcome(estimate, solution.converged)
    return content | {"scale": 1.0} | _knowledge(solution.problem.parameters[name])


def _outcome(estimate: Estimate, converged: bool) -> Json:
    if not converged:
        return {"value": None, "std": None, "state": "not_converged"}
    content: Json = {"value": estimate.value, "std": estimate.std, "state": estimate.state}
    return content | ({"given": list(estimate.given)} if estimate.given else {})


def _knowledge(parameter: Parameter) -> Json:
    content: Json = {}
    if parameter.prior is not None:
        content["prior"] = parameter.prior
    if math.isfinite(parameter.lower) or math.isfinite(parameter.upper):
        content["bounds"] = [parameter.lower, parameter.upper]
    return content


def _excluded(result: Result) -> list[Json]:
    """Samples that rows of the job leave out by name."""
    spec = result.job.spec
    sets = {"observations": spec.observations, "validation": spec.validation}
    return [
        {"in": f"{name}[{k}]", "kind": row.kind, **row.exclude.as_dict()}
        for name, rows in sets.items()
        for k, row in enumerate(rows)
        if row.exclude is not None
    ]


def _combinations(solution: Solution) -> list[dict[str, float]]:
    found = solution.identification.combinations
    return [dict(c.direction) for c in found if not c.alone]


def _metrics(result: Result) -> Json:
    content = {}
    for name, rows in labelled_terms(result).items():
        part = accuracy_dict([term for _, term in rows])
        part["by_term"] = [
            {"kind": term.term.kind, "label": label} | accuracy_dict([term]) for label, term in rows
        ]
        content[name] = part
    if not result.solution.converged:
        for part in content.values():
            for entry in (part, *part["by_term"]):
                entry["after"] = {k: v if k == "count" else None for k, v in entry["after"].items()}
    return content


def _timing(solution: Solution) -> dict[str, float]:
    timing = dict(solution.timing)
    # What comes before the first iteration is the check of what the data can tell.
    return {"build": timing.get("build", timing.get("check", 0.0)), **timing}


def _correlations(solution: Solution) -> Json:
    if not solution.converged:
        return {"parameters": [], "matrix": []}
    names, matrix = arm_correlations(solution)
    return {"parameters": list(names), "matrix": np.round(matrix, 4).tolist()}


def _covariance(solution: Solution) -> Json:
    """Of the arm's estimated parameters, with the standard deviations told of each."""
    if not solution.converged:
        return {"parameters": [], "unit": "m, rad", "matrix": []}
    names, matrix = arm_correlations(solution)
    std = np.array([solution.estimates[name].std for name in names], dtype=float)
    covariance = matrix * np.outer(std, std)
    return {"parameters": list(names), "unit": "m, rad", "matrix": covariance.tolist()}


def arm_correlations(solution: Solution) -> tuple[tuple[str, ...], Any]:
    """Names (n) and correlation matrix (n, n) of the arm's estimated parameters."""
    names, matrix = solution.correlation()
    arm = set(solution.problem.names[: solution.problem.arm_count])
    rows = [k for k, name in enumerate(names) if name in arm]
    return tuple(names[k] for k in rows), matrix[np.ix_(rows, rows)]


def _noise(result: Result) -> list[Json]:
    solution = result.solution
    rows = labelled_terms(result)["calibration"]
    blocks = [(label, term.term.kind, b) for label, term in rows for b in term.term.blocks]
    return [
        {
            "kind": kind,
            "label": label,
            "block": block.name,
            "unit": block.unit,
            "assumed": assumed,
            "given": block.noise.sigma is not None,
            "found": found if solution.converged else None,
        }
        for (label, kind, block), assumed, found in zip(
            blocks, solution.sigmas, solution.noise, strict=True
        )
    ]


def _solver(solution: Solution) -> Json:
    best = solution.minimum
    return {
        "name": "IPOPT",
        "status": best.status,
        "iterations": best.iterations,
        "cost": best.cost,
        "starts": [
            {"status": a.status, "iterations": a.iterations, "cost": a.cost}
            for a in solution.attempts
        ],
    }


def _finite(value: Any) -> Any:
    """JSON has no NaN and no infinity: null says that there is no number."""
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(part) for part in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value
