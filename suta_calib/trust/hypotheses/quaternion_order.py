"""Quaternions whose numbers stand in another order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from suta_calib.geometry.numbers import quaternion_from_rotation, rotation_from_quaternion
from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust.sample_readings import Change, MisreadSamples

DESCRIPTION = "the quaternions' order is w x y z"


class QuaternionOrder(MisreadSamples):
    """Numbers that were read as x y z w are w x y z."""

    name: ClassVar[str] = "order of quaternions"
    about: ClassVar[str] = "The four numbers of quaternions stand in another order."
    precedence: ClassVar[int] = 33

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """One, where orientations were measured."""
        samples = [term.poses.samples for term in terms]
        if any(s.position is not None and s.rotation is not None for s in samples):
            yield DESCRIPTION, _w_first

    def fault(self, term: Term) -> tuple[str, Samples]:
        """Quaternions w x y z, read as x y z w."""
        samples = term.poses.samples
        assert samples.rotation is not None
        x, y, z, w = quaternion_from_rotation(samples.rotation).T
        rotation = rotation_from_quaternion(np.column_stack([w, x, y, z]))
        return DESCRIPTION, replace(samples, rotation=rotation)


def _w_first(samples: Samples) -> Samples:
    """Numbers that stand as x y z w were w x y z."""
    if samples.rotation is None:
        return samples
    x, y, z, w = quaternion_from_rotation(samples.rotation).T
    return replace(samples, rotation=rotation_from_quaternion(np.column_stack([y, z, w, x])))
