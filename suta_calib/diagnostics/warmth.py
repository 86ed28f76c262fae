"""What whoever computes a tip must know of an arm whose lengths grow with warmth."""

from __future__ import annotations

from collections.abc import Mapping

from suta_calib.model.parameters import EXPANSION, ParameterSet
from suta_calib.units import REFERENCE_TEMPERATURE, mm
from suta_calib.words import listed


def taken_as_cool(parameters: ParameterSet, values: Mapping[str, float]) -> str:
    """That the tip is one at the reference temperature; empty where lengths do not grow.

    Args:
        parameters: of the arm, among them those of no geometry.
        values: what was found, by name.
    """
    # A warm afternoon, or motors that have run for an hour, K.
    warmer = 10.0
    grown = {n: v for n, v in values.items() if n in parameters and v}
    growth = {n: v for n, v in grown.items() if parameters[n].key == EXPANSION}
    if not growth:
        return ""
    most = mm(max(map(abs, growth.values())) * warmer)
    return (
        f"Nothing says here how warm the arm is: it is taken to be at {REFERENCE_TEMPERATURE:g} °C,"
        f" though {listed(tuple(growth))} was found. {warmer:g} K above, a metre of it is off by "
        f"up to {most:.2g} mm."
    )
