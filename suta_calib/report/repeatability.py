"""Report of repeatability and encoders at rest: scatter of tip and joints, directions, noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Final

from suta_calib.analysis.repeatability import (
    DirectionalForce,
    Interval,
    JointNoise,
    JointPush,
    JointRepeats,
    JointScatter,
    OrientationScatter,
    PositionScatter,
    ProtocolComparison,
    Repeatability,
    RepeatabilityTest,
    RepeatedTouches,
    ScatterChange,
    Stationary,
    joints_rms,
)
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Json, Listing, shown_as, written
from suta_calib.report.repeatability_plots import stationary_plot, touches_plot, visits_plot
from suta_calib.units import NOTHING, Unit, shown, text, thousandths, unit_name

NAME: Final = "repeatability"
_HOW: Final = (
    "RP is the mean distance of the visits from their barycentre plus three standard deviations "
    "(ISO 9283:1998, 7.2.2). The intervals are from a jackknife of the logarithm."
)
_PUSH: Final = (
    "A joint has play if its reading changes with the direction of the push while the other joints "
    "do not follow, by more than chance explains (permuted labels, all joints). Means: distance "
    "between the mean readings for different directions; most of it may be the clearance of the "
    "seat. Tip: motion of the tip by this play. A question mark: another joint would explain it "
    "nearly as well."
)
_REST: Final = (
    "Allan deviation: difference between two successive averages over a time. Averaging for longer "
    "than to its minimum gains nothing (+: still falling at the end of the record). Drift: ± half "
    "of its 95 % interval, with correlated noise."
)


# ── visits ───────────────────────────────────────────────────────────────────────────────────
def _interval(interval: Interval, *, sign: bool = False) -> str:
    return f"{text(interval.low, 'm', sign=sign)} to {text(interval.high, 'm', sign=sign)}"


def _positions(confidence: float) -> Listing[tuple[str, PositionScatter]]:
    """Of some visits to the point, by name."""
    scatter = Listing[PositionScatter](
        "",
        Column("count", "visits", form="d"),
        Column("rp", "RP", lambda row: row.rp.value, "m"),
        Column(
            "rp_interval",
            "interval",
            lambda row: row.rp.interval(confidence).ends,
            "m",
            cell=lambda row: _interval(row.rp.interval(confidence)),
        ),
        Column("mean", "mean", unit="m"),
        Column("std", "std", unit="m"),
        Column("rms", "RMS", lambda row: row.rms.value, "m"),
        Column("rms_interval", None, lambda row: row.rms.interval(confidence).ends, "m"),
        Column("max", "max", lambda row: row.maximum, "m"),
        *written("axis_std", "barycentre", unit="m"),
    )
    return Listing(
        "Position repeatability of the tip, mm (ISO 9283: RP = mean + 3 std)",
        Column("", "", lambda row: row[0]),
        *(column.over(lambda row: row[1]) for column in scatter.columns),
        named=True,
    )


ORIENTATION: Final = Listing[OrientationScatter](
    "", *written("rpa", "rpb", "rpc", "rms", unit="rad")
)


def _unit(row: JointScatter | JointPush | JointNoise | JointRepeats) -> Unit:
    return row.unit


def _joints(confidence: float) -> Listing[JointScatter]:
    return Listing(
        "Repeatability of the joints",
        Column("joint", "joint"),
        Column("mean", unit=_unit),
        Column("std", "std", lambda row: row.std.value, _unit),
        Column("repeatability", "3 std", lambda row: 3 * row.std.value, _unit),
        Column("peak_to_peak", "peak to peak", unit=_unit),
        Column("std_interval", None, lambda row: row.std.interval(confidence).ends, _unit),
        Column("tip", "tip, mm", unit="m"),
        named=True,
    )


CHANGE: Final = Listing[ScatterChange](
    "",
    *written("first", "second", unit="m"),
    Column("ratio", value=lambda row: row.factor),
    Column("ratio_interval", value=lambda row: row.ratio.ends),
    Column("difference", value=lambda row: row.second - row.first, unit="m"),
    Column("difference_interval", value=lambda row: row.difference.ends, unit="m"),
    Column("proved"),
)
COMPARED: Final = Listing[ProtocolComparison](
    "",
    *written("first", "second"),
    Column("rp", value=lambda row: CHANGE.record(row.rp)),
    Column("rms", value=lambda row: CHANGE.record(row.rms)),
)
# One figure of two protocols: which protocols, which figure, how it changes.
COMPARISONS: Final = Listing[tuple[str, str, ScatterChange]](
    "Protocols compared",
    Column("", "protocols", lambda row: row[0]),
    Column("", "", lambda row: row[1]),
    shown_as("mm", lambda row: f"{text(row[2].first, 'm')} → {text(row[2].second, 'm')}"),
    Column("", "ratio", lambda row: row[2].factor, form=".2f"),
    shown_as("interval", lambda row: f"{row[2].ratio.low:.2f} to {row[2].ratio.high:.2f}"),
    shown_as("difference, mm", lambda row: _interval(row[2].difference, sign=True)),
)
# One joint under two protocols: which protocols, the joint, its unit, how its scatter changes.
JOINT_COMPARISONS: Final = Listing[tuple[str, str, Unit, ScatterChange]](
    "Scatter of the joints by protocol",
    Column("", "protocols", lambda row: row[0]),
    Column("", "joint", lambda row: row[1]),
    shown_as("std", lambda row: " → ".join(text(v, row[2]) for v in (row[3].first, row[3].second))),
    Column("", "ratio", lambda row: row[3].factor, form=".2f"),
    shown_as("interval", lambda row: f"{row[3].ratio.low:.2f} to {row[3].ratio.high:.2f}"),
    shown_as("", lambda row: "proved" if row[3].proved else ""),
)
JOINT_CHANGE: Final = Listing[tuple[str, Unit, ScatterChange]](
    "",
    Column("joint", value=lambda row: row[0]),
    Column("first", value=lambda row: row[2].first, unit=lambda row: row[1]),
    Column("second", value=lambda row: row[2].second, unit=lambda row: row[1]),
    Column("ratio", value=lambda row: row[2].factor),
    Column("ratio_interval", value=lambda row: row[2].ratio.ends),
    Column("proved", value=lambda row: row[2].proved),
    named=True,
)
PUSHES: Final = Listing[JointPush](
    "Directions of the push",
    Column("joint", "joint"),
    Column("peak_to_peak", "means", unit=_unit),
    shown_as("between", lambda row: "–".join(row.extremes)),
    Column("between", None, lambda row: row.extremes),
    Column("play", "play", lambda row: row.backlash, _unit),
    Column("play_by_chance", "by chance", lambda row: row.by_chance, _unit),
    Column("tip", "tip, mm", unit="m"),
    Column("p_value", "p", form=".2g"),
    Column(
        "gives",
        "",
        lambda row: row.has_backlash,
        cell=lambda row: row.has_backlash * f"gives{'?' * bool(row.as_well)}",
    ),
    Column("as_well"),
    Column("means", unit=_unit),
    named=True,
)
DIRECTIONS: Final = Listing[DirectionalForce](
    "",
    Column("giving", value=lambda row: row.loosest and row.loosest.joint),
    Column("giving_joints", value=lambda row: [j.joint for j in row.joints if j.has_backlash]),
    Column("tip_shift", unit="m"),
    Column("tip_p_value"),
)
REPEATABILITY: Final = Listing[Repeatability](
    "",
    Column("visits", value=lambda row: row.position.count),
    Column("copies"),
    Column("confidence_pct", value=lambda row: 100 * row.confidence),
    Column("rp", value=lambda row: row.position.rp.value, unit="m"),
    Column("rms", value=lambda row: row.position.rms.value, unit="m"),
    Column("orientation", value=lambda row: ORIENTATION.record(row.orientation)),
    Column("elsewhere", value=lambda row: [row.samples.origin[k] for k in row.elsewhere]),
    Column("places", value=lambda row: [len(rows) for rows in row.places]),
    Column("other_posture", value=lambda row: [row.samples.origin[k] for k in row.other_posture]),
    Column("stuck", value=lambda row: [item.joint for item in row.stuck]),
    Column("correlation"),
)


# ── encoders at rest ─────────────────────────────────────────────────────────────────────────
ALLAN: Final = Listing[JointNoise](
    "",
    Column("tau", value=lambda row: row.allan.tau, unit="s"),
    Column("deviation", value=lambda row: row.allan.deviation, unit=_unit),
    Column("low", value=lambda row: row.allan.low, unit=_unit),
    Column("high", value=lambda row: row.allan.high, unit=_unit),
    Column("best_tau", value=lambda row: row.allan.tau[row.allan.best], unit="s"),
    Column("best", value=lambda row: row.allan.deviation[row.allan.best], unit=_unit),
    Column("rises_again", value=lambda row: row.allan.bottomed),
)


def _small(value: float | None, unit: Unit) -> str:
    """Thousandths: encoders are finer than the decimals of a pose."""
    return NOTHING if value is None else f"{thousandths(value, unit):.3g}"


def _with_half(value: float | None, half: float | None, unit: Unit) -> str:
    """Thousandths with the half-width of their interval: no digit that it makes meaningless."""
    if value is None or half is None or not 0 < half < math.inf:
        return " ± ".join(_small(number, unit) for number in (value, half))
    half_shown = thousandths(half, unit)
    places = max(0, 1 - math.floor(math.log10(half_shown)))
    return f"{thousandths(value, unit):.{places}f} ± {half_shown:.{places}f}"


def _fine(key: str, heading: str) -> Column[JointNoise]:
    """A column that shows thousandths."""
    return Column(key, heading, unit=_unit, cell=lambda row: _small(getattr(row, key), row.unit))


def _rate(joint: JointNoise) -> Unit:
    return "rad/s" if joint.unit == "rad" else "m/s"


NOISE: Final = Listing[JointNoise](
    "Joints at rest",
    Column("joint", "joint"),
    Column("mean", unit=_unit),
    _fine("std", "std"),
    _fine("std_detrended", "detrended"),
    *written("std_short", "peak_to_peak", unit=_unit),
    _fine("step", "step"),
    Column(
        "drift",
        "drift per h",
        unit=_rate,
        cell=lambda row: _with_half(row.drift, row.drift_half, _rate(row)),
    ),
    Column("drift_half_interval", value=lambda row: row.drift_half, unit=_rate),
    *written("drifts", "moved", "stuck", "levels", "left_out"),
    Column(
        "allan",
        "best",
        ALLAN.record,
        cell=lambda row: _small(row.allan.deviation[row.allan.best], row.unit),
        numeric=True,
    ),
    shown_as(
        "at, s", lambda e: f"{e.allan.tau[e.allan.best]:.3g}{'' if e.allan.bottomed else '+'}"
    ),
    named=True,
)
STATIONARY: Final = Listing[Stationary](
    "",
    Column("readings", value=lambda row: len(row.stream.time)),
    Column("rate_hz", value=lambda row: 1 / row.stream.period),
    Column("gaps", value=lambda row: row.stream.gaps),
    Column("dropped", value=lambda row: row.stream.dropped),
    Column("input", value=lambda row: str(row.stream.path)),
    Column("seconds"),
    Column("tip_noise", value=lambda row: row.tip_std, unit="m"),
    Column("joints", value=lambda row: NOISE.records(row.joints)),
    Column("verdict", value=lambda row: row.assessment.as_dict()),
)


# ── repeats of many points ───────────────────────────────────────────────────────────────────
def _repeated_joints(confidence: float) -> Listing[JointRepeats]:
    return Listing(
        "Repeatability of the joints",
        Column("joint", "joint"),
        Column("std", "std", lambda row: row.std.value, _unit),
        Column("std_interval", None, lambda row: row.std.interval(confidence).ends, _unit),
        Column("peak_to_peak", "peak to peak", unit=_unit),
        Column("largest", "largest", unit=_unit),
        Column("largest_at", "at"),
        Column("tip", "tip, mm", unit="m"),
        named=True,
    )


REPEATED: Final = Listing[RepeatedTouches](
    "",
    Column("touches"),
    Column("points", value=lambda row: len(row.points)),
    Column("confidence_pct", value=lambda row: 100 * row.confidence),
    Column("rms", value=lambda row: row.rms.value, unit="m"),
    Column("rms_interval", value=lambda row: row.rms.interval(row.confidence).ends, unit="m"),
    Column("rms_of_others", value=lambda row: getattr(row.rms_of_others, "value", None), unit="m"),
    Column("elsewhere"),
)


def _touches_parts(touches: RepeatedTouches) -> list[Part]:
    """A table and a picture of the joints; the sentence of the assessment tells the tip."""
    joints, overall = _repeated_joints(touches.confidence), _overall(touches.joints)
    what = f"among repeats of a touch, {_units(touches.joints)}, peak to peak per point"
    title = f"{joints.title} {what}{overall.replace(',', ';', 1)}"
    return [Figure(partial(touches_plot, touches)), joints.of(touches.joints, title)]


def _touches_data(touches: RepeatedTouches) -> Json:
    return {
        **REPEATED.record(touches),
        "joints": _repeated_joints(touches.confidence).records(touches.joints),
        "joints_rms_deg": _rms_deg(touches.joints),
    }


# ── both ─────────────────────────────────────────────────────────────────────────────────────
def repeatability_document(test: RepeatabilityTest) -> Document:
    """Scatter of the tip and of the joints, directions and protocols; encoders at rest.

    Samples are of visits to one point, or of touches of many. In JSON a stream without samples has
    the key ``stationary`` alone.
    """
    parts, data = list[Part](), Json()
    if test.visits is not None:
        parts += _visits_parts(test.visits)
        data |= _visits_data(test.visits)
    if test.touches is not None:
        parts += _touches_parts(test.touches)
        data |= _touches_data(test.touches)
    if test.rest is not None:
        parts += _rest_parts(test.rest)
        data["stationary"] = STATIONARY.record(test.rest)
    return Document(NAME, "Repeatability", test.assessment, parts, data)


def _visits_parts(repeatability: Repeatability) -> list[Part]:
    named = {"all visits": repeatability.position, **repeatability.protocols}
    if repeatability.directions is not None:
        named |= {f"→ {name}": one for name, one in repeatability.directions.scatter.items()}
    o = repeatability.orientation
    turn = ", ".join(text(value, "rad") for value in (o.rpa, o.rpb, o.rpc))
    unit = _units(repeatability.joints)
    joints = _joints(repeatability.confidence)
    parts: list[Part] = [
        Text(_HOW, place="page"),
        Figure(partial(visits_plot, repeatability)),
        _positions(repeatability.confidence).of(named.items()),
        joints.of(
            repeatability.joints,
            f"{joints.title}, {unit}{_overall(repeatability.joints)}; of the tip's orientation "
            f"±({turn}) deg about x, y, z",
        ),
        COMPARISONS.of(
            (
                (f"{comparison.first} → {comparison.second}", name, change)
                for comparison in repeatability.comparisons
                for name, change in (("RP", comparison.rp), ("RMS", comparison.rms))
            ),
            f"{COMPARISONS.title}, {100 * repeatability.confidence:g} % intervals",
        ),
        JOINT_COMPARISONS.of(
            [
                (f"{comparison.first} → {comparison.second}", joint, joint_unit, change)
                for comparison in repeatability.comparisons
                for joint, joint_unit, change in _by_joint(repeatability, comparison)
            ],
            f"{JOINT_COMPARISONS.title}, {unit}; {_overall_by_protocol(repeatability)}",
        ),
    ]
    if (pushed := repeatability.directions) is not None:
        shift = f"the tip moves by {text(pushed.tip_shift, 'm', with_unit=True)}"
        title = f"{PUSHES.title}, {unit}: {shift} (p = {pushed.tip_p_value:.2g})"
        parts += [PUSHES.of(pushed.joints, title), Text(_PUSH, place="page")]
    return parts


def _units(joints: Sequence[JointScatter] | Sequence[JointRepeats]) -> str:
    return " or ".join(sorted({unit_name(joint.unit) for joint in joints}))


def _overall(joints: Sequence[JointScatter] | Sequence[JointRepeats]) -> str:
    """The root mean square over joints, where there are any that turn."""
    overall = joints_rms(joints)
    return "" if overall is None else f", RMS over joints {text(overall, 'rad')} deg"


def _overall_by_protocol(repeatability: Repeatability) -> str:
    return ", ".join(
        f"{name}{_overall(joints).replace(',', ':', 1)}"
        for name, joints in repeatability.protocol_joints.items()
    )


def _by_joint(
    repeatability: Repeatability, comparison: ProtocolComparison
) -> list[tuple[str, Unit, ScatterChange]]:
    """Each joint of the chain with its unit and how its scatter changes."""
    return [
        (joint.joint, joint.unit, comparison.joints[joint.joint]) for joint in repeatability.joints
    ]


def _rest_parts(rest: Stationary) -> list[Part]:
    unit = " or ".join(sorted({"mdeg" if e.unit == "rad" else "µm" for e in rest.joints}))
    tip = "" if rest.tip_std is None else f"; at the tip {text(rest.tip_std, 'm')} mm"
    return [
        Figure(partial(stationary_plot, rest)),
        NOISE.of(rest.joints, f"{NOISE.title}, {unit}{tip}"),
        Text(_REST, place="page"),
    ]


def _rms_deg(joints: Sequence[JointScatter] | Sequence[JointRepeats]) -> float | None:
    overall = joints_rms(joints)
    return None if overall is None else float(shown(overall, "rad"))


def _visits_data(repeatability: Repeatability) -> Json:
    joints, positions = _joints(repeatability.confidence), _positions(repeatability.confidence)
    directions: Json | None = None
    if (pushed := repeatability.directions) is not None:
        directions = {
            **DIRECTIONS.record(pushed),
            "joints": PUSHES.records(pushed.joints),
            "scatter": positions.records(pushed.scatter.items()),
        }
    return {
        **REPEATABILITY.record(repeatability),
        "position": positions.record(("", repeatability.position)),
        "joints": joints.records(repeatability.joints),
        "protocols": positions.records(repeatability.protocols.items()),
        "joints_rms_deg": _rms_deg(repeatability.joints),
        "protocol_joints": {
            name: joints.records(joint) for name, joint in repeatability.protocol_joints.items()
        },
        "protocol_joints_rms_deg": {
            name: _rms_deg(joint) for name, joint in repeatability.protocol_joints.items()
        },
        "comparisons": [
            {
                **COMPARED.record(comparison),
                "joints": JOINT_CHANGE.records(_by_joint(repeatability, comparison)),
            }
            for comparison in repeatability.comparisons
        ],
        "directions": directions,
    }
