"""What goes wrong with samples and artefacts in laboratories, as changes to what was read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from wrong_samples import (
    Change,
    backwards,
    clock_jumped,
    clocks_apart,
    columns_backwards,
    columns_shifted,
    crept,
    drifting,
    duplicated_with_jitter,
    exchanged,
    gross,
    inverted,
    joint,
    late,
    longer,
    longer_tool,
    loose_pillar,
    lost_lock,
    moved_half_way,
    numbered_on,
    other_zeros,
    pasted,
    reordered,
    reused,
    row_missing,
    saturated,
    seen,
    sorted_column,
    stretched,
    swapped_joints,
    with_length,
    without_point,
    wrap_missed,
)

from suta_calib import Artefact
from suta_calib.units import deg, mm


@dataclass(frozen=True)
class Corruption:
    """One thing that goes wrong.

    Attributes:
        name: what it is.
        words: parts of sentences, of which one must be said where the cause is named.
        samples: what becomes of a file's samples.
        artefact: what becomes of an artefact's file.
        urdf: what becomes of the arm's file.
        needs: what the samples must have: ``position``, ``rotation``, ``artefact``, an ``order`` of
            what was observed, ``touches``, or a label.
        files: of which samples it happens to: those of every file, of every file that is fitted, of
            the first of these, or of all that was measured ``later`` than half of what is fitted.
        validation: which set stands in for the validation's.
        right: whether the tip stays right, so that only ± or the meaning of figures suffers.
    """

    name: str
    words: tuple[str, ...]
    samples: Change = lambda samples: samples
    artefact: Callable[[Artefact], Artefact] | None = None
    urdf: Callable[[str], str] | None = None
    needs: str = ""
    files: str = "all"
    validation: str = "validation"
    right: bool = False


LATE: Final = (" late", " early", "opposite order")
CORRUPTIONS: Final = (
    Corruption("a joint's sign", ("counts the other way", "sign"), joint(1, np.negative)),
    Corruption("two joints swapped", ("exchanged",), swapped_joints),
    Corruption("a joint off by 90°", ("too much", "limit"), joint(2, lambda q: q + np.pi / 2)),
    Corruption("a joint off by a turn", ("turn",), joint(2, lambda q: q + 2 * np.pi), right=True),
    Corruption("degrees for radians", ("degrees",), lambda s: replace(s, q=deg(s.q))),
    Corruption(
        "a stuck encoder",
        ("encoder alive", "same in every row"),
        joint(3, lambda q: 0 * q + 1.9),
    ),
    Corruption(
        "a count lost per turn", ("lose or double counts",), joint(2, lambda q: q * (1 - 1 / 4096))
    ),
    Corruption(
        "an encoder slips half-way", ("slip",), joint(3, lambda q: q + 0.005), files="later"
    ),
    Corruption("mm for m (instrument)", (" mm, not m", "mm"), seen(mm), needs="position"),
    Corruption(
        "instrument 2 % too long",
        ("too long", "longer than nominal"),
        seen(lambda p: 1.02 * p),
        needs="position",
    ),
    Corruption(
        "instrument moved half-way",
        ("moved",),
        seen(moved_half_way),
        needs="position",
        files="fitted",
    ),
    Corruption(
        "instrument moved before validation",
        ("moved",),
        seen(lambda p: p + 0.05),
        needs="position",
        files="validation",
        right=True,
    ),
    Corruption(
        "instrument creeps by 2 mm", ("crept",), seen(crept), needs="position", files="fitted"
    ),
    Corruption(
        "rows pasted from elsewhere",
        ("outliers", "times as large"),
        seen(pasted),
        needs="position",
        files="fitted",
    ),
    Corruption(
        "a decimal sign lost", ("mm", "outside", "reach"), seen(without_point), needs="position"
    ),
    Corruption("joint columns shifted", ("under the name of",), columns_shifted),
    Corruption(
        "duplicated with jitter",
        ("twice", "count once", "alike"),
        duplicated_with_jitter,
        files="first",
        right=True,
    ),
    Corruption(
        "tracker repeats its last value",
        ("repeat its last value",),
        seen(lost_lock),
        needs="position",
        files="fitted",
    ),
    Corruption(
        "a zero that drifts",
        ("drift", "crept", "slip", "turned"),
        joint(1, drifting),
        files="fitted",
    ),
    Corruption(
        "base bumped by 2 mm half-way",
        ("moved", "slip"),
        joint(0, lambda q: q + 4e-3),
        files="later",
    ),
    Corruption("a longer tip half-way", ("tool", "moved"), longer, needs="rotation", files="later"),
    Corruption("joint columns backwards", ("in the opposite order",), columns_backwards),
    Corruption(
        "a row missing half-way",
        ("missing among", " late"),
        row_missing,
        needs="order",
        files="first",
    ),
    Corruption("a reading that saturates", ("to the last digit",), joint(2, saturated)),
    Corruption(
        "positions in whole cm",
        ("in steps of",),
        seen(lambda p: np.round(p, 2)),
        needs="position",
        files="fitted",
        right=True,
    ),
    Corruption("one joint in degrees", ("degrees", "joint range"), joint(4, deg)),
    Corruption(
        "an axis mirrored",
        ("left-handed", "wrong sign"),
        seen(lambda p: p * [1.0, 1.0, -1.0]),
        needs="position",
    ),
    Corruption("clocks drift apart", LATE, clocks_apart, needs="order"),
    Corruption("poses inverted", ("inverted",), inverted, needs="rotation"),
    Corruption("quaternion order", ("w x y z", "quaternion"), reordered, needs="rotation"),
    *(Corruption(f"{n} rows late", LATE, partial(late, n), needs="order") for n in (1, 5, 20)),
    Corruption("one file a row late", LATE, partial(late, 1), needs="order", files="first"),
    Corruption("rows in the opposite order", LATE, backwards, needs="order"),
    Corruption(
        "landmarks swapped", ("exchanged",), partial(exchanged, "landmark"), needs="landmark"
    ),
    Corruption(
        "landmarks numbered on",
        ("numbers are",),
        partial(numbered_on, "landmark"),
        needs="landmark",
    ),
    Corruption(
        "one label for all placements",
        ("was moved",),
        partial(reused, "placement"),
        needs="placement",
    ),
    Corruption("one label for all points", ("was moved",), partial(reused, "point"), needs="point"),
    Corruption(
        "duplicated rows",
        ("twice", "count once"),
        lambda s: s.take(np.tile(np.arange(len(s)), 3)),
        files="fitted",
        right=True,
    ),
    Corruption("30 % gross outliers", ("outliers", "times as large"), gross, files="fitted"),
    Corruption(
        "validation repeats the calibration",
        ("fitted too", "held out"),
        validation="calibration",
        right=True,
    ),
    Corruption(
        "a session with other zeros", ("slip", "moved", "turned"), other_zeros, files="later"
    ),
    Corruption(
        "readings in whole degrees",
        ("in steps of",),
        lambda s: replace(s, q=np.radians(np.round(deg(s.q)))),
        right=True,
    ),
    Corruption("a clock set half-way", (*LATE, "missing among"), clock_jumped, needs="order"),
    Corruption("a wrap missed in some rows", ("that its count missed",), joint(4, wrap_missed)),
    Corruption("one column sorted", ("are sorted",), joint(2, sorted_column)),
    Corruption(
        "one column copied over another",
        ("same as one another",),
        lambda s: replace(s, q=s.q[:, [0, 1, 2, 3, 3, 5]]),
    ),
    Corruption(
        "another camera's file",
        ("too far", "too near", "too long", "longer"),
        seen(lambda p: p * [1.0, 1.0, 1.05]),
        needs="rotation",
    ),
    Corruption(
        "a link length in cm",
        ("a wrong unit in the URDF",),
        urdf=partial(with_length, "joint_4", lambda length: 10.0 * length),
    ),
    Corruption(
        "another variant of the arm",
        ("another arm", "ended at a bound", "joint_4.z", "joint_6.z"),
        urdf=lambda text: with_length(
            "joint_6", lambda h: h + 0.02, with_length("joint_4", lambda h: h - 0.035, text)
        ),
    ),
    Corruption(
        "a longer tool half-way", ("tool", "moved"), longer_tool, needs="touches", files="later"
    ),
    Corruption(
        "a loose pillar",
        ("outliers", "times as large", "M1", "scatter"),
        loose_pillar,
        needs="landmark",
        files="fitted",
    ),
    Corruption(
        "artefact in m, written as mm",
        ("mm", "unit"),
        artefact=partial(stretched, 1e-3),
        needs="artefact",
    ),
    Corruption(
        "artefact 2 % too long",
        ("too long", "longer than nominal"),
        artefact=partial(stretched, 1.02),
        needs="artefact",
    ),
    Corruption(
        "artefact mirrored",
        ("mirror", "left-handed"),
        artefact=partial(stretched, np.array([-1.0, 1, 1])),
        needs="artefact",
    ),
)
