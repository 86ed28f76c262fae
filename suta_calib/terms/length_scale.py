"""The source of the scale of observations, errors of the scale, and the stretch of a body.

Paper is fed, and plastic shrinks, by another factor along each axis. With s = (s_x, s_y) a point
l of an artefact or a board is at ``diag(1 + s_x, 1 + s_y, 1) l``. Each has a prior of the body's
grade. What both have in common is a scale, which free lengths of the arm take up: then only the
difference of the two is determined, and the ± of each says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.geometry.symbols import Symbol
from suta_calib.measurements.scale import LengthScale
from suta_calib.model.parameters import Parameter
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import Term

_STRETCH: Final = "stretch"
_AXES: Final = ("x", "y")


def stretch_parameters(body: str, prior: float | None) -> tuple[Parameter, ...]:
    """The unknowns ``stretch[body].x|y``; none where a body is taken for what its file says.

    The prior is the standard deviation of each, as a ratio.
    """
    if prior is None:
        return ()
    most = 10.0 * prior
    return tuple(
        Parameter(f"{_STRETCH}[{body}]", key, "1", 0.0, -most, most, prior, prior_fixed=True)
        for key in _AXES
    )


def is_stretch(parameter: Parameter) -> bool:
    """Whether it is one of `stretch_parameters`."""
    return parameter.owner.startswith(f"{_STRETCH}[")


def stretched_point(point: Symbol, stretch: Symbol) -> Symbol:
    """A point (3,) of a body with the stretch (2,)."""
    return ca.vertcat((1 + stretch[0]) * point[0], (1 + stretch[1]) * point[1], point[2])


def stretch_factors(parameters: Iterable[Parameter], values: Mapping[str, float]) -> FloatArray:
    """(3,) factors on a body's coordinates, by a term's own unknowns; 1 where none is a stretch."""
    by_key = {p.key: values.get(p.name, 0.0) for p in parameters if is_stretch(p)}
    return np.array([1.0 + by_key.get(key, 0.0) for key in _AXES] + [1.0])


@dataclass(frozen=True)
class ScaleCarrier:
    """The body or instrument that carries the scale of observations.

    Attributes:
        what: ``artefact``, ``board`` or ``instrument``.
        name: tells several of one sort apart; terms with the same one share the error.
        scale: how well the factor on all of its lengths is known.
        estimated: whether its stretch is an unknown, whose prior holds that already.
    """

    what: str
    name: str
    scale: LengthScale
    estimated: bool = False

    @property
    def std(self) -> float:
        """Standard deviation of the factor beside what unknowns hold of it."""
        return 0.0 if self.estimated else self.scale.std


def scale_carrier(term: Term) -> ScaleCarrier | None:
    """The source of a term's scale; None if it measures no lengths, as for points of unknown place.

    Measured poses that nobody states a scale of count as exact: commands on poses state theirs.
    """
    samples = term.poses.samples
    if term.touched is not None:
        body = term.touched
        return ScaleCarrier("artefact", body.name, body.length_scale, body.stretch is not None)
    if (board := term.board_seen) is not None:
        free = board.stretch is not None
        return ScaleCarrier("board", getattr(term, "target", ""), board.length_scale, free)
    measures = samples.position is not None or samples.pixels is not None or samples.numbers
    if not term.measures_lengths() or not measures:
        return None
    if term.scale is None and not isinstance(term.poses, ArmPoses):
        return None
    name, scale = getattr(term, "label", term.kind), term.scale or term.assumed_scale
    return ScaleCarrier("instrument", name, scale)


def scale_carriers(terms: Iterable[Term]) -> tuple[ScaleCarrier, ...]:
    """The carriers of some terms, each once; of two that say otherwise, the less certain."""
    carriers: dict[tuple[str, str], ScaleCarrier] = {}
    for carrier in filter(None, map(scale_carrier, terms)):
        key = carrier.what, carrier.name
        if key not in carriers or carrier.scale.std > carriers[key].scale.std:
            carriers[key] = carrier
    return tuple(carriers.values())


def lengthened(term: Term, factors: ArrayLike) -> Term:
    """The term with every certified or measured length multiplied.

    By one factor, or by (3,) of measured positions along their axes. Lengths that have no axes take
    the largest.
    """
    samples, most = term.poses.samples, float(np.max(factors))
    if term.touched is not None:
        marks = {
            name: replace(mark, position=mark.position * most)
            for name, mark in term.touched.landmarks.items()
        }
        longer: dict[str, Any] = {"artefact": replace(term.touched, landmarks=marks)}
        return replace(term, **longer)
    if term.board_seen is not None:
        longer = {"board": term.board_seen.scaled(most)}
        return replace(term, **longer)
    if not term.measures_lengths():
        return term
    position = None if samples.position is None else samples.position * np.asarray(factors)
    pixels = None if samples.pixels is None else samples.pixels * most
    lengths = {column.name for column in term.columns.numbers if column.unit == "m"}
    numbers = {n: most * v if n in lengths else v for n, v in samples.numbers.items()}
    samples = replace(samples, position=position, pixels=pixels, numbers=numbers)
    return term.over_poses(term.poses.with_samples(samples))
