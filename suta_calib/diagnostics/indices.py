"""How well conditioned a data set is, as single numbers: the observability indices O1 to O5."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from suta_calib.arrays import FloatArray


@dataclass(frozen=True)
class Indices:
    """Observability indices of L parameters from m samples; larger is better.

    All are dimensionless: σ1 ≥ … ≥ σL are the singular values of the Jacobian with residuals in
    units of their noise and parameters in units of their plausible range. Compared and proven in
    Sun, Hollerbach (2008), doi:10.1109/ROBOT.2008.4543393.

    Attributes:
        o1: (σ1 … σL)^(1/L) / √m, D-optimality; Borm, Menq (1991),
            doi:10.1177/027836499101000106.
        o2: σL / σ1, the inverse condition number; Driels, Pathre (1990).
        o3: σL, E-optimality; Nahvi, Hollerbach, Hayward (1994).
        o4: σL² / σ1, noise amplification; Nahvi, Hollerbach (1996).
        o5: 1 / Σ 1/σ, A-optimality; Sun, Hollerbach (2008).
    """

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float

    @classmethod
    def of(cls, singular_values: FloatArray, samples: int) -> Indices:
        """Indices of singular values (L,), any order; all zero where one is zero or there is none.

        Args:
            singular_values: of the scaled, whitened Jacobian of the parameters in question.
            samples: number of measured poses, m.
        """
        s = np.asarray(singular_values, dtype=float)
        if not len(s) or s.min() <= 0.0 or samples < 1:
            return cls(0.0, 0.0, 0.0, 0.0, 0.0)
        least, most = float(s.min()), float(s.max())
        geometric_mean = float(np.exp(np.mean(np.log(s))))
        return cls(
            geometric_mean / samples**0.5,
            least / most,
            least,
            least**2 / most,
            1.0 / float(np.sum(1.0 / s)),
        )

    def as_dict(self) -> dict[str, float]:
        """By the names of the literature, ``O1`` … ``O5``."""
        return {name.upper(): value for name, value in asdict(self).items()}
