"""What goes wrong with samples and artefacts in laboratories, as changes to what was read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from suta_calib import Artefact, Samples
from suta_calib.arrays import FloatArray
from suta_calib.geometry import quaternion_from_rotation, rotation_from_quaternion
from suta_calib.units import deg, mm

Change = Callable[[Samples], Samples]


@dataclass(frozen=True)
class Corruption:
    """One thing that goes wrong.

    Attributes:
        name: what it is.
        words: parts of sentences, of which one must be said where the cause is named.
        samples: what becomes of a file's samples.
        artefact: what becomes of an artefact's file.
        needs: what the samples must have: ``position``, ``rotation``, ``artefact``, an ``order`` of
            what was observed, or a label.
        files: of which samples it happens to: those of every file, of every file that is fitted, of
            the first of these, or of all that was measured ``later`` than half of what is fitted.
        validation: which set stands in for the validation's.
        right: whether the tip stays right, so that only ± or the meaning of figures suffers.
    """

    name: str
    words: tuple[str, ...]
    samples: Change = lambda samples: samples
    artefact: Callable[[Artefact], Artefact] | None = None
    needs: str = ""
    files: str = "all"
    validation: str = "validation"
    right: bool = False


# ── What goes wrong ──────────────────────────────────────────────────────────────────────────
def joint(k: int, change: Callable[[FloatArray], FloatArray]) -> Change:
    """The readings of one joint, changed."""

    def changed(samples: Samples) -> Samples:
        q = samples.q.copy()
        q[:, k] = change(q[:, k])
        return replace(samples, q=q)

    return changed


def seen(change: Callable[[FloatArray], FloatArray]) -> Change:
    """What an instrument or a camera saw, changed."""

    def changed(samples: Samples) -> Samples:
        assert samples.position is not None
        return replace(samples, position=change(samples.position))

    return changed


def drifting(q: FloatArray) -> FloatArray:
    """A zero that drifts by 0.15° while an encoder warms up."""
    return np.asarray(q + np.radians(0.15) * np.linspace(0.0, 1.0, len(q)))


def columns_shifted(samples: Samples) -> Samples:
    """The joints' columns, each under the name of the next."""
    return replace(samples, q=np.roll(samples.q, 1, axis=1))


def swapped_joints(samples: Samples) -> Samples:
    """The first two columns exchanged."""
    order = [1, 0, *range(2, samples.q.shape[1])]
    return replace(samples, q=samples.q[:, order])


def moved_half_way(position: FloatArray) -> FloatArray:
    """An instrument that was pushed 50 mm aside after half of the rows."""
    later = np.arange(len(position)) >= len(position) // 2
    return np.asarray(position + later[:, None] * [0.05, 0.0, 0.0])


def crept(position: FloatArray) -> FloatArray:
    """An instrument that sinks by 2 mm while the rows are measured."""
    return np.asarray(position + np.linspace(0.0, 2e-3, len(position))[:, None] * [0.0, 0.6, 0.8])


