"""The same arm with one of its lengths read in another unit, as somebody may have written it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import POSITION
from suta_calib.units import mm


@dataclass(frozen=True)
class OtherLength:
    """One origin of an arm, some of it in another unit: values by name, m, of a joint or the tip.

    The sentence says what would have to be so, as the end of "the data agree if …".
    """

    owner: str
    values: dict[str, float]
    sentence: str


def other_lengths(arm: ArmModel) -> Iterator[OtherLength]:
    """Every length of an arm in other units, and every origin as a whole where it has several."""
    # Of cm for m, of mm for cm, of mm for m; and the other way.
    factors = (10.0, 100.0, 1000.0, 0.1, 0.01, 0.001)
    for segment in arm.segments:
        nominal = {n: arm.parameters[n].nominal for n in segment.names(*POSITION)}
        # Shorter than that no unit makes a length that matters, m.
        long = {name: length for name, length in nominal.items() if abs(length) > 1e-6}
        parts = [{name: length} for name, length in long.items()]
        for part in [*parts, *([long] if len(long) > 1 else [])]:
            for factor in factors:
                values = {name: factor * length for name, length in part.items()}
                yield OtherLength(segment.owner, values, _sentence(part, factor))


def _sentence(part: dict[str, float], factor: float) -> str:
    name, length = next(iter(part.items()))
    if len(part) > 1:
        owner = name.rpartition(".")[0]
        return (
            f"the distances in the origin of {owner} are {factor:g} times as large: a wrong "
            "unit in the URDF"
        )
    read, stands = (f"{mm(value):.6g} mm" for value in (factor * length, length))
    return f"{name} is {read} instead of {stands}: a wrong unit in the URDF"
