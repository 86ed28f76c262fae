"""The unknowns: what each is called, where it starts, how far it may go, what is known of it.

A parameter belongs to an *owner* (a joint, the tip, an observation's frame or point) and has a
*key* there; its name is both: ``joint_4.z``, ``placement[P1].rx``. Nobody takes names apart again.
"""

from __future__ import annotations

import math
from collections.abc import ItemsView, Iterable, Iterator, Mapping, Sequence, ValuesView
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from functools import cached_property
from numbers import Real
from typing import Any, Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError
from suta_calib.units import Unit, from_deg
from suta_calib.words import listed

GEOMETRIC: Final = "geometric"
# The two ends of a chain.
End = Literal["base", "tip"]
# Keys of a placement, in the order of its numbers; of a joint that moves; of what is no geometry.
POSITION: Final = ("x", "y", "z")
ROTATION: Final = ("rx", "ry", "rz")
PLACEMENT: Final = (*POSITION, *ROTATION)
OFFSET: Final = "offset"
COMPLIANCE: Final = "compliance"
# About the two axes across the joint's own (`kinematics.Segment.across`).
BENDING: Final = ("compliance_x", "compliance_y")
# Of what a joint carries before the next one.
MASS: Final = "mass"
GAIN: Final = "gain"
BACKLASH: Final = "backlash"
# How far a joint lags behind all in all, and the way after a reversal on which most of that builds.
HYSTERESIS: Final = "hysteresis"
DECAY: Final = "hysteresis_decay"
# Of a reducer whose errors come twice with each turn of its input, and how often that turns.
RIPPLE: Final = ("ripple_c", "ripple_s")
GEAR_RATIO: Final = "gear_ratio"
EXPANSION: Final = "expansion"
# How far another joint's reading moves a joint too: a key for each of the others.
COUPLING: Final = "coupling"
# Where a link with a tilt sensor turns (`model.tilt`).
SHARE: Final = "share"
# The same of the cosine and the sine of a neighbour's reading, as of a cable about its pulley.
CABLE: Final = ("cable_c", "cable_s")
# Owner of what all links of an arm have in common.
LINKS: Final = "links"
# An eccentric encoder disc gives the first harmonic, a tilted or oval one the second.
Family = Literal[
    "ecc_1",
    "ecc_2",
    "compliance",
    "bending",
    "gain",
    "backlash",
    "hysteresis",
    "ripple",
    "expansion",
    "coupling",
    "cable",
]
FAMILIES: Final[dict[Family, tuple[str, ...]]] = {
    "ecc_1": ("ecc_c1", "ecc_s1"),
    "ecc_2": ("ecc_c2", "ecc_s2"),
    "compliance": (COMPLIANCE,),
    "bending": BENDING,
    "gain": (GAIN,),
    "backlash": (BACKLASH,),
    "hysteresis": (HYSTERESIS,),
    "ripple": RIPPLE,
    "expansion": (EXPANSION,),
}
ECCENTRICITY: Final = (*FAMILIES["ecc_1"], *FAMILIES["ecc_2"])
# How these keys begin: globs reach them only where they say so.
_NONGEOMETRIC: Final = (
    *("ecc", COMPLIANCE, MASS, GAIN, BACKLASH, HYSTERESIS, "ripple", GEAR_RATIO, EXPANSION),
    *(COUPLING, "cable"),
    # Of tilt sensors.
    *(SHARE, "turn", "mount", "up_"),
)
# What is no zero where nothing is wrong: what a joint carries, and sizes of what it may do.
_SIZES: Final = (MASS, DECAY, GEAR_RATIO)
# Lengths and angles of the size that moves the tip of a metre-long arm by a centimetre, and what
# yields as much to the torque of a few kilograms, or grows as much in ten degrees; a tenth of such
# a mass; a pixel; a share of a turn, or what bends a picture, by as much.
SCALE: Final[dict[Unit, float]] = {
    "m": 0.01,
    "rad": 0.01,
    "rad/Nm": 1e-3,
    "kg": 0.1,
    "1/K": 1e-3,
    "px": 1.0,
    "1": 0.01,
    "s": 0.01,
}
# How far the base of a robot in a cell may be from where its URDF has it: anywhere in the room.
PLAUSIBLE_BASE: Final[dict[Unit, float]] = {"m": 0.5, "rad": 1.0}
# How far a geometric parameter without a bound may plausibly be off: only used to judge whether
# the data tell anything about it, never to limit it.
PLAUSIBLE: Final[dict[Unit, float]] = {
    "m": 0.05,
    "rad": from_deg(10.0),
    "rad/Nm": from_deg(0.2),
    "kg": 1.0,
    # Plastics; steel has 12e-6, aluminium 23e-6.
    "1/K": 1e-4,
    "px": 20.0,
    # Clocks that are not set by each other, and what a driver waits for.
    "s": 0.1,
    # A turn that is read 18° too long: no gear, and hardly a potentiometer, is so wrong.
    "1": 0.05,
}
# Bounds and priors below it hold a parameter where it is, and their squares are lost in rounding.
LEAST_SIZE: Final = 1e-12
# A degree of eccentricity, or of play, would be seen with the naked eye.
PLAUSIBLE_ECCENTRICITY: Final = from_deg(1.0)
# What a joint lags behind on cables may be seen; and so may the play of one that slides.
PLAUSIBLE_LAG: Final[dict[Unit, float]] = {"rad": from_deg(5.0), "m": 2e-3}
# Where a decay begins, and what it is not below: as far as that, friction is play.
NOMINAL_DECAY: Final[dict[Unit, float]] = {"rad": from_deg(3.0), "m": 2e-3}
LEAST_DECAY: Final = 0.01
# Of a mass that a URDF states: cables, covers and screws are often left out of it.
PLAUSIBLE_MASS: Final = 0.3


