"""What goes wrong with measurements in laboratories, done to sound ones on purpose.

Each corruption takes the terms of a job and gives back terms over corrupted samples (or a corrupted
artefact): signs, swaps, units, labels, shifts, stuck encoders, gross errors. A calibration of such
data must be refused, or must warn and name the cause; `benchmarks/corruptions.py` counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import quaternion_from_rotation, rotation_from_quaternion
from suta_calib.measurements import Artefact, Samples
from suta_calib.terms import ArmPoses, Term
from suta_calib.units import deg, mm

Corrupt = Callable[[Samples, np.random.Generator], Samples]


@dataclass(frozen=True)
class Corruption:
    """One thing that goes wrong.

    Attributes:
        name: what it is.
        samples: what becomes of the samples of a term.
        artefact: what becomes of the artefact, where there is one.
        needs: what the samples must have: ``position``, ``rotation``, or the name of a label.
        said: a word that the cause's sentence has when it is named.
    """

    name: str
    samples: Corrupt = lambda samples, _: samples
    artefact: Callable[[Artefact], Artefact] | None = None
    needs: str = ""
    said: str = ""

    def fits(self, terms: Sequence[Term]) -> bool:
        """Whether it can happen to these terms."""
        if self.artefact is not None:
            return any(hasattr(term, "artefact") for term in terms)
        return all(_has(term.poses.samples, self.needs) for term in terms)

    def of(self, terms: Sequence[Term], seed: int = 0) -> list[Term]:
        """The terms with what went wrong.

        Raises:
            InputError: a corruption that is refused when the term is built.
        """
        rng = np.random.default_rng(seed)
        found = []
        for term in terms:
            assert isinstance(term.poses, ArmPoses)
            changed: Any = term.over_poses(
                ArmPoses(term.poses.arm, self.samples(term.poses.samples, rng))
            )
            if self.artefact is not None and hasattr(changed, "artefact"):
                changed = replace(changed, artefact=self.artefact(changed.artefact))
            found.append(changed)
        return found


def _has(samples: Samples, what: str) -> bool:
    if what in ("position", "rotation"):
        return getattr(samples, what) is not None
    return not what or what in samples.labels


def _joint(k: int, change: Callable[[FloatArray], FloatArray]) -> Corrupt:
    def changed(samples: Samples, rng: np.random.Generator) -> Samples:
        del rng
        q = samples.q.copy()
        q[:, k] = change(q[:, k])
        return replace(samples, q=q)

    return changed


def _swapped_joints(samples: Samples, rng: np.random.Generator) -> Samples:
    del rng
    q = samples.q.copy()
    q[:, [0, 1]] = q[:, [1, 0]]
    return replace(samples, q=q)


def _all_joints(samples: Samples, rng: np.random.Generator) -> Samples:
    del rng
    return replace(samples, q=deg(samples.q))


def _seen(change: Callable[[FloatArray], FloatArray]) -> Corrupt:
    def changed(samples: Samples, rng: np.random.Generator) -> Samples:
        del rng
        assert samples.position is not None
        return replace(samples, position=change(samples.position))

    return changed


def _moved(position: FloatArray) -> FloatArray:
    moved = position.copy()
    moved[len(moved) // 2 :] += [0.05, 0.0, 0.0]
    return moved


def _inverted(samples: Samples, rng: np.random.Generator) -> Samples:
    del rng
    assert samples.position is not None
    assert samples.rotation is not None
    back = np.swapaxes(samples.rotation, 1, 2)
    position = -np.einsum("nij,nj->ni", back, samples.position)
    return replace(samples, rotation=back, position=position)


def _reordered(samples: Samples, rng: np.random.Generator) -> Samples:
    del rng
    assert samples.rotation is not None
    q = quaternion_from_rotation(samples.rotation)
    return replace(samples, rotation=rotation_from_quaternion(np.roll(q, 1, axis=1)))


def _late(rows: int) -> Corrupt:
    def changed(samples: Samples, rng: np.random.Generator) -> Samples:
        del rng
        kept = np.arange(len(samples) - rows)
        read, seen = samples.take(kept + rows), samples.take(kept)
        return replace(read, position=seen.position, rotation=seen.rotation)

    return changed


def _exchanged(samples: Samples, rng: np.random.Generator) -> Samples:
    del rng
    names = samples.labels["landmark"]
    a, b = list(dict.fromkeys(names.tolist()))[:2]
    new = np.where(names == a, b, np.where(names == b, a, names))
    return replace(samples, labels={**samples.labels, "landmark": new})


def _shifted_labels(samples: Samples, rng: np.random.Generator) -> Samples:
    del rng
    kept = np.arange(len(samples) - 1)
    left = samples.take(kept)
    names = samples.labels["landmark"][kept + 1]
    return replace(left, labels={**left.labels, "landmark": names})


def _reused(samples: Samples, rng: np.random.Generator) -> Samples:
    """Two placements that were given one label."""
    del rng
    names = samples.labels["placement"]
    a, b = list(dict.fromkeys(names.tolist()))[:2]
    return replace(samples, labels={**samples.labels, "placement": np.where(names == b, a, names)})


def _duplicated(samples: Samples, rng: np.random.Generator) -> Samples:
    del rng
    return samples.take(np.tile(np.arange(len(samples)), 3))


def _gross(samples: Samples, rng: np.random.Generator) -> Samples:
    """Three of ten rows: another posture's readings, or seen somewhere else."""
    rows = rng.permutation(len(samples))[: round(0.3 * len(samples))]
    if samples.position is not None:
        position = samples.position.copy()
        position[rows] += rng.uniform(-0.05, 0.05, (len(rows), 3))
        return replace(samples, position=position)
    q = samples.q.copy()
    q[rows] += rng.normal(0.0, 0.03, (len(rows), q.shape[1]))
    return replace(samples, q=q)


