"""A depth camera whose depths are all too long, by one factor or by one length.

Half a per cent to three per cent is usual of cameras as they are sold, and some millimetres. All
coordinates along a ray are too long together. Against the lengths of the arm, or of a board, the
data tell it; where only the depth carries the scale, nothing does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Level
from suta_calib.errors import SamplesError
from suta_calib.terms.depth_term import DepthTerm
from suta_calib.trust import (
    AddedVariable,
    Effect,
    Evidence,
    Examination,
    SpoiltData,
    Truth,
    weigh_effects,
)
from suta_calib.trust.examination import STEP
from suta_calib.trust.simulated_faults import with_columns
from suta_calib.units import mm, text, with_std

SCALE, OFFSET = "scale", "offset"


@dataclass(frozen=True)
class _Camera:
    """Which camera, and its middle distance, m."""

    name: str
    away: float


class DepthCamera(AddedVariable):
    """``seen = (1 + s) z``, or ``seen = z + c z / |z|``, for all points of one camera."""

    name = "depth camera"
    about = "All depths of a depth camera are too long or too short."
    applies_to = (DepthTerm,)
    before_others = True
    by_itself = True

    def weigh(self, answer: Examination) -> list[Evidence]:
        """Beside what the job estimates: lengths that may be anything hide a scale."""
        estimated = {answer.solution.problem.names[k] for k in answer.solution.free.tolist()}
        followed = [k for k, name in enumerate(answer.problem.names) if name in estimated]
        fit = answer.everything.only(np.array(followed, dtype=np.intp))
        return weigh_effects(fit, self.effects(answer))

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """A scale and an offset for each camera."""
        terms = answer.problem.terms
        cameras = dict.fromkeys(t.sees for t in terms if isinstance(t, DepthTerm))
        for camera in cameras:
            mine = [isinstance(t, DepthTerm) and t.sees == camera for t in terms]
            seen = [t.in_eye for t in terms if isinstance(t, DepthTerm) and t.sees == camera]
            away = float(np.median(np.linalg.norm(np.concatenate(seen), axis=1)))
            about = _Camera("" if camera == "default" else f" {camera}", away)
            for what in (SCALE, OFFSET):
                # A longer measurement is explained by an expectation that is as much shorter.
                longer = [
                    _longer(t, what, -STEP) if of_camera else t
                    for t, of_camera in zip(terms, mine, strict=True)
                ]
                yield Effect(what, answer.by_terms(longer), about=about)

    def level(self, evidence: Evidence) -> Level:
        """``bad`` from half a per cent on: X is off by millimetres; beyond a tenth no scale."""
        camera: _Camera = evidence.effect.about
        scale = evidence.effect.name == SCALE
        by = abs(float(evidence.size[0])) / (1.0 if scale else camera.away)
        most, much, least = 0.1, 5e-3, 1e-3
        if not least < by < most:
            return "good"
        return "bad" if by > much else "care"

    def sentence(self, evidence: Evidence) -> str:
        """By how much, what it means, and what to do."""
        camera: _Camera = evidence.effect.about
        size, std = float(evidence.size[0]), float(evidence.std[0])
        long = "long" if size > 0 else "short"
        if evidence.effect.name == OFFSET:
            by = with_std(abs(size), std, "m")
            much, remedy = by, f"add {mm(-size):.2f} mm to every depth along its ray"
            return (
                f"All depths of the depth camera{camera.name} seem to be {much} too {long}, at "
                f"every distance. The pose of the camera is wrong by about as much. If the camera "
                f"cannot be adjusted, {remedy}."
            )
        off = text(abs(size) * camera.away, "m", with_unit=True)
        return (
            f"All depths of the depth camera{camera.name} seem to be {abs(size):.2%} ± {std:.2%} "
            f"too {long}: {off} at {mm(camera.away):.0f} mm. The pose of the camera is wrong by "
            f"about as much. Multiply x, y and z of all points by {1.0 / (1.0 + size):.4f}, or "
            "give the camera's driver this scale. If the depths are right, all lengths of the arm, "
            "and of the board if there is one, are off by this factor: check them."
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """All depths 1.5 % too long, or too short."""
        if not isinstance(data, DepthTerm):
            raise SamplesError(f"the kind {data.kind}", "what a depth camera sees")
        size = float(rng.choice([-0.015, 0.015]))
        return SpoiltData(_longer(data, SCALE, size), np.array([size]), SCALE)


def _longer(term: Any, what: str, by: float) -> Any:
    """The same with all depths longer by a ratio, or by a length, m."""
    points: FloatArray = term.in_eye
    if what == OFFSET:
        length = np.linalg.norm(points, axis=1, keepdims=True)
        return with_columns(term, position=points + by * points / np.where(length > 0, length, 1.0))
    return with_columns(term, position=points * (1.0 + by))