def base_owner(robot: str) -> str:
    """What the placement of a robot's base in a cell is called (`model.cell`)."""
    return f"robot[{robot}]"


def is_base(owner: str) -> bool:
    """Whether parameters are the placement of a robot's base in a cell."""
    return owner.startswith("robot[") and owner.endswith("]")


@dataclass(frozen=True)
class Parameter:
    """One unknown number.

    Attributes:
        owner: what it belongs to, e.g. ``joint_4`` or ``placement[P1]``.
        key: which of the owner's numbers it is, e.g. ``z``, ``rx``, ``offset``, ``ecc_c1``; empty
            for its only one.
        unit: ``m``, ``rad``, ``rad/Nm``, ``kg``, ``1/K``, ``1`` for a gain or a coupling; of a
            camera ``px`` and ``1``; of a clock ``s``.
        nominal: where it starts, and where it stays if nothing can be said of it.
        lower, upper: bounds of the value, infinite where there is none.
        prior: standard deviation of a Gaussian prior about nominal, or None.
        plausible: how far from nominal the value might be before any data are seen; a predicted
            standard deviation is judged against it.
        free: False for a parameter that is named but not estimated.
        prior_fixed: whether the data have no say in how wide the prior is.
        prior_assumed: whether nobody stated the prior: it is as wide as is usual.
    """

    owner: str
    key: str
    unit: Unit
    nominal: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    prior: float | None = None
    plausible: float = math.nan
    free: bool = True
    prior_fixed: bool = False
    prior_assumed: bool = False

    def __post_init__(self) -> None:
        if not self.lower <= self.nominal <= self.upper:
            bounds = f"bounds {self.lower:g} … {self.upper:g}"
            problem = f"{bounds} that exclude the nominal value {self.nominal:g}"
            raise ParameterError(problem, "lower ≤ nominal ≤ upper", where=self.name)
        if math.isnan(self.plausible):
            reach = max(self.upper - self.nominal, self.nominal - self.lower)
            bounded = math.isfinite(reach) and reach > 0
            object.__setattr__(self, "plausible", reach if bounded else PLAUSIBLE[self.unit])

    @cached_property
    def name(self) -> str:
        """As in the file formats: ``owner.key``, or the owner alone."""
        return f"{self.owner}.{self.key}" if self.key else self.owner

    @property
    def geometric(self) -> bool:
        """Whether it is a placement or an offset, which a URDF can hold."""
        return not self.key.startswith(_NONGEOMETRIC)

    @property
    def coupling(self) -> bool:
        """Whether it says how far another joint's reading moves its owner."""
        return self.key.startswith(COUPLING)

    def in_urdf(self, value: float) -> bool:
        """Whether a URDF can hold this value of it, or has it already."""
        if self.key == SHARE:
            return False
        return self.geometric or value == (self.nominal if self.key in _SIZES else 0.0)

    @property
    def scale(self) -> float:
        """Unit of the solver's variable."""
        return SCALE[self.unit]

    def bounded(
        self, bound: float | None, prior: float | None, prior_fixed: bool = False
    ) -> Parameter:
        """The same parameter with ``nominal ± bound`` and a prior standard deviation."""
        half = math.inf if bound is None else bound
        # What cannot be beyond some value, as no mass is below zero, says how far off it may be.
        limited = math.isfinite(self.lower) or math.isfinite(self.upper)
        stays = bound is None and (limited or is_base(self.owner) or self.key == DECAY)
        least = LEAST_DECAY * NOMINAL_DECAY[self.unit] if self.key == DECAY else self.lower
        return replace(
            self,
            lower=max(self.nominal - half, least),
            upper=min(self.nominal + half, self.upper),
            prior=prior,
            plausible=self.plausible if stays else math.nan,
            free=True,
            prior_fixed=prior_fixed,
        )