def _scaled(factor: float) -> Callable[[Artefact], Artefact]:
    def changed(artefact: Artefact) -> Artefact:
        marks = {
            name: replace(mark, position=factor * mark.position)
            for name, mark in artefact.landmarks.items()
        }
        return replace(artefact, landmarks=marks)

    return changed


def _mirrored(artefact: Artefact) -> Artefact:
    marks = {
        name: replace(mark, position=mark.position * [-1.0, 1.0, 1.0])
        for name, mark in artefact.landmarks.items()
    }
    return replace(artefact, landmarks=marks)


CORRUPTIONS: Final = (
    Corruption("a joint's sign", _joint(1, np.negative), said="counts the other way"),
    Corruption("two joints swapped", _swapped_joints, said="exchanged"),
    Corruption("a joint off by 90°", _joint(2, lambda q: q + np.pi / 2), said="too much"),
    Corruption("a joint off by a turn", _joint(2, lambda q: q + 2 * np.pi), said="none: harmless"),
    Corruption("degrees for radians", _all_joints, said="degrees"),
    Corruption("a stuck encoder", _joint(3, lambda q: np.full_like(q, q.mean())), said="encoder"),
    Corruption("a count lost per turn", _joint(2, lambda q: q * (1 - 1 / 4096)), said="gain"),
    Corruption("mm for m (instrument)", _seen(mm), needs="position", said="mm"),
    Corruption(
        "instrument scaled by 2 %", _seen(lambda p: 1.02 * p), needs="position", said="times"
    ),
    Corruption("instrument moved half-way", _seen(_moved), needs="position", said="moved"),
    Corruption("poses inverted", _inverted, needs="rotation", said="inverted"),
    Corruption("quaternion order", _reordered, needs="rotation", said="w x y z"),
    *(Corruption(f"{n} rows late", _late(n), needs="position", said="late") for n in (1, 3, 20)),
    Corruption("landmarks swapped", _exchanged, needs="landmark", said="exchanged"),
    Corruption("landmarks one row late", _shifted_labels, needs="landmark", said="one row"),
    Corruption("a placement's label reused", _reused, needs="placement", said="moved"),
    Corruption("duplicated rows", _duplicated, said="twice"),
    Corruption("30 % gross outliers", _gross, said="outliers"),
    Corruption("artefact in mm", artefact=_scaled(1000.0), said="mm"),
    Corruption("artefact scaled by 2 %", artefact=_scaled(1.02), said="times"),
    Corruption("artefact mirrored", artefact=_mirrored, said="mirror"),
)
