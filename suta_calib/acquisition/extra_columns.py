"""Numbers that a device sends beside its joints, as of an accelerometer: whether a rest is one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from suta_calib.acquisition.averaging import Average
from suta_calib.arrays import FloatArray
from suta_calib.terms import Term


class ExtraColumns:
    """Looks at them at each rest.

    Args:
        names: of the columns, in the order of `Reading.extra`.
        kinds: of observation that read them; each says what it cannot use.
        earlier: gives the means (n, m) of columns at the rests that are kept so far.
    """

    def __init__(
        self,
        names: Sequence[str],
        kinds: Sequence[type[Term]] = (),
        earlier: Callable[[Sequence[str]], FloatArray] = lambda names: np.zeros((0, len(names))),
    ) -> None:
        self.names, self._kinds, self._earlier = tuple(names), tuple(kinds), earlier
        self._scatter: list[FloatArray] = []

    def refusal(self, average: Average) -> str:
        """Why the numbers of a rest cannot be used; empty where they can."""
        for name, mean_and_std in average.extra.items():
            # Share of the readings of a rest that must be numbers near the others. A cable loses a
            # few of them; a sensor that changed its unit or was knocked during the rest spoils
            # many.
            if mean_and_std.share < 0.8:
                return (
                    f"{1.0 - mean_and_std.share:.0%} of the readings of {name} are no numbers, or "
                    "far from the others. Check the sensor and its cable"
                )
        scatter = np.array([mean_and_std.std for mean_and_std in average.extra.values()])
        # Rests after which it is known what is usual.
        if len(self._scatter) >= 3:
            usual = np.median(self._scatter, axis=0)
            # A rest between two steps of a coarse sensor scatters, and one on a step does not.
            # A standard deviation of so many times the usual one is no chance: of 20 readings it is
            # known to 16 %, and sensors scatter by up to twice as much where a motor hums.
            most = [
                max(5.0 * u, f.step) for u, f in zip(usual, average.extra.values(), strict=True)
            ]
            for k in np.flatnonzero(scatter > most)[:1]:
                return (
                    f"{self.names[k]} scattered by {scatter[k]:.3g}, at the other rests by "
                    f"{usual[k]:.3g}: the sensor was shaken. Let it come to rest"
                )
        for kind in self._kinds:
            of_kind = [average.extra[name] for name in kind.sent]
            mean, std = (np.array(column) for column in list(zip(*of_kind, strict=True))[:2])
            if why := kind.refused_rest(mean, std, self._earlier(kind.sent)):
                return why
        self._scatter.append(scatter)
        return ""