def coupling_key(joint: str, key: str = COUPLING) -> str:
    """Of what the reading of ``joint`` does to the owner: ``coupling[joint_2]``."""
    return f"{key}[{joint}]"


class ParameterSet(Displayable, Mapping[str, Parameter]):
    """Parameters in a fixed order, looked up by name."""

    def __init__(self, parameters: Iterable[Parameter] = ()) -> None:
        self._by_name = {p.name: p for p in parameters}
        self._arrays: dict[str, FloatArray] = {}

    def __getitem__(self, name: str) -> Parameter:
        if name not in self._by_name:
            hint = _did_you_mean(name, self._by_name)
            raise ParameterError(f"'{name}'", "the name of a parameter", hint=hint)
        return self._by_name[name]

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_name)

    def __len__(self) -> int:
        return len(self._by_name)

    # A mapping's own go by name, one after the other: that takes ten times as long.
    def values(self) -> ValuesView[Parameter]:
        """The parameters, in order."""
        return self._by_name.values()

    def items(self) -> ItemsView[str, Parameter]:
        """Names and parameters, in order."""
        return self._by_name.items()

    @property
    def in_a_line(self) -> str:
        """How many, and the first few names."""
        return f"{len(self)}: {listed(self.names)}" if self._by_name else "none"

    @property
    def names(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(self._by_name)

    def array(self, field: str) -> FloatArray:
        """One attribute of all parameters, in order (n,); None becomes NaN."""
        # A solution asks again and again, and a study of what is always the same.
        if field not in self._arrays:
            self._arrays[field] = np.array([getattr(p, field) for p in self.values()], dtype=float)
        return self._arrays[field].copy()

    def free(self) -> ParameterSet:
        """Those that are to be estimated."""
        return ParameterSet(p for p in self.values() if p.free)


@dataclass(frozen=True)
class Selection(Displayable):
    """One row of a job's ``parameters``: which ones, and how far they may go.

    Attributes:
        select: names, globs, or the word ``geometric``; one alone may be given as it is.
        bound_m, bound_rad, bound_rad_per_nm: half-width of the bounds about nominal, for lengths,
            for angles and for compliances.
        bound_kg, bound_per_k, bound_ratio: the same for masses, kg, for expansions, 1/K, and of
            gains and couplings, 1.
        prior_m, prior_rad, prior_rad_per_nm, prior_kg, prior_per_k, prior_ratio: standard
            deviation of a Gaussian prior about nominal.
        fixed: beside a prior, its size stays whatever the data say of it; alone, name the parameter
            in the result, but do not estimate it.
        line: line of the job file, for messages.
    """

    select: tuple[str, ...] | str
    bound_m: float | None = None
    bound_rad: float | None = None
    prior_m: float | None = None
    prior_rad: float | None = None
    fixed: bool = False
    line: int | None = None
    bound_rad_per_nm: float | None = None
    prior_rad_per_nm: float | None = None
    bound_ratio: float | None = None
    prior_ratio: float | None = None
    bound_per_k: float | None = None
    prior_per_k: float | None = None
    bound_kg: float | None = None
    prior_kg: float | None = None

    def __post_init__(self) -> None:
        given = (self.select,) if isinstance(self.select, str) else self.select
        place: dict[str, Any] = {"line": self.line, "where": "parameters: select"}
        if not isinstance(given, Iterable) or not all(isinstance(entry, str) for entry in given):
            raise ParameterError(repr(given), "names, globs, or 'geometric'", **place)
        object.__setattr__(self, "select", tuple(given))
        for entry in fields(self):
            size = getattr(self, entry.name)
            if not entry.name.startswith(("bound", "prior")) or size is None:
                continue
            if not (isinstance(size, Real) and float(size) >= LEAST_SIZE):
                place["where"] = f"parameters: {entry.name}"
                raise ParameterError(repr(size), f"a number greater than {LEAST_SIZE:g}", **place)

    def sizes(self, unit: Unit) -> tuple[float | None, float | None]:
        """Bound and prior of what is measured in ``unit``."""
        return {
            "m": (self.bound_m, self.prior_m),
            "rad": (self.bound_rad, self.prior_rad),
            "rad/Nm": (self.bound_rad_per_nm, self.prior_rad_per_nm),
            "kg": (self.bound_kg, self.prior_kg),
            "1/K": (self.bound_per_k, self.prior_per_k),
            "1": (self.bound_ratio, self.prior_ratio),
        }[unit]

    def applied_to(self, parameter: Parameter) -> Parameter:
        """The parameter with this row's bounds and prior in place of its own."""
        priors = [entry.name for entry in fields(self) if entry.name.startswith("prior")]
        if self.fixed and all(getattr(self, name) is None for name in priors):
            return replace(parameter, free=False)
        return parameter.bounded(*self.sizes(parameter.unit), self.fixed)


def with_usual_priors(parameters: Iterable[Parameter]) -> ParameterSet:
    """Parameters of which neither bound nor prior was stated get the prior that is usual.

    It is `Parameter.prior_assumed`: the data may contradict it, and widen it. An encoder's zero may
    be set by hand. Machined and assembled links are off by millimetres and tenths of a degree.
    """
    usual = []
    for p in parameters:
        if p.free and p.prior is None and math.isinf(p.upper - p.lower):
            by_hand = (p.key == OFFSET and p.unit == "rad") or not p.geometric
            # Of a joint's placement as built, a standard deviation.
            prior = p.plausible if by_hand else {"m": 2e-3, "rad": from_deg(0.5)}[p.unit]
            p = replace(p, prior=prior, prior_assumed=True)
        usual.append(p)
    return ParameterSet(usual)


def select_parameters(
    available: ParameterSet, geometric: frozenset[str], rows: Sequence[Selection]
) -> ParameterSet:
    """Apply a job's rows to what an arm offers; later rows win. The arm's order stays.

    ``geometric`` are the placement parameters that the word and globs may reach (those of moving
    joints and of the tip); others are selected by their full name only.

    Raises:
        ParameterError: a pattern matches nothing, or a row's bound or prior fits no selected one.
    """
    chosen: dict[str, Parameter] = {}
    for row in rows:
        names = [
            name for pattern in row.select for name in _matches(pattern, available, geometric, row)
        ]
        _check_units(row, {available[name].unit for name in names})
        chosen.update((name, row.applied_to(available[name])) for name in names)
    return ParameterSet(chosen[name] for name in available if name in chosen)


def _matches(
    pattern: str, available: ParameterSet, geometric: frozenset[str], row: Selection
) -> list[str]:
    if pattern in available:
        return [pattern]
    if pattern == GEOMETRIC:
        return [name for name in available if name in geometric]
    joint, _, key = pattern.rpartition(".")
    # A glob, whose key may be one too, means errors that are no geometry only where it says so.
    beside = key.startswith(_NONGEOMETRIC)
    matches = [
        name
        for name, p in available.items()
        if fnmatchcase(name, pattern)
        and (not p.geometric if beside else name in geometric or p.key == OFFSET)
    ]
    if matches:
        return matches
    offset = f"{joint}.{OFFSET}"
    slides = offset in available and available[offset].unit == "m"
    if key == MASS and offset in available:
        problem, hint = f"'{pattern}', but the URDF has no mass that {joint} carries", ""
        expected = "<inertial> with <mass> and <origin> in its child link"
    elif slides and beside and not key.startswith(COUPLING):
        problem, hint = f"'{pattern}', but {joint} is prismatic", ""
        expected = (
            "a revolute joint: only revolute joints have eccentricity and compliance; a prismatic "
            "one has compliance_x and compliance_y"
        )
    else:
        problem = f"'{pattern}', which matches no parameter of the arm"
        hint = _did_you_mean(pattern, [*available, GEOMETRIC])
        expected = (
            "names like joint.offset, joint.x|y|z|rx|ry|rz, joint.gain, "
            "joint.ecc_c1|ecc_s1|ecc_c2|ecc_s2, joint.compliance, joint.compliance_x|compliance_y, "
            "joint.mass, joint.backlash, joint.hysteresis|hysteresis_decay, "
            "joint.ripple_c|ripple_s, joint.expansion, joint.coupling[joint], "
            "joint.cable_c[joint]|cable_s[joint], globs of them, links.expansion, or 'geometric'"
        )
    raise ParameterError(problem, expected, line=row.line, where="parameters: select", hint=hint)


def _check_units(row: Selection, units: set[Unit]) -> None:
    keys: dict[Unit, tuple[str, str]] = {
        "m": ("bound_mm or prior_mm", "lengths"),
        "rad": ("bound_deg or prior_deg", "angles"),
        "rad/Nm": ("bound_deg_per_nm or prior_deg_per_nm", "compliances"),
        "kg": ("bound_kg or prior_kg", "masses"),
        "1/K": ("bound_ppm_per_k or prior_ppm_per_k", "expansions"),
        "1": ("bound or prior", "gains or couplings"),
    }
    fitting = [both for unit, both in keys.items() if unit in units]
    for unit, (key, _) in keys.items():
        if unit not in units and any(v is not None for v in row.sizes(unit)):
            kinds = " or ".join(kind for _, kind in fitting)
            problem = f"{key} for {', '.join(row.select)}, which are all {kinds}"
            expected = ", ".join(key for key, _ in fitting)
            raise ParameterError(problem, expected, line=row.line, where="parameters")


def _did_you_mean(name: str, available: Iterable[str]) -> str:
    names = [candidate for candidate in available if candidate != name]
    close = get_close_matches(name, names, n=3, cutoff=0.5) or names[:6]
    return "did you mean " + ", ".join(close) + "?" if close else ""
