"""Random numbers, noise levels, and the side of its play on which a joint stands.

Every random number belongs to a named stream, so that changing one thing (another level of noise,
one more placement) leaves all others as they were.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import rotation_from_vector, wrap
from suta_calib.measurements.fields import (
    ANGLE_OR_0,
    FLAG,
    LENGTH_OR_0,
    Value,
    bits,
    keyed,
    quantity,
)
from suta_calib.measurements.yaml_file import YamlSection
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import BACKLASH, GAIN, HYSTERESIS
from suta_calib.terms.synthetic import random_directions
from suta_calib.units import Unit, from_mm


@dataclass(frozen=True)
class NoiseLevels:
    """Standard deviations per axis, zero for none: the key ``noise`` of a simulation, in SI."""

    seating: float = keyed(LENGTH_OR_0, "Of a touch, per coordinate.", 0.0)
    seating_angle: float = keyed(
        ANGLE_OR_0, "Of the rotation of a seated tip, about each axis.", 0.0, "seating_deg"
    )
    encoder_angle: float = keyed(
        ANGLE_OR_0, "Of the reading of a revolute joint.", 0.0, "encoder_deg"
    )
    encoder_length: float = keyed(
        LENGTH_OR_0, "Of the reading of a prismatic joint.", 0.0, "encoder_mm"
    )
    encoder_bits: int = keyed(
        bits(0),
        "Encoder resolution: revolute joints are read in steps of "
        "a turn / 2^bits; 0 for no rounding.",
        0,
    )
    instrument: float = keyed(
        LENGTH_OR_0, "Of a position that an instrument or camera measures, per coordinate.", 0.0
    )
    instrument_angle: float = keyed(
        ANGLE_OR_0,
        "Of an orientation that an instrument or camera measures, about each axis.",
        0.0,
        "instrument_deg",
    )
    corner: float = keyed(
        quantity("px", "non-negative"), "Of a corner in a picture, per coordinate.", 0.0
    )
    artefact: bool = keyed(
        FLAG, "Whether the true landmarks deviate from the artefact file by their sigma_mm.", False
    )
    instrument_number: float = keyed(
        quantity(sign="non-negative"),
        "Of instrument readings that are neither lengths nor angles, in SI units.",
        0.0,
        "instrument",
    )
    tilt: float = keyed(
        ANGLE_OR_0, "Of the direction that a tilt sensor of the arm feels, per component.", 0.0
    )

    def of_instrument(self, unit: Unit) -> float:
        """Noise of an external instrument's reading in a unit."""
        return {"m": self.instrument, "rad": self.instrument_angle}.get(
            unit, self.instrument_number
        )


def _read_fraction(section: YamlSection, key: str) -> float:
    fraction = section.number(key, "non-negative")
    if fraction > 1:
        raise section.refuse(f"{fraction:g}", "a share from 0 to 1", at=(key,))
    return fraction


def _read_sizes(section: YamlSection, key: str) -> tuple[float, float]:
    low, high = section.numbers(key, 2)
    if not 0 <= low <= high:
        raise section.refuse(f"[{low:g}, {high:g}]", "[smallest, largest] size", at=(key,))
    return from_mm(low), from_mm(high)


@dataclass(frozen=True)
class OutlierSpec(Displayable):
    """Gross errors, displacements in any direction: the key ``outliers`` of a set, in SI.

    The fraction of the samples of each file is rounded to whole samples.
    """

    fraction: float = keyed(
        Value("0 to 1", _read_fraction), "Share of the samples that are outliers."
    )
    size: tuple[float, float] = keyed(
        Value("smallest, largest in mm", _read_sizes, unit="m"), "Size of the outliers."
    )


def stream(seed: int, *names: str) -> np.random.Generator:
    """The random numbers of one purpose, the same for the same seed and names."""
    return np.random.default_rng([seed, *(crc32(name.encode()) for name in names)])


def scattered_rotations(rng: np.random.Generator, std: float, n: int) -> FloatArray:
    """Small random rotations, (n, 3, 3), each component of the vector with ``std`` rad."""
    return rotation_from_vector(std * rng.standard_normal((n, 3)))


