"""The keys of the rows of ``calibration.yaml``: what each of them takes and says."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from suta_calib.measurements.exclusion import exclusion_keys, read_exclusion
from suta_calib.measurements.fields import (
    ANGLE,
    FILE,
    FLAG,
    LENGTH,
    TEXT,
    TEXTS,
    Field,
    Fields,
    Value,
    quantity,
)
from suta_calib.measurements.scale import SCALE_KEYS
from suta_calib.measurements.yaml_file import YamlSection
from suta_calib.terms import KINDS, Seating, every_grouping
from suta_calib.terms.given_pose import POSE_KEYS
from suta_calib.units import Unit, key

_BOUND: Final = "How far from nominal {} may be, at most"
_PRIOR: Final = "How far from nominal {} is likely to be: standard deviation of a Gaussian prior"
# By unit, what a bound or prior is of, and its attribute of `Selection`.
_SIZES: Final[dict[Unit, tuple[str, str]]] = {
    "m": ("a length", "m"),
    "rad": ("an angle", "rad"),
    "rad/Nm": ("a joint's compliance", "rad_per_nm"),
    "1/K": ("a length's expansion", "per_k"),
    "1": ("a ratio, such as a gain or coupling,", "ratio"),
}
BOUND_AND_PRIOR_KEYS: Final = Fields(
    *(
        Field(
            key(name, unit),
            quantity(unit, "positive"),
            f"{sentence.format(of)}.",
            given_attribute=f"{name}_{attribute}",
        )
        for name, sentence in (("bound", _BOUND), ("prior", _PRIOR))
        for unit, (of, attribute) in _SIZES.items()
    )
)
SELECTION_KEYS: Final = Fields(
    Field(
        "select",
        TEXTS,
        "The parameters that the row is about; the word geometric selects every placement "
        "parameter of every joint of the chain and of the tip. Later rows win.",
        required=True,
    ),
    *BOUND_AND_PRIOR_KEYS,
    Field(
        "fixed", FLAG, "Held at nominal; beside a prior: the data have no say in how wide it is."
    ),
)

SEATING_KEYS: Final = Fields(
    Field("clearance_mm", LENGTH, "How far the tip may sit off the sockets' axes."),
    Field("rotation_deg", ANGLE, "How far it may be turned about them."),
)


def _read_seating(row: YamlSection, name: str) -> Seating:
    return Seating(**SEATING_KEYS.read(row.section(name)))


_EXCLUDED: Final = Value(
    "mapping",
    lambda row, name: read_exclusion(row.section(name), every_grouping()),
    Fields(lambda: exclusion_keys(every_grouping())),
)
# What every kind has, whether or not it has a use for it.
COMMON_KEYS: Final = Fields(
    Field("kind", Value("text"), "Which kind of observation it is.", required=True),
    Field(
        "samples",
        Value("files"),
        "The samples CSV files: globs, relative to the job's folder.",
        required=True,
    ),
    Field("artefact", FILE, "The artefact.yaml of what is touched, where the kind needs one."),
    Field("label", TEXT, "Tells several instruments, cameras or sets of sockets apart."),
    Field("exclude", _EXCLUDED, "Samples that are left out, by name."),
    Field(
        "huber_mm",
        LENGTH,
        "Lengths beyond it are believed less; least squares without it. Where the noise is learned "
        "with priors, or beside another kind's, and is not fixed, the threshold follows it down.",
        given_attribute="huber_m",
    ),
    Field("huber_deg", ANGLE, "The same of angles.", given_attribute="huber_rad"),
    Field(
        "sigma_mm",
        LENGTH,
        "Standard deviation of a length or coordinate; learned from there.",
        given_attribute="sigma_m",
    ),
    Field("sigma_deg", ANGLE, "The same of an angle.", given_attribute="sigma_rad"),
    Field(
        "fixed", FLAG, "Beside a sigma: the data have no say in it.", given_attribute="sigma_fixed"
    ),
    Field(
        "seating",
        Value("mapping", _read_seating, SEATING_KEYS),
        "What the artefact's sockets leave the tip: how it sits in them is found too.",
    ),
    Field(
        "pose",
        Value("mapping, or by label", inside=POSE_KEYS),
        "What is known of where something stands: the only place there is, or places by label; "
        "for a kind in which something sees, the pose of what sees in what carries it.",
    ),
    *(
        replace(
            field,
            about="For an instrument that measures lengths. Without grade and scale_ppm, a "
            "camera's target counts as printed and any other instrument as 20 ppm. "
            f"{field.about}",
        )
        for field in SCALE_KEYS
    ),
)


def _of_frames() -> Iterable[Field]:
    pose = Value("mapping", inside=POSE_KEYS)
    return {
        frame.key: Field(frame.key, pose, f"What is known of {frame.about}.")
        for kind in KINDS.values()
        for frame in kind.frames
    }.values()


def _of_kinds() -> Iterable[Field]:
    return {
        field.name: replace(field, required=False) for kind in KINDS.values() for field in kind.keys
    }.values()


# Of one kind or other: what a kind needs, `job.schema` asks it.
OBSERVATION_KEYS: Final = Fields(*COMMON_KEYS, _of_frames, _of_kinds)
