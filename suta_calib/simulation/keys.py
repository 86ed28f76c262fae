"""The keys of ``simulation.yaml``: what each of them says."""

from __future__ import annotations

from typing import Final

from suta_calib.measurements.keys import BASE, POSE, POSITION, TIP, URDF, Key, Keys
from suta_calib.terms import Term
from suta_calib.units import REFERENCE_TEMPERATURE, SHOWN, Unit, key

ARM_KEYS: Final = Keys(
    URDF,
    TIP,
    BASE,
    Key("tip_offset_mm", "x, y, z in mm", "A probe at the tip, in its frame; a job may seek it."),
)
# A point has no orientation.
POINT_KEYS: Final = Keys(POSITION)
# Of what an arm's parameters may be.
ARM_UNITS: Final[tuple[Unit, ...]] = ("m", "rad", "rad/Nm", "1/K", "1")
ERROR_KEYS: Final = Keys(
    Key(
        "select",
        "names or globs",
        "The parameters that depart from nominal; the word geometric as in calibration.yaml. "
        "Later rows win.",
        required=True,
    ),
    *(
        Key(key(name, unit), SHOWN[unit].unit or "number", about)
        for name, about in (
            ("value", "The departure itself."),
            ("std", "Standard deviation that departures are drawn with."),
        )
        for unit in ARM_UNITS
    ),
)
NOISE_KEYS: Final = Keys(
    Key("seating_mm", "mm", "Of a touch, in each coordinate."),
    Key("seating_deg", "deg", "Of how a tip that is seated is turned, about each axis."),
    Key("encoder_deg", "deg", "Of a revolute joint's reading."),
    Key("encoder_mm", "mm", "Of a prismatic joint's reading."),
    Key("encoder_bits", "whole number", "Revolute joints read whole steps of a turn over 2^bits."),
    Key("instrument_mm", "mm", "Of what an instrument or camera sees, in each coordinate."),
    Key("instrument_deg", "deg", "Of the orientation that it sees, about each axis."),
    Key("corner_px", "px", "Of a corner in a picture, in each coordinate."),
    Key("artefact", "true or false", "Whether landmarks are off by their own sigma_mm."),
)
OUTLIER_KEYS: Final = Keys(
    Key("fraction", "0 to 1", "Share of the samples that are grossly wrong.", required=True),
    Key("size_mm", "smallest, largest in mm", "By how much they are wrong.", required=True),
)
SEAT_KEYS: Final = Keys(
    Key("x_mm", "mm", "How far the tip always sits off the socket's axis, along x."),
    Key("y_mm", "mm", "The same along y."),
    Key("rz_deg", "deg", "How far it is always turned about the tool's axis."),
)
_NOISE: Final = "Standard deviations of what scatters, zero without them"


def set_keys(kind: type[Term]) -> Keys:
    """The keys of a set of one kind of observation."""
    every = (
        Key("kind", "text", "Which kind of observation it is.", required=True),
        Key("noise", "mapping", f"{_NOISE}; in place of the file's.", inside=NOISE_KEYS),
        Key("outliers", "mapping", "What is grossly wrong; nothing without.", inside=OUTLIER_KEYS),
    )
    measured = {*kind.measured_keys}
    kind_keys = (*(key for key in kind.keys if key.name not in measured), *kind.simulation_keys)
    return Keys(*every, *_medium_keys(kind), *kind_keys)


def _medium_keys(kind: type[Term]) -> tuple[Key, ...]:
    """What follows from whether a tip touches or something sees."""
    if kind.medium != "touch":
        frames = (
            Key(
                *(frame.key, "mapping"),
                f"{frame.about[0].upper()}{frame.about[1:]}.",
                frame.required,
                inside=POSE,
            )
            for frame in kind.frames
        )
        optional = kind.columns.orientation == "optional"
        turned = "Whether orientations are seen too."
        marks = f"Where on the tip's link each {kind.mark} sits; the tip itself without it."
        return (
            Key("samples", "whole number", "How many samples are taken.", required=True),
            Key(
                "temperature",
                "lowest, highest in °C",
                "How warm the arm is, drawn anew for every sample and written in its column; "
                f"{REFERENCE_TEMPERATURE:g}, and no such column, without it.",
            ),
            *frames,
            *([Key("orientation", "true or false", turned)] if optional else []),
            *([Key(f"{kind.mark}s", "by label", marks, inside=POSE)] if kind.mark else []),
        )
    where = Key(
        f"{kind.place}s",
        "by label",
        f"Where each {kind.place} stands in the base.",
        required=True,
        inside=POSE if kind.place_turns else POINT_KEYS,
    )
    if kind.needs_artefact:
        return (
            Key("artefact", "file", "The artefact.yaml of what is touched.", required=True),
            where,
            Key("repeats", "whole number", "How often each placement is gone through; 1 without."),
            Key("seating", "mapping", "How the tip always sits in its sockets.", inside=SEAT_KEYS),
        )
    return (
        where,
        Key("directions", "whole number", "From how many directions each is touched; 20 without."),
        Key(
            "axis",
            "x, y, z",
            "Middle of the tip's z axes, in the base; against the place's own z axis without it.",
        ),
        Key("cone_deg", "deg", "Largest angle between a tip's z axis and the axis; 60 without it."),
    )


SIMULATION_KEYS: Final = Keys(
    Key("arm", "mapping", "The nominal arm, and the ends of its chain.", True, inside=ARM_KEYS),
    Key("seed", "whole number", "Of every random number; 0 without it."),
    Key(
        "posture_deg",
        "by joint, deg",
        "Where the first search for a posture starts; the middle of a joint's range without it.",
    ),
    Key("posture_mm", "by joint, mm", "The same for prismatic joints."),
    Key("errors", "rows", "How the true arm departs from the nominal one.", inside=ERROR_KEYS),
    Key("noise", "mapping", f"{_NOISE}.", inside=NOISE_KEYS),
    Key(
        "sets",
        "by name",
        "What is measured: each set becomes a folder of samples of its name. Its keys follow from "
        "its kind.",
        required=True,
    ),
)
