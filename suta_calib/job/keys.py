"""The keys of the rows of ``calibration.yaml``: what each of them takes and says."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from suta_calib.arm_keys import CHAIN_KEYS
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
    mapping,
    quantity,
)
from suta_calib.measurements.scale import SCALE_KEYS
from suta_calib.measurements.yaml_file import YamlSection
from suta_calib.terms import KINDS, Seating, every_grouping
from suta_calib.terms.clock import TimeOffset
from suta_calib.terms.given_pose import POSE_KEYS
from suta_calib.units import Unit, key

_BOUND: Final = "Largest difference of {} from nominal"
_PRIOR: Final = "Standard deviation of a Gaussian prior of {} about nominal"
# By unit, what a bound or prior is of, and its attribute of `Selection`.
_SIZES: Final[dict[Unit, tuple[str, str]]] = {
    "m": ("a length", "m"),
    "rad": ("an angle", "rad"),
    "rad/Nm": ("a joint's compliance", "rad_per_nm"),
    "kg": ("the mass that a joint carries", "kg"),
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
        "Names of the parameters; the word geometric selects every placement parameter of every "
        "joint of the chain and of the tip. Later rows win.",
        required=True,
    ),
    *BOUND_AND_PRIOR_KEYS,
    Field(
        "fixed",
        FLAG,
        "true: not estimated, stays nominal; beside a prior: its width is not changed by the data.",
    ),
)

SEATING_KEYS: Final = Fields(
    Field("clearance_mm", LENGTH, "Largest distance of the seated tip from the sockets' axes."),
    Field("rotation_deg", ANGLE, "Largest turn of the seated tip about them."),
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
    Field("kind", Value("text"), "Kind of observation.", required=True),
    Field(
        "samples",
        Value("files"),
        "The samples (CSV files, globs), relative to the job's folder.",
        required=True,
    ),
    *CHAIN_KEYS,
    Field("artefact", FILE, "The artefact.yaml of the touched artefact, where the kind needs one."),
    Field(
        "label", TEXT, "Label of the instrument, camera or set of sockets, where there are several."
    ),
    Field("exclude", _EXCLUDED, "Samples to leave out, by name."),
    Field(
        "huber_mm",
        LENGTH,
        "Robust threshold: rows with larger errors get less weight; least squares without it. "
        "If the noise is estimated together with priors or with the noise of another kind, the "
        "threshold is at most Huber's usual multiple of that noise.",
        given_attribute="huber_m",
    ),
    Field("huber_deg", ANGLE, "The same for angles.", given_attribute="huber_rad"),
    Field(
        "sigma_mm",
        LENGTH,
        "Standard deviation of a length or coordinate; the estimate starts there.",
        given_attribute="sigma_m",
    ),
    Field("sigma_deg", ANGLE, "The same for an angle.", given_attribute="sigma_rad"),
    Field(
        "fixed",
        FLAG,
        "true: the data do not change the sigma beside it.",
        given_attribute="sigma_fixed",
    ),
    Field(
        "seating",
        Value("mapping", _read_seating, SEATING_KEYS),
        "Clearance of the artefact's sockets; the seating error is estimated too.",
    ),
    Field(
        "time_offset_ms",
        mapping(TimeOffset),
        "The instrument, or camera, sees a moving arm and has a clock of its own: its time offset "
        "is estimated too, for all rows with this label. The samples have a column time, in s.",
        given_attribute="time_offset",
    ),
    Field(
        "pose",
        Value("mapping, or by label", inside=POSE_KEYS),
        "Known poses of the artefact, instrument or target: one pose, or poses by label. For a "
        "kind with a camera, its pose on the tip or in the base.",
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
        frame.key: Field(frame.key, pose, f"Known: {frame.about}.")
        for kind in KINDS.values()
        for frame in kind.frames
    }.values()


def _of_kinds() -> Iterable[Field]:
    return {
        field.name: replace(field, required=False) for kind in KINDS.values() for field in kind.keys
    }.values()


# Of one kind or other: what a kind needs, `job.schema` asks it.
OBSERVATION_KEYS: Final = Fields(*COMMON_KEYS, _of_frames, _of_kinds)
