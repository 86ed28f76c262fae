"""Report of a plan: what to measure next, and the files for the measurement."""

from __future__ import annotations

from functools import partial
from itertools import groupby
from typing import Any, Final

import numpy as np

from suta_calib.analysis.planning import (
    Best,
    Choice,
    Expected,
    Forecast,
    Place,
    Placement,
    Plan,
    Posture,
    Region,
    Stop,
    TouchPoint,
)
from suta_calib.analysis.planning.candidates import Unreachable
from suta_calib.analysis.planning.plots import draw_bench, draw_gain
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.measurements.yaml_text import yaml_text
from suta_calib.plotting.look import WIDTH
from suta_calib.report.document import Document, Figure, File, Part, Text
from suta_calib.report.listing import Column, Json, Listing, csv_text, plain, shown_as, written
from suta_calib.report.svg import picture, svg_text
from suta_calib.units import NOTHING, Unit, deg, key, mm, shown, text, unit_name
from suta_calib.words import listed

NAME: Final = "plan"
TITLE: Final = "Where to measure next"
# Candidates that a sentence names.
MOST_NAMES: Final = 5
_POSE: Final = ("x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg", "tilt_deg")
_WHAT: Final = (
    "Predicted from the Jacobian at the estimated arm, with the solver's own covariance (rows that "
    "share a sample are not independent) and the noise of the present residuals, whatever causes "
    "them. 'tip' is the 3-D root mean square uncertainty of the tip in the region after a rigid "
    "registration; parameters that stay undetermined count with the errors that their bounds allow."
)


def place_dict(place: Place) -> Json:
    """A place as the candidates file has it."""
    if isinstance(place, Posture):
        return {"readings": rounded(place.readings, 9)}
    position = {"position_mm": rounded(mm(place.position))}
    if isinstance(place, Placement):
        return position | {"rotation_rpy_deg": rounded(deg(rpy_from_rotation(place.rotation)))}
    return position | {
        "directions": place.directions,
        "axis": rounded(place.axis, 6),
        "cone_deg": round(float(deg(place.cone)), 3),
    }


def rounded(values: FloatArray, decimals: int = 3) -> list[float]:
    """Rounded, without negative zeros."""
    return [float(value) + 0.0 for value in np.round(values, decimals)]


def _pose_text(choice: Choice, entry: str) -> str:
    """Position or rotation of a place; of a point the directions it is touched from."""
    place = choice.candidate.place
    if isinstance(place, TouchPoint) and entry == "rotation_rpy_deg":
        return f"{place.directions} directions"
    numbers = place_dict(place).get(entry)
    return "{:.0f} {:.0f} {:.0f}".format(*numbers) if numbers else NOTHING


CHOSEN: Final = Listing[Choice](
    "What to measure next, best first",
    Column("name", "", lambda choice: choice.candidate.name),
    Column("what", "what", lambda choice: choice.candidate.sort),
    Column("kind", None, lambda choice: choice.candidate.place.kind),
    Column("pose", None, lambda choice: place_dict(choice.candidate.place)),
    shown_as("position, mm", lambda choice: _pose_text(choice, "position_mm")),
    shown_as("roll pitch yaw, deg", lambda choice: _pose_text(choice, "rotation_rpy_deg")),
    Column("samples", None, lambda choice: choice.candidate.samples),
    Column("tip", "tip, mm", unit="m"),
    Column("gain", "gain", unit="%", cell=lambda choice: f"{shown(choice.gain, '%'):.0f} %"),
    Column("gain_bits", None, lambda choice: choice.bits),
    Column("identifies"),
    key="chosen",
)
# Before and after; a dash where a parameter would be held.
PARAMETERS: Final = Listing[tuple[Expected, Expected]](
    "Predicted standard deviations",
    Column("", "parameter", lambda pair: pair[0].name),
    Column("", "now ±", lambda pair: pair[0].std, lambda pair: pair[0].unit),
    Column("", "then ±", lambda pair: pair[1].std, lambda pair: pair[1].unit),
    Column("", "unit", lambda pair: unit_name(pair[0].unit)),
)
BEST: Final = Listing[Best](
    "",
    *written("count", "names"),
    Column("tip", unit="m"),
    Column("present_tip", None, lambda best: best.present, "m"),
    *written("efficiency", "d_efficiency", unit="%"),
)
STOP: Final = Listing[Stop](
    "",
    Column("tip", None, lambda stop: stop.tips, "m"),
    Column("least_gain", unit="%"),
    Column("worthwhile"),
    Column("target", unit="m"),
    Column("needed"),
)
UNREACHABLE: Final = Listing[Unreachable]("", *written("name", "kind", "reason"))