def lost_lock(position: FloatArray) -> FloatArray:
    """A tracker that repeats its last value for a fifth of the rows."""
    found, n = position.copy(), len(position)
    found[2 * n // 5 : 3 * n // 5] = position[2 * n // 5]
    return found


def pasted(position: FloatArray) -> FloatArray:
    """Two rows of twenty hold what was seen in others."""
    found, n = position.copy(), len(position)
    rows = np.arange(3, n, 10)
    found[rows] = position[(rows + n // 2) % n]
    return found


def without_point(position: FloatArray) -> FloatArray:
    """A column whose decimal sign was lost: 0.1234 became 1234."""
    return np.column_stack([position[:, 0], np.round(1e4 * position[:, 1]), position[:, 2]])


def longer(samples: Samples) -> Samples:
    """What is seen of a tip that has become 5 mm longer: by an instrument, or by its own camera."""
    assert samples.position is not None
    assert samples.rotation is not None
    return replace(samples, position=samples.position + 5e-3 * samples.rotation[:, :, 2])


def duplicated_with_jitter(samples: Samples) -> Samples:
    """The first third of the rows measured once more, but by a random number generator."""
    rng, extra = np.random.default_rng(0), samples.take(np.arange(len(samples) // 3))
    extra = replace(extra, q=extra.q + rng.normal(0.0, 1e-6, extra.q.shape))
    if extra.position is not None:
        extra = replace(extra, position=extra.position + rng.normal(0, 1e-6, extra.position.shape))
    return Samples.concatenate([samples, extra, extra])


def clocks_apart(samples: Samples) -> Samples:
    """A clock that runs slow: of three thirds the first is in time, then one and two rows late."""
    rows = np.arange(len(samples))
    kept = rows[: len(samples) - 2]
    read, other = samples.take(kept + 3 * kept // len(samples)), samples.take(kept)
    return replace(other, q=read.q, origin=read.origin)


def inverted(samples: Samples) -> Samples:
    """Poses of the target in the camera written as those of the camera in the target."""
    assert samples.position is not None
    assert samples.rotation is not None
    back = np.swapaxes(samples.rotation, 1, 2)
    position = -np.einsum("nij,nj->ni", back, samples.position)
    return replace(samples, rotation=back, position=position)


def reordered(samples: Samples) -> Samples:
    """Quaternions w x y z in the columns of x y z w."""
    assert samples.rotation is not None
    quaternions = np.roll(quaternion_from_rotation(samples.rotation), 1, axis=1)
    return replace(samples, rotation=rotation_from_quaternion(quaternions))


def late(rows: int, samples: Samples) -> Samples:
    """What was observed stands so many rows too late beside the readings."""
    kept = np.arange(len(samples) - rows)
    read, other = samples.take(kept + rows), samples.take(kept)
    return replace(other, q=read.q, origin=read.origin)


def backwards(samples: Samples) -> Samples:
    """The readings in the opposite order of what was observed."""
    return replace(samples, q=samples.q[::-1])


def exchanged(label: str, samples: Samples) -> Samples:
    """Two of a label's names exchanged."""
    names = samples.labels[label]
    a, b = list(dict.fromkeys(names.tolist()))[:2]
    new = np.where(names == a, b, np.where(names == b, a, names))
    return replace(samples, labels={**samples.labels, label: new})


def reused(label: str, samples: Samples) -> Samples:
    """The name of the first place given to all others too, their repeats counted on."""
    names, labels = samples.labels[label], dict(samples.labels)
    if "repeat" in labels:
        pairs = zip(names, labels["repeat"], strict=True)
        labels["repeat"] = np.array([f"{name}.{repeat}" for name, repeat in pairs])
    labels[label] = np.full_like(names, "A")
    return replace(samples, labels=labels)


def numbered_on(label: str, samples: Samples) -> Samples:
    """Names that end with a number, counted from one too many; the last begins anew."""
    names = samples.labels[label]
    order = sorted({n for n in names.tolist() if n[-1].isdigit()}, key=lambda n: (len(n), n))
    new = dict(zip(order, [*order[1:], *order[:1]], strict=True))
    changed = np.array([new.get(n, n) for n in names.tolist()])
    return replace(samples, labels={**samples.labels, label: changed})


def gross(samples: Samples) -> Samples:
    """Three of ten rows: seen elsewhere, or another posture's readings."""
    rng = np.random.default_rng(0)
    rows = rng.permutation(len(samples))[: round(0.3 * len(samples))]
    if samples.position is not None:
        position = samples.position.copy()
        position[rows] += rng.uniform(-0.05, 0.05, (len(rows), 3))
        return replace(samples, position=position)
    q = samples.q.copy()
    q[rows] += rng.normal(0.0, 0.03, (len(rows), q.shape[1]))
    return replace(samples, q=q)


def stretched(factors: FloatArray | float, artefact: Artefact) -> Artefact:
    """Every landmark's position times a factor, or one for each axis."""
    marks = {
        name: replace(mark, position=factors * mark.position)
        for name, mark in artefact.landmarks.items()
    }
    return replace(artefact, landmarks=marks)


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
