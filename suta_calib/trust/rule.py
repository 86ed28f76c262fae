"""The thresholds from which on wrong data are reported. A job may set them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from suta_calib.measurements.fields import Value, keyed, quantity
from suta_calib.measurements.yaml_file import YamlSection


def _probability(section: YamlSection, name: str) -> float:
    value = section.number(name, "positive")
    if value > 1.0:
        raise section.refuse(f"{value:g}", "a number from 0 to 1", at=(name,))
    return value


PROBABILITY: Final = Value("number from 0 to 1", _probability)


@dataclass(frozen=True)
class Rule:
    """When evidence of wrong data is reported: the key ``rule`` of a job.

    Where a model lacks much and rows are many, everything is significant and little of it is the
    cause: hence `share`. A quarter lowers the RMS by 13 %. Two exchanged landmarks of a sound
    simulated job lower the misfit 2.4 times, and no sound job was read otherwise at 2: hence
    `far_better`.
    """

    false_alarm: float = keyed(
        PROBABILITY, "Probability of any false report in one answer, all tests together.", 1e-3
    )
    share: float = keyed(
        PROBABILITY,
        "Smallest share of the squared residuals that an effect must explain to be reported.",
        0.25,
    )
    far_better: float = keyed(
        quantity("1", "positive"),
        "Factor by which the misfit must fall before the data are read in another way.",
        2.0,
    )
    times_std: float = keyed(
        quantity("1", "positive"), "Standard deviations that a size must be away from zero.", 4.0
    )
