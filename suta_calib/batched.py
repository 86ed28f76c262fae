"""A CasADi function evaluated on many rows at once, NumPy arrays in, NumPy arrays out.

Calling a CasADi function converts every argument; its buffer interface does not. One `Batched`
binds the arrays once and then costs only the arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray


class Batched:
    """``function`` mapped over ``n`` rows.

    Args:
        function: a CasADi function of column vectors.
        n: number of rows.
        shared: indices of the inputs that are the same for every row (given once, not n times).

    Attributes:
        inputs: one writable array per input, (n, size), or (size,) for a shared one. Fill them
            in place, then call.
        outputs: one array per output, (n, structural nonzeros in CasADi's column order),
            overwritten by every call.
    """

    def __init__(self, function: Any, n: int, shared: Sequence[int] = ()) -> None:
        self._buffer, self._trigger = _mapped(function, n, tuple(shared)).buffer()
        self.inputs: list[FloatArray] = []
        for i in range(function.n_in()):
            size = function.nnz_in(i)
            array = np.zeros(size) if i in shared else np.zeros((n, size))
            self.inputs.append(array)
            if array.size:
                self._buffer.set_arg(i, memoryview(array.reshape(-1).data))
        self.outputs: list[FloatArray] = []
        for i in range(function.n_out()):
            array = np.zeros((n, function.nnz_out(i)))
            self.outputs.append(array)
            if array.size:
                self._buffer.set_res(i, memoryview(array.reshape(-1).data))

    def __call__(self) -> list[FloatArray]:
        """Evaluate at what `inputs` hold now; the answer is `outputs`."""
        self._trigger()
        return self.outputs


# The same terms are solved again and again, over other unknowns or simulated readings.
@lru_cache(maxsize=128)
def _mapped(function: Any, n: int, shared: tuple[int, ...]) -> Any:
    return function.map(function.name() + "_rows", "serial", n, list(shared), [])