def plan_document(plan: Plan) -> Document:
    """The plan, where it is on the bench, what each more would bring, and the parameters."""
    pairs = zip(_expected(plan.before), _expected(plan.after), strict=True)
    parts: list[Part] = [
        File("plan.csv", lambda: csv_text(_bench_rows(plan), plan.chosen)),
        File("plan.yaml", lambda: _bench_yaml(plan)),
        CHOSEN.of(plan.chosen),
        Figure(partial(bench_drawing, plan), "On the bench"),
        *(Text(sentence, bullet=True) for sentence in _remedy_sentences(plan)),
        Figure(partial(gain_curve, plan), "Uncertainty of the tip with each further candidate"),
        *(Text(sentence, bullet=True) for sentence in _sentences(plan)),
        PARAMETERS.of(pairs),
        Text(_WHAT, place="page"),
    ]
    return Document(NAME, TITLE, plan.assessment, parts, _data(plan))


def _data(plan: Plan) -> Json:
    sorts, situation = [candidate.sort for candidate in plan.candidates], plan.situation
    # What every touch is taken to scatter by.
    noise = [
        {
            "block": block.name,
            key("sigma", block.unit): shown(sigma, block.unit),
            "from": "residuals" if situation.solved else "assumed",
        }
        for block, sigma in zip(situation.problem.blocks, situation.sigmas, strict=True)
    ]
    return {
        "criterion": plan.options.criterion,
        "predicted": {"before": _forecast_dict(plan.before), "after": _forecast_dict(plan.after)},
        "best_possible": BEST.record(plan.best),
        "random": {
            "sets": len(plan.random),
            "median_tip_mm": mm(float(np.median(plan.random))),
            "best_tip_mm": mm(float(plan.random.min())),
        },
        "stop": STOP.record(plan.stop),
        "makes_identified": {r.parameter: list(r.candidates) for r in plan.remedies if r.by_all},
        "no_candidate_can": {r.parameter: r.why for r in plan.remedies if not r.by_all},
        "region": region_record(plan.region),
        "candidates": {
            "count": len(sorts),
            "sorts": {name: sorts.count(name) for name in dict.fromkeys(sorts)},
        },
        "unreachable": UNREACHABLE.records(plan.unreachable),
        "collisions": plan.collisions,
        "noise": noise,
        "repeats": plan.options.repeats,
    }


def region_record(region: Region) -> Json:
    """A region of the tip as JSON has it."""
    return {
        "lower_mm": plain(region.lower, "m"),
        "upper_mm": plain(region.upper, "m"),
        "tool_axis": plain(region.axis),
        "cone_deg": deg(region.cone),
    }


def region_text(region: Region) -> str:
    """The same within a sentence."""
    ends = zip("xyz", mm(region.lower), mm(region.upper), strict=True)
    box = ", ".join(f"{axis} {low:.0f} … {high:.0f}" for axis, low, high in ends)
    return f"{box} mm, tool within {deg(region.cone):.0f}° of its usual direction"


def _expected(forecast: Forecast) -> list[Expected]:
    """The parameters and the tip, as rows."""
    tips = (
        ("tip in the region", forecast.tip),
        ("… if fixed parameters are exact", forecast.tip_estimated),
    )
    return [*forecast.parameters, *(Expected(name, "m", np.nan, tip) for name, tip in tips)]


def _forecast_dict(forecast: Forecast) -> Json:
    return {
        "tip_mm": mm(forecast.tip),
        "tip_held_exact_mm": mm(forecast.tip_estimated),
        "unidentified": list(forecast.fixed),
        "parameters": {
            parameter.name: {
                key("std", parameter.unit): plain(parameter.std, parameter.unit),
                key("plausible", parameter.unit): shown(parameter.plausible, parameter.unit),
                "state": "unidentified" if parameter.std is None else "identified",
            }
            for parameter in forecast.parameters
        },
    }


def _bench_rows(plan: Plan) -> Listing[Choice]:
    """Columns of ``plan.csv``: those of a pose, and those of joints where a posture is planned."""
    postures = any(isinstance(choice.candidate.place, Posture) for choice in plan.chosen)
    joints = _joints(plan) if postures else {}

    def number(k: int, choice: Choice) -> float | None:
        """Of a pose, and then of a posture."""
        place = choice.candidate.place
        if isinstance(place, Posture):
            k, units = k - len(_POSE), list(joints.values())
            return rounded(shown(place.readings[k : k + 1], units[k]), 4)[0] if k >= 0 else None
        entries = place_dict(place)
        where = [*entries["position_mm"], *entries.get("rotation_rpy_deg", ())]
        where += [round(deg(place.tilt), 3)] if isinstance(place, Placement) else []
        return where[k] if k < len(where) else None

    names = [*_POSE, *(key(name, unit) for name, unit in joints.items())]
    columns = [Column(name, None, partial(number, k)) for k, name in enumerate(names)]
    return Listing(
        "",
        Column("name", None, lambda choice: choice.candidate.name),
        Column("kind", None, lambda choice: choice.candidate.place.kind),
        *columns[: len(_POSE)],
        Column("samples", None, lambda choice: choice.candidate.samples),
        Column("tip_mm", None, lambda choice: round(mm(choice.tip), 4)),
        *columns[len(_POSE) :],
    )