def outlier_displacements(rng: np.random.Generator, spec: OutlierSpec, n: int) -> FloatArray:
    """Displacements (n, 3), m: zero but for the outliers, as many as the fraction says."""
    displacement = np.zeros((n, 3))
    rows = rng.permutation(n)[: round(spec.fraction * n)]
    direction = random_directions(rng, len(rows))
    displacement[rows] = rng.uniform(*spec.size, (len(rows), 1)) * direction
    return displacement


def encoder_readings(
    rng: np.random.Generator, noise: NoiseLevels, arm: ArmModel, q: FloatArray
) -> FloatArray:
    """Noisy, wrapped, then quantised readings (n, joints) of encoders that ought to report q."""
    prismatic = np.array([joint.type == "prismatic" for joint in arm.readings])
    std = np.where(prismatic, noise.encoder_length, noise.encoder_angle)
    readings = wrapped(arm, q + std * rng.standard_normal(q.shape))
    if noise.encoder_bits:
        step = 2 * np.pi / 2**noise.encoder_bits
        # The step at -π and the one at π are one place of the encoder: wrap once more.
        rounded = wrapped(arm, step * np.round(readings / step))
        readings = np.where(prismatic, readings, rounded)
    return readings


def wrapped(arm: ArmModel, q: FloatArray) -> FloatArray:
    """Readings of joints that can turn a full circle, wrapped to (-π, π]; others as they are."""
    return np.where(full_circle(arm), wrap(q), q)


def full_circle(arm: ArmModel) -> NDArray[np.bool_]:
    """Which joints, (joints,), are where they were after a full turn of their reading.

    They are revolute, with limits at least 2π apart or none, and neither a gain nor a joint that
    follows them, or is coupled to them, makes another angle than full turns of it.
    """
    turning = np.array(
        [
            joint.type != "prismatic" and joint.upper - joint.lower >= 2 * np.pi - 1e-6
            for joint in arm.readings
        ]
    )
    for mover, ratios in zip(arm.movers, arm.gearing, strict=True):
        (gain,) = mover.names(GAIN)
        turning &= ratios % 1.0 == 0.0
        if mover.motion != "revolute" or arm.nongeometric[gain].nominal:
            turning[mover.column] = False
    return turning


def last_motions(
    arm: ArmModel, values: Mapping[str, float], q: FloatArray, rng: np.random.Generator
) -> FloatArray | None:
    """Each joint's last motion before it was read, as a samples file has it.

    The arm goes from one row to the next straight away, so a joint's last motion is the difference;
    one that stands still keeps its side. Where it came from before the first row is drawn.
    Of readings q (n, joints) in their order -1 and 1 (n, joints); None where no joint has backlash.
    """
    if not backlashes(arm, values).any():
        return None
    sides = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    sides[0] = rng.choice([-1.0, 1.0], q.shape[1])
    for before, now in pairwise(sides):
        now[now == 0.0] = before[now == 0.0]
    return sides


def backlashes(arm: ArmModel, values: Mapping[str, float]) -> FloatArray:
    """(joints,) backlash of each joint that is read, rad."""
    return np.array([values.get(f"{joint}.{BACKLASH}", 0.0) for joint in arm.joints])


def remembers(arm: ArmModel, values: Mapping[str, float]) -> bool:
    """Whether a joint lags by all the way that it has come, not by its last direction alone."""
    return any(values.get(name) for name in arm.nongeometric if name.endswith(f".{HYSTERESIS}"))


def readings_beside(
    arm: ArmModel, values: Mapping[str, float], q: FloatArray, sides: FloatArray | None
) -> FloatArray:
    """Readings (n, joints) of joints that stand as they would at readings ``q`` without play.

    ``(1 + gain) q + … - ½ backlash · side`` is the joint's angle: the reading runs ahead of the
    link by half of the play.
    """
    if sides is None:
        return q
    gains = np.array([values.get(f"{joint}.gain", 0.0) for joint in arm.joints])
    return np.asarray(q + 0.5 * backlashes(arm, values) * sides / (1.0 + gains))
