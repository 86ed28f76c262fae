"""Common parts of kinds whose samples are at places of unknown pose."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.model.parameters import Parameter
from suta_calib.terms.block import LEARNT, Block, Noise, Residual, grouped
from suta_calib.terms.external_frame import pose_parameters
from suta_calib.terms.poses import PoseSource
from suta_calib.terms.term import Term


@dataclass(frozen=True, eq=False, repr=False)
class PlaceTerm(Term):
    """Samples at places by one label column, each place with unknowns of its own.

    A row has the unknowns of its place, in the order of `place_keys`.

    Attributes:
        place_keys: of the unknowns of one place: some of those of a pose.
        noise: scatter and robustness of one component, m.
    """

    place_keys: ClassVar[tuple[str, ...]]
    has_angles = False

    noise: Noise = LEARNT

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """Those of every place."""
        return tuple(p for name in self.places[0] for p in self._of_place(name))

    def _of_place(self, name: str) -> list[Parameter]:
        every = pose_parameters(f"{self.place_unknown}[{name}]")
        return [p for p in every if p.key in self.place_keys]

    def _blocks(
        self,
        name: str,
        size: int,
        residual: Residual,
        data: FloatArray | None = None,
        common: int = 0,
    ) -> tuple[Block, ...]:
        """The block of a residual of data, ``common`` own unknowns, and those of a row's place."""
        width = (len(self.own_parameters) - common) // max(len(self.places[0]), 1)
        of_place = common + width * self.places[1][:, None] + np.arange(width)
        own_columns = np.hstack([np.tile(np.arange(common), (len(of_place), 1)), of_place])
        data = np.zeros((len(self.poses), 0)) if data is None else data
        samples = self.poses.samples
        labels = samples.labels.get(self.place, samples.origin)
        return (Block.per_sample(name, "m", size, residual, own_columns, data, self.noise, labels),)

    def _there(self, values: Mapping[str, float], poses: PoseSource) -> FloatArray:
        """(n, keys) unknowns of the place of each sample."""
        names, which = grouped(poses.samples.labels[self.place])
        keys = [[f"{self.place_unknown}[{n}].{key}" for key in self.place_keys] for n in names]
        of_place = [[values[key] for key in row] for row in keys]
        return np.reshape(of_place, (len(names), len(self.place_keys)))[which]

    def _by_place(self) -> Iterator[tuple[str, IntArray]]:
        """Every place, and the rows there."""
        names, which = self.places
        for k, name in enumerate(names):
            yield name, np.flatnonzero(which == k)
