"""The faults of one arm of two are named as that arm's, and sound data of both are silent."""

from __future__ import annotations

import re

import numpy as np
import pytest

from suta_calib.registry import shipped
from suta_calib.trust import Hypothesis, Pattern, Reinterpretation, Rule, examine, known_hypotheses
from suta_calib.trust.changes import changes
from suta_calib.trust.rereading import explaining_reading
from tests.support.two_armed import ROBOT, both_hands, examined, fitted, spoilt

# What an instrument that sees both hands cannot have, what is refused in words before anything is
# solved, what is the same as no fault (a target's place on a free tip), and what one arm's data
# cannot have by themselves (the geometry that both share).
OTHER_DATA = {
    "exchanged targets",
    "given pose",
    "landmark names",
    "mirrored artefact",
    "mirrored survey",
    "misread observations",
    "stretched body",
    "unit of a length",
    "unit of positions",
    "unit of the joints",
    "unknown mount",
}
FAULTS = {
    name: h
    for name, h in shipped(known_hypotheses()).items()
    if h.needs_arm and name not in OTHER_DATA
}
REREAD = {name: h for name, h in FAULTS.items() if isinstance(h, Reinterpretation)}
PATTERNS = {name: h for name, h in FAULTS.items() if isinstance(h, Pattern)}
EXAMINED = {name: h for name, h in FAULTS.items() if name not in REREAD and name not in PATTERNS}
# What explains data as well: a gain is the travel of an encoder.
ALIKE = {"encoder travel": "joint error"}
QUICK = {"sign of a joint", "rows reversed", "moved between", "missed count"}
ARMS = [*enumerate(ROBOT.chains)]


def names_arm(sentence: str, side: str) -> bool:
    """Whether it names a joint, a file or the chain of this arm, and none of the other's."""
    named = set(re.findall(r"\b(left|right)(?:_\d|\.csv|\b(?!-))", sentence))
    return named == {side}


@pytest.mark.parametrize(("arm", "side"), ARMS)
@pytest.mark.parametrize("hypothesis", EXAMINED.values(), ids=EXAMINED)
def test_a_fault_of_one_arm_is_sized_and_named_as_its_own(
    hypothesis: Hypothesis, arm: int, side: str
) -> None:
    fault, terms = spoilt(hypothesis, arm)
    first, *_ = examine(examined(terms))
    assert first.hypothesis.name in (hypothesis.name, ALIKE.get(hypothesis.name)), first.sentence
    known = np.isfinite(fault.size) & (first.evidence.std > 0)
    off = np.abs(np.abs(first.evidence.size) - np.abs(fault.size))[known]
    assert np.all(off < 3.5 * first.evidence.std[known]), first.sentence
    # A base is that of both.
    if not hypothesis.name.startswith("base creep"):
        assert names_arm(first.sentence, side), first.sentence


@pytest.mark.parametrize(
    ("hypothesis", "arm", "side"),
    [
        pytest.param(
            h, k, side, marks=() if n in QUICK and k else pytest.mark.slow, id=f"{n}-{side}"
        )
        for n, h in REREAD.items()
        for k, side in ARMS
    ],
)
def test_one_arm_that_is_misread_is_read_right(
    hypothesis: Reinterpretation, arm: int, side: str
) -> None:
    _, terms = spoilt(hypothesis, arm)
    reading = explaining_reading(fitted(terms))
    assert reading is not None
    assert reading.hypothesis is hypothesis, reading.description
    assert Rule().far_better * reading.after < reading.before
    if hypothesis.name != "rows of a file late":
        assert names_arm(reading.description, side), reading.description


@pytest.mark.parametrize(("arm", "side"), ARMS)
@pytest.mark.parametrize("hypothesis", PATTERNS.values(), ids=PATTERNS)
def test_a_pattern_in_one_arms_data_is_found(hypothesis: Pattern, arm: int, side: str) -> None:
    fault, terms = spoilt(hypothesis, arm)
    (sentence,) = hypothesis.matches(fitted(terms))
    assert fault.effect in sentence
    if hypothesis.name != "rounded":
        assert names_arm(sentence, side), sentence


def test_a_joint_of_another_chain_is_no_dead_joint() -> None:
    """The columns of the other arm's joints hold zeros, which are no readings."""
    solution = fitted(both_hands(2)[0])
    for hypothesis in PATTERNS.values():
        assert not [*hypothesis.matches(solution)]


@pytest.mark.parametrize("seed", [3, 4])
def test_sound_data_of_two_arms_are_silent(seed: int) -> None:
    answer = examined(both_hands(seed)[0])
    assert not examine(answer)
    assert not changes(answer)
