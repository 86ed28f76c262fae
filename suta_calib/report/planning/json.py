"""Where to measure next, as JSON data: millimetres and degrees by name."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from suta_calib.analysis.planning import Candidate, Choice, Place, Placement, Plan, Point
from suta_calib.analysis.planning.forecast import Forecast
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.units import shown, unit_name

MM: Final = 1e3
Json = dict[str, Any]
# Uncertainty of the registered tip from what is held, as a part of what is told, that is nothing.
_NOTHING: Final = 0.05
# A plan that lessens the tip's uncertainty by less than this part is for nothing.
_USELESS: Final = 0.01


def plan_dict(found: Plan) -> Json:
    """Everything the planner found."""
    return {
        "criterion": found.options.criterion,
        "chosen": [_choice(choice) for choice in found.chosen],
        "predicted": {"before": _forecast(found.before), "after": _forecast(found.after)},
        "best_possible": _best(found),
        "random": {
            "sets": len(found.random),
            "median_tip_mm": MM * float(np.median(found.random)),
            "best_tip_mm": MM * float(found.random.min()),
        },
        "stop": _stop(found),
        "makes_identified": {r.parameter: list(r.candidates) for r in found.remedies if r.by_all},
        "no_candidate_can": {r.parameter: r.why for r in found.remedies if not r.by_all},
        "region": {
            "lower_mm": (MM * found.region.lower).tolist(),
            "upper_mm": (MM * found.region.upper).tolist(),
            "tool_axis": found.region.axis.tolist(),
            "cone_deg": float(np.degrees(found.region.cone)),
        },
        "candidates": {"count": len(found.candidates), "sorts": _sorts(found.candidates)},
        "unreachable": [
            {"name": u.name, "kind": u.kind, "reason": u.reason} for u in found.unreachable
        ],
        "collisions": found.collisions,
        "noise": _noise(found),
        "repeats": found.options.repeats,
        "verdict": plan_verdict(found).as_dict(),
    }


def plan_verdict(found: Plan) -> Assessment:
    """What the plan brings, and what must be known to believe it."""
    names = ", ".join(choice.candidate.name for choice in found.chosen)
    sentence = (
        f"Measuring {names} takes the tip from {MM * found.before.tip:.3f} to "
        f"{MM * found.after.tip:.3f} mm (3-D RMS in the region, after registration)"
    )
    bad = [_on_trouble(found)] if found.situation.trouble else []
    return Assessment.of(sentence, bad=bad, care=[*_on_start(found), *_on_rest(found)])


def _on_trouble(found: Plan) -> str:
    return (
        f"The calibration itself is {found.situation.trouble}. Mend that first: this plan rests on "
        "the nominal arm, and on what the job says of artefact and readings."
    )


def _on_start(found: Plan) -> list[str]:
    if found.situation.solved or found.situation.trouble:
        return []
    return [
        "The present data are too few to be fitted: predicted at the nominal arm with assumed "
        "noise (0.5 mm where the job does not say)."
    ]


def _on_rest(found: Plan) -> list[str]:
    notes = []
    if left := [
        r.parameter for r in found.remedies if r.by_all and r.parameter in found.after.fixed
    ]:
        notes.append(f"Still open after this plan: {', '.join(left)}; choose more.")
    if found.after.tip > (1 - _USELESS) * found.before.tip:
        notes.append(
            "Nothing here makes the tip much surer; for the parameters, choose by --criterion d."
        )
    if found.after.tip > (1 + _NOTHING) * found.after.tip_estimated:
        notes.append(
            f"Most of what is left is held, not measured: with held parameters exact the tip "
            f"would be sure to {MM * found.after.tip_estimated:.3f} mm."
        )
    stop = found.stop
    if stop.target is not None and stop.needed is None:
        notes.append(
            f"The target of {MM * stop.target:.3g} mm is not reached with "
            f"{len(stop.tips) - 1} more: {MM * stop.tips[-1]:.3f} mm."
        )
    return notes


def place_dict(place: Place) -> Json:
    """A place as the candidates file has it."""
    if isinstance(place, Placement):
        rpy = np.degrees(rpy_from_rotation(place.rotation))
        return {"position_mm": rounded(MM * place.position), "rotation_rpy_deg": rounded(rpy)}
    if isinstance(place, Point):
        return {
            "position_mm": rounded(MM * place.position),
            "directions": place.directions,
            "axis": rounded(place.axis, 6),
            "cone_deg": rounded(np.array([np.degrees(place.cone)]))[0],
        }
    return {"readings": rounded(place.readings, 9)}


def rounded(values: FloatArray, decimals: int = 3) -> list[float]:
    """Rounded, without negative zeros."""
    return [float(value) + 0.0 for value in np.round(values, decimals)]


def _choice(choice: Choice) -> Json:
    candidate = choice.candidate
    return {
        "name": candidate.name,
        "kind": candidate.place.kind,
        "what": candidate.sort,
        "pose": place_dict(candidate.place),
        "samples": candidate.samples,
        "tip_mm": MM * choice.tip,
        "gain_pct": 100.0 * choice.gain,
        "gain_bits": choice.bits,
        "identifies": list(choice.identifies),
    }


def _forecast(forecast: Forecast) -> Json:
    parameters = {}
    for each in forecast.parameters:
        unit = unit_name(each.unit)
        std = None if each.std is None else shown(each.std, each.unit)
        parameters[each.name] = {
            f"std_{unit}": std,
            f"plausible_{unit}": shown(each.plausible, each.unit),
            "state": "unidentified" if std is None else "identified",
        }
    return {
        "tip_mm": MM * forecast.tip,
        "tip_held_exact_mm": MM * forecast.tip_estimated,
        "unidentified": list(forecast.fixed),
        "parameters": parameters,
    }


def _best(found: Plan) -> Json:
    best = found.best
    return {
        "count": best.count,
        "names": list(best.names),
        "tip_mm": MM * best.tip,
        "present_tip_mm": MM * best.present,
        "efficiency_pct": 100.0 * best.efficiency,
        "d_efficiency_pct": 100.0 * best.d_efficiency,
    }


def _stop(found: Plan) -> Json:
    stop = found.stop
    return {
        "tip_mm": [MM * tip for tip in stop.tips],
        "least_gain_pct": 100.0 * stop.least_gain,
        "worthwhile": stop.worthwhile,
        "target_mm": None if stop.target is None else MM * stop.target,
        "needed": stop.needed,
    }


def _noise(found: Plan) -> list[Json]:
    """What every touch is taken to scatter by: as the residuals show, or as assumed."""
    situation = found.situation
    return [
        {
            "block": block.name,
            f"sigma_{unit_name(block.unit)}": shown(sigma, block.unit),
            "from": "residuals" if situation.solved else "assumed",
        }
        for block, sigma in zip(situation.problem.blocks, situation.sigmas, strict=True)
    ]


def _sorts(candidates: tuple[Candidate, ...]) -> dict[str, int]:
    names = [candidate.sort for candidate in candidates]
    return {name: names.count(name) for name in dict.fromkeys(names)}
