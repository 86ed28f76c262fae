"""Samples, artefacts and arms as laboratories get them wrong: what `what_goes_wrong` is made of."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib import ArmModel, Artefact, Samples
from suta_calib.arrays import FloatArray
from suta_calib.geometry import quaternion_from_rotation, rotation_from_quaternion
from suta_calib.trust import sensitivity

URDF: Final = Path(__file__).resolve().parents[1] / "urdf" / "suta.urdf"
Change = Callable[[Samples], Samples]


# ── Readings, and what was seen beside them ──────────────────────────────────────────────────
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


def columns_backwards(samples: Samples) -> Samples:
    """The joints' columns from the tip to the base."""
    return replace(samples, q=samples.q[:, ::-1])


def saturated(q: FloatArray) -> FloatArray:
    """A reading that goes no farther than 86°: a potentiometer's end."""
    return np.asarray(np.minimum(q, 1.5))


def row_missing(samples: Samples) -> Samples:
    """A reading lost after four of ten rows: what was observed is one row late from there on."""
    rows = np.arange(len(samples) - 1)
    other = samples.take(rows)
    return replace(other, q=samples.q[rows + (rows >= 2 * len(rows) // 5)])


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


# ── Another arm, another tool, another session ───────────────────────────────────────────────
@cache
def drawn_arm() -> ArmModel:
    """The arm as drawn."""
    return ArmModel.from_urdf(URDF, "tip")


def touching_elsewhere(samples: Samples, away: FloatArray) -> Samples:
    """Samples whose tip, as the arm is drawn, is so far away (n, 3), m, in the base."""
    arm = drawn_arm()
    names = [f"{joint}.offset" for joint in arm.joints]
    at = sensitivity(arm, {}, names, samples.q)
    step = np.einsum("njk,nk->nj", np.linalg.pinv(at.jacobian), away)
    return replace(samples, q=samples.q + step)


def longer_tool(samples: Samples) -> Samples:
    """What is read where the same places are touched with a tool that is 5 mm longer."""
    rotation, _ = drawn_arm().forward(samples.q)
    return touching_elsewhere(samples, -5e-3 * rotation[:, :, 2])


def loose_pillar(samples: Samples) -> Samples:
    """One landmark gives way by some millimetre, another way at every touch."""
    names = samples.labels["landmark"]
    loose = names == sorted(set(names.tolist()))[0]
    away = np.random.default_rng(0).normal(0.0, 1e-3, (len(samples), 3))
    return touching_elsewhere(samples, away * loose[:, None])


def other_zeros(samples: Samples) -> Samples:
    """A session after the encoders were zeroed anew, each somewhat elsewhere."""
    return replace(samples, q=samples.q + np.radians([0.4, -0.6, 0.5, -0.3, 0.7, -0.5]))


def clock_jumped(samples: Samples) -> Samples:
    """A clock that was set while rows were measured: those after it are three rows late."""
    rows = np.arange(len(samples) - 3)
    read, other = samples.take(rows + 3 * (rows >= len(rows) // 2)), samples.take(rows)
    return replace(other, q=read.q, origin=read.origin)


def wrap_missed(q: FloatArray) -> FloatArray:
    """A geared encoder's count that wraps every 36°: where the joint is far, one too few."""
    return np.asarray(q - np.radians(36.0) * (q > np.quantile(q, 0.6)))


def sorted_column(q: FloatArray) -> FloatArray:
    """One column of a spreadsheet, sorted by itself."""
    return np.sort(q)


def with_length(joint: str, change: Callable[[float], float], text: str) -> str:
    """A URDF in which one joint sits at another height on its link."""
    found = re.search(rf'<joint name="{joint}".*?<origin xyz="\S+ \S+ (\S+?)"', text, re.DOTALL)
    assert found is not None
    start, end = found.span(1)
    return f"{text[:start]}{change(float(found[1])):.6g}{text[end:]}"
