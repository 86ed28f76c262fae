"""How far learned noise levels and prior sizes may be from given ones."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class WeightOptions:
    """What is believed of noise levels and priors beforehand: logarithmic standard deviations.

    Attributes:
        stated: of a noise level that the job states; a data sheet is right within a factor of two.
        assumed: of one that nobody stated.
        common: of the factor common to all priors; a guess is right within one of ten.
        between: of a group's factor about the common one: whoever guesses one size too small is
            likely to guess the others so. Free factors would let groups of few parameters run away.
        camera: of the factor on what is known of a camera: what its calibration says of itself, or
            what calibrations usually are, is right within one of three.
    """

    stated: float = math.log(2.0)
    assumed: float = math.log(10.0)
    common: float = math.log(10.0)
    between: float = 0.2
    camera: float = math.log(3.0)