def _bench_yaml(plan: Plan) -> str:
    """The same as a candidates file: it can be trimmed, changed and planned with again."""
    content: dict[str, Any] = {"repeats": plan.options.repeats}
    joints = _joints(plan).items()
    for choice in plan.chosen:
        place = choice.candidate.place
        if isinstance(place, Posture):
            posture: Json = content.setdefault("poses", {}).setdefault(place.name, {})
            for (joint, unit), reading in zip(joints, place.readings.tolist(), strict=True):
                value = round(shown(reading, unit), 6) + 0.0
                posture.setdefault(key("posture", unit), {})[joint] = value
        else:
            sort = "placements" if isinstance(place, Placement) else "points"
            content.setdefault(sort, {})[place.name] = place_dict(place)
    heading = "Where to measure next; suta-calib plan reads this file with --candidates."
    return yaml_text(content, heading)


def _joints(plan: Plan) -> dict[str, Unit]:
    """Joints with the units of their readings."""
    moving = plan.situation.arm.readings
    return {joint.name: "m" if joint.type == "prismatic" else "rad" for joint in moving}


def _remedy_sentences(plan: Plan) -> list[str]:
    """For every open parameter: what determines it, or that nothing here does."""
    sentences = []
    for remedy in plan.remedies:
        named = listed(remedy.candidates, MOST_NAMES)
        why = f" ({remedy.why})" if remedy.why else ""
        if remedy.by_all and remedy.candidates:
            sentences.append(
                f"{remedy.parameter} is not determined{why}. It would be determined by a "
                f"{' or '.join(remedy.sorts)} ({named}), and by no other sort of candidate."
            )
        elif remedy.by_all:
            together = "only several candidates together determine it."
            sentences.append(f"{remedy.parameter} is not determined{why}; {together}")
    never = [r for r in plan.remedies if not r.by_all]
    for advice, group in groupby(sorted(never, key=lambda r: r.advice), key=lambda r: r.advice):
        names = ", ".join(r.parameter for r in group)
        sentences.append(
            f"No candidate can determine {names} ({advice or 'add another kind of observation'})."
        )
    return sentences


def _share(part: float) -> str:
    """In per cent. Other chains, or more samples than candidates, may tell more than these."""
    if not 0.01 <= part <= 1.0:
        return "less than 1 %" if part < 0.01 else "more than 100 %"
    return f"{shown(part, '%'):.0f} %"


def _efficiency(plan: Plan) -> str:
    best = plan.best
    shares = [_share(part) for part in (best.efficiency, best.d_efficiency)]
    if best.tip >= best.present:
        return (
            "The present data determine the tip better than the same number of samples at the best "
            f"of these candidates ({text(best.present, 'm')} mm, not {text(best.tip, 'm')} mm)."
        )
    return (
        f"The same number of samples at the best {best.count} candidates "
        f"({listed(best.names, MOST_NAMES)}) would give {text(best.tip, 'm')} mm instead of "
        f"{text(best.present, 'm')} mm: the present data are {shares[0]} efficient for the tip, "
        f"{shares[1]} for all parameters together."
    )


def _sentences(plan: Plan) -> tuple[str, ...]:
    median, least = (text(float(f(plan.random)), "m") for f in (np.median, np.min))
    return (
        _efficiency(plan),
        f"{len(plan.random)} random choices of {len(plan.chosen)} reach {median} mm (median) "
        f"and {least} mm at best.",
        _stop(plan),
        f"{len(plan.candidates)} candidates within reach, {len(plan.unreachable)} not; region "
        f"{region_text(plan.region)}; {plan.collisions}.",
    )


def _stop(plan: Plan) -> str:
    stop, ahead = plan.stop, len(plan.stop.tips) - 1
    percent = f"{shown(stop.least_gain, '%'):.0f} %"
    if stop.worthwhile is None:
        sentence = f"Each of {ahead} further candidates reduces the tip's uncertainty by {percent}."
    elif stop.worthwhile == 0:
        sentence = f"Even the first reduces the tip's uncertainty by less than {percent}: stop now."
    else:
        sentence = (
            f"After {stop.worthwhile} more, the next one reduces the tip's uncertainty by less "
            f"than {percent}: stop there."
        )
    if stop.target is None:
        return sentence
    target = f"{mm(stop.target):.3g} mm"
    if stop.needed is None:
        return f"{sentence} {target} is not reached with {ahead}."
    return f"{sentence} {target} is reached with {stop.needed}."


def bench_drawing(plan: Plan, name: str = "plan_bench") -> str:
    """An SVG element: the arm, what was measured, and what to measure next; mm in the base."""
    with picture(name, (1.25 * WIDTH, 5.0)) as figure:
        draw_bench(figure, plan)
        return svg_text(figure, name, "Placements and points to measure next, around the arm")


def gain_curve(plan: Plan, name: str = "plan_gain") -> str:
    """An SVG element: predicted uncertainty of the tip by the number of further candidates."""
    with picture(name, (WIDTH, 3.2)) as figure:
        draw_gain(figure.subplots(), plan)
        return svg_text(figure, name, "Predicted uncertainty of the tip by further candidates")
