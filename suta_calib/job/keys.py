"""The keys of ``calibration.yaml``: what each of them says."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from suta_calib.job.tip_offset import TIP_OFFSET_KEYS
from suta_calib.measurements.exclusion import exclusion_keys
from suta_calib.measurements.keys import BASE, SCALE_KEYS, TIP, URDF, Key, Keys
from suta_calib.terms import KINDS, every_grouping
from suta_calib.terms.given import POSE_KEYS
from suta_calib.units import SHOWN, Unit, key

ARM_KEYS: Final = Keys(
    URDF,
    TIP,
    BASE,
    Key(
        "tip_offset_mm",
        "x, y, z in mm, or a mapping",
        "Where the tip is in that frame, for a probe that the URDF does not know. Three numbers "
        "are taken as given; with bound_mm or prior_mm the place is to be found.",
        inside=TIP_OFFSET_KEYS,
    ),
    Key(
        "couplings",
        "by joint, numbers by joint",
        "Joints that the readings of others move too, as through a parallelogram: {joint_3: "
        "{joint_2: -1}} turns joint_3 by -1 of what joint_2 reads beside its own. Held there, "
        "unless a row frees joint_3.coupling[joint_2].",
    ),
    Key(
        "grade",
        "certified, machined or printed",
        "How the arm was made. This sets the tolerance of the dimensions that no row frees, and "
        "that of one scale factor of all lengths. Without it, the errors of the estimated "
        "dimensions set the tolerance, and it is at least that of machined parts. Every ± that "
        "depends on held dimensions includes it.",
    ),
)

_BOUND: Final = "How far from nominal {} may be, at most"
_PRIOR: Final = "How far from nominal {} is likely to be: standard deviation of a Gaussian prior"
_SIZES: Final[dict[Unit, str]] = {
    "m": "a length",
    "rad": "an angle",
    "rad/Nm": "a joint's compliance",
    "1/K": "a length's expansion",
    "1": "a ratio, such as a gain or coupling,",
}
BOUND_AND_PRIOR_KEYS: Final = Keys(
    *(
        Key(key(name, unit), SHOWN[unit].unit or "number", sentence.format(of) + ".")
        for name, sentence in (("bound", _BOUND), ("prior", _PRIOR))
        for unit, of in _SIZES.items()
    )
)
SELECTION_KEYS: Final = Keys(
    Key(
        "select",
        "names or globs",
        "The parameters that the row is about; the word geometric selects every placement "
        "parameter of every joint of the chain and of the tip. Later rows win.",
        required=True,
    ),
    *BOUND_AND_PRIOR_KEYS,
    Key(
        "fixed",
        "true or false",
        "Held at nominal; beside a prior: the data have no say in how wide it is.",
    ),
)

SEATING_KEYS: Final = Keys(
    Key("clearance_mm", "mm", "How far the tip may sit off the sockets' axes."),
    Key("rotation_deg", "deg", "How far it may be turned about them."),
)
# What every kind has, whether or not it has a use for it.
COMMON_KEYS: Final = Keys(
    Key("kind", "text", "Which kind of observation it is.", required=True),
    Key(
        "samples",
        "files",
        "The samples CSV files: globs, relative to the job's folder.",
        required=True,
    ),
    Key("artefact", "file", "The artefact.yaml of what is touched, where the kind needs one."),
    Key("label", "text", "Tells several instruments, cameras or sets of sockets apart."),
    Key(
        "exclude",
        "mapping",
        "Samples that are left out, by name.",
        inside=Keys(lambda: exclusion_keys(every_grouping())),
    ),
    Key(
        "huber_mm",
        "mm",
        "Lengths beyond it are believed less; least squares without it. Where the noise is learned "
        "with priors, or beside another kind's, and is not fixed, the threshold follows it down.",
    ),
    Key("huber_deg", "deg", "The same of angles."),
    Key("sigma_mm", "mm", "Standard deviation of a length or coordinate; learned from there."),
    Key("sigma_deg", "deg", "The same of an angle."),
    Key("fixed", "true or false", "Beside a sigma: the data have no say in it."),
    Key(
        "seating",
        "mapping",
        "What the artefact's sockets leave the tip: how it sits in them is found too.",
        inside=SEATING_KEYS,
    ),
    Key(
        "pose",
        "mapping, or by label",
        "What is known of where something stands: the only place there is, or places by label; "
        "for a kind in which something sees, the pose of what sees in what carries it.",
        inside=POSE_KEYS,
    ),
    *(
        replace(
            key,
            about="For an instrument that measures lengths. Without grade and scale_ppm, a "
            "camera's target counts as printed and any other instrument as 20 ppm. "
            f"{key.about}",
        )
        for key in SCALE_KEYS
    ),
)


def _of_frames() -> Iterable[Key]:
    return {
        frame.key: Key(frame.key, "mapping", f"What is known of {frame.about}.", inside=POSE_KEYS)
        for kind in KINDS.values()
        for frame in kind.frames
    }.values()


def _of_kinds() -> Iterable[Key]:
    return {
        key.name: replace(key, required=False) for kind in KINDS.values() for key in kind.keys
    }.values()


# Of one kind or other: what a kind needs, `job.schema` asks it.
OBSERVATION_KEYS: Final = Keys(*COMMON_KEYS, _of_frames, _of_kinds)

SOLVER_KEYS: Final = Keys(
    Key("starts", "whole number", "How many starts; the first is nominal. 1 without it."),
    Key("seed", "whole number", "Of the random numbers the other starts are drawn with."),
    Key(
        "hessian",
        "text",
        "gauss-newton (the default), or exact: second derivatives by automatic differentiation.",
    ),
    Key("max_iterations", "whole number", "Per start."),
)
ENCODER_KEYS: Final = Keys(
    Key("bits", "whole number", "A revolute joint reads whole steps of a turn over 2^bits."),
    Key("noise_deg", "deg", "Standard deviation of a revolute joint's reading beside the steps."),
    Key("noise_mm", "mm", "The same of a prismatic joint's."),
)
JOB_KEYS: Final = Keys(
    Key("arm", "mapping", "The arm, and the ends of its chain.", required=True, inside=ARM_KEYS),
    Key(
        "parameters",
        "rows",
        "What is unknown: one row at least, later rows win.",
        inside=SELECTION_KEYS,
    ),
    Key(
        "observations",
        "rows",
        "What was measured: any number of rows, of any kinds, solved together.",
        required=True,
        inside=OBSERVATION_KEYS,
    ),
    Key(
        "validation",
        "rows",
        "Samples that are never fitted: how good the result is on data it has not seen. The same "
        "keys as of observations.",
    ),
    Key("solver", "mapping", "How it is solved.", inside=SOLVER_KEYS),
    Key(
        "encoders",
        "mapping",
        "What is known of the encoders' noise: only the error budget asks.",
        inside=ENCODER_KEYS,
    ),
)
