"""How far to trust a certification."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from suta_calib.assessment import Assessment
from suta_calib.certification.result import Certification

# What FORMATS of the field expects on every top.
TOUCHES: Final = 5
# A ground so many times rougher than a touch deserves a word.
ROUGH: Final = 3.0
# A turn that all landmarks share is another way of counting, not a fault (rad).
OTHER_FRONT: Final = float(np.radians(1.0))
MOST_LINES: Final = 6


def verdict_on(found: Certification) -> Assessment:
    """Bad where a landmark is damaged; care where something must be known."""
    largest = max(mark.sigma for mark in found.landmarks)
    sentence = (
        f"{len(found.landmarks)} landmarks certified from {found.points} points; largest standard "
        f"deviation of a coordinate {1e3 * largest:.4f} mm"
    )
    if found.damaged:
        sentence = f"{', '.join(found.damaged)} damaged, or touched wrongly"
    caution = [*_touches(found), *_noise(found), *_frame(found), *_drawing(found), *_spacers(found)]
    return Assessment.of(sentence, bad=tuple(_faults(found)), care=caution)


def _faults(found: Certification) -> Iterator[str]:
    for fault in found.faults:
        yield (
            f"{fault.landmark}: {fault.what} is {1e3 * fault.size:.4f} mm off; "
            f"{1e3 * fault.limit:.4f} mm would be {_limit(found)}."
        )


def _limit(found: Certification) -> str:
    if found.tolerance is not None:
        return "the tolerance with the measurement's uncertainty"
    return "as much as the touches and the other pillars explain"


def _touches(found: Certification) -> Iterator[str]:
    planes = {"ground": found.ground, "side": found.side}
    for name, plane in planes.items():
        if plane is not None and plane.wrong_touches:
            yield f"Touches of the {name} that the others refute: {_lines(plane.wrong_touches)}."
    for mark in found.landmarks:
        if mark.wrong_touches:
            yield (
                f"A touch of the top of {mark.name} does not fit the others "
                f"({_lines(mark.wrong_touches)}): the probe slipped, or the top is dented there."
            )
    few = [m.name for m in found.landmarks if m.touches + len(m.wrong_touches) < TOUCHES]
    if few:
        yield f"Fewer than five touches on the top of {', '.join(few)}: a wrong one may not show."


def _lines(lines: tuple[int, ...]) -> str:
    shown = ", ".join(map(str, lines[:MOST_LINES]))
    return f"line{'s' * (len(lines) > 1)} {shown}{', …' * (len(lines) > MOST_LINES)}; not used"


def _noise(found: Certification) -> Iterator[str]:
    if found.stated_noise is not None and found.noise > found.stated_noise:
        yield (
            f"Touches scatter by {1e6 * found.noise:.2f} µm, more than the "
            f"{1e6 * found.stated_noise:.2f} µm stated: the larger is used."
        )
    if found.ground.rms > ROUGH * found.noise:
        yield (
            f"The ground is rougher than the tops ({1e3 * found.ground.rms:.4f} mm RMS): heights "
            "count from its mean plane, and their uncertainty allows for it."
        )


def _frame(found: Certification) -> Iterator[str]:
    if found.heading == "farthest landmark":
        yield "No side plane was touched: the direction of x is a convention."
    without = [m.name for m in found.landmarks if m.yaw is None]
    if without:
        which = "any landmark" if len(without) == len(found.landmarks) else ", ".join(without)
        yield f"No flats were touched on {which}: no rotation of the seated tip there."


def _drawing(found: Certification) -> Iterator[str]:
    comparison = found.comparison
    if comparison is None:
        return
    if comparison.not_drawn:
        yield f"Not in the drawing: {', '.join(comparison.not_drawn)}."
    if comparison.not_touched:
        yield f"In the drawing, but not touched: {', '.join(comparison.not_touched)}."
    turns = comparison.turn[np.isfinite(comparison.turn)]
    common = float(np.angle(np.mean(np.exp(1j * turns)))) if len(turns) else 0.0
    if abs(common) > OTHER_FRONT:
        yield (
            f"All seated tips are turned by {np.degrees(common):.1f}° from the drawing: is the "
            "front flat another one there? --front-deg says where it is in the tip's frame."
        )
    # What else a registration has to say is about too few points to use it for.
    yield from (note for note in comparison.registration.assessment.notes if "times as far" in note)


def _spacers(found: Certification) -> Iterator[str]:
    for spacer in found.spacers:
        limit = found.coverage_factor * spacer.std + (found.tolerance or 0.0)
        if spacer.deviation is not None and abs(spacer.deviation) > limit:
            part = 1e6 * spacer.deviation / (spacer.nominal or 1.0)
            yield (
                f"Spacer {spacer.name} measures {1e3 * spacer.deviation:+.4f} mm from its nominal "
                f"({part:+.0f} µm/m): look for the instrument's scale or the temperature."
            )
