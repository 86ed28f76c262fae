"""The answer against the output files that came with a set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.stereotactic.cis_files import Output1
from suta_calib.stereotactic.data import read_given_output1, read_given_output2
from suta_calib.stereotactic.solve import StereotacticResult


@dataclass(frozen=True, eq=False)
class StereotacticErrors:
    """Distances of the answer from the given one; None where that file is not there.

    Attributes:
        expected: (N_frames, N_C) of the expected EM markers, m.
        em_post: of the EM post, m.
        optical_post: of the optical post, m.
        navigation: (N_frames,) of the tips in CT, m.
    """

    expected: FloatArray | None = None
    em_post: float | None = None
    optical_post: float | None = None
    navigation: FloatArray | None = None

    @property
    def empty(self) -> bool:
        """Whether nothing was given to compare with."""
        return self.expected is None and self.navigation is None


@dataclass(frozen=True, eq=False)
class GivenOutputs:
    """Output files that stand beside the inputs; None where there is none.

    Attributes:
        output1: of the first assignment.
        output2: (N_frames, 3) tips in CT, m.
    """

    output1: Output1 | None
    output2: FloatArray | None


def read_given(result: StereotacticResult) -> GivenOutputs:
    """Read ``-output1.txt`` and, where there is a navigation, ``-output2.txt`` if they are there.

    Raises:
        SamplesError: one is malformed or its counts are not those of the inputs.
    """
    prefix = result.data.prefix
    output1 = read_given_output1(prefix, result.data)
    return GivenOutputs(output1, read_given_output2(prefix, result.data))


def compare(result: StereotacticResult, given: GivenOutputs) -> StereotacticErrors:
    """Distances of the result from what is given."""
    other, found = given.output1, result.navigation
    navigation = None
    if found is not None and given.output2 is not None:
        navigation = np.asarray(np.linalg.norm(found.ct - given.output2, axis=1))
    if other is None:
        return StereotacticErrors(navigation=navigation)
    return StereotacticErrors(
        np.asarray(np.linalg.norm(result.expected - other.expected, axis=-1)),
        float(np.linalg.norm(result.em_pivot.post - other.em_post)),
        float(np.linalg.norm(result.optical_pivot.post - other.optical_post)),
        navigation,
    )
