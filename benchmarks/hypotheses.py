"""Power and false alarms of every hypothesis, on simulated data of which the truth is known.

Every hypothesis can spoil sound data (`Hypothesis.spoil`). Here that is done with new noise again
and again, and it is counted how often the hypothesis is what is named first. Where the fault is in
the numbers of the samples it is also made smaller, down to the smallest part that is still named in
90 % of the sets. Sound data of every sort are examined too, and whatever is found is a false alarm.

The figures are kept in ``results/hypotheses.json``. The page "What an answer is tested for" of the
docs is made of it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

ROOT: Final = Path(__file__).resolve().parents[1]
RESULTS: Final = ROOT / "benchmarks" / "results" / "hypotheses.json"
sys.path.insert(0, str(ROOT / "tests" / "support"))

from sound_sets import SORTS, Sound, scene_of  # noqa: E402

from suta_calib import SutaCalibError  # noqa: E402
from suta_calib.registry import shipped  # noqa: E402
from suta_calib.terms import MeasuredPoses, Term  # noqa: E402
from suta_calib.trust import (  # noqa: E402
    Hypothesis,
    Pattern,
    Reinterpretation,
    examine,
    explaining_reading,
    known_hypotheses,
)

# What is there or not, and has no size.
UNSIZED: Final = (Pattern, Reinterpretation)
# Parts of the fault that are tried, one after another, and share of the sets that must be named.
PARTS: Final = (0.7, 0.5, 0.35, 0.25, 0.18, 0.125, 0.09, 0.06, 0.045, 0.03)
NAMED: Final = 0.9


def is_named(hypothesis: Hypothesis, sound: Sound, term: Term) -> bool | None:
    """Whether a hypothesis is what is said first of data; None where nothing can be solved."""
    try:
        if isinstance(hypothesis, Reinterpretation) and not hypothesis.needs_arm:
            return is_refused(sound, term)
        if not isinstance(hypothesis, UNSIZED):
            findings = examine(sound.examined(term))
            return bool(findings) and findings[0].hypothesis is hypothesis
        answer = sound.fitted(term)
        if isinstance(hypothesis, Pattern):
            return any(True for _ in hypothesis.matches(answer))
        reading = explaining_reading(answer)
        return reading is not None and reading.hypothesis is hypothesis
    except SutaCalibError:
        return None
    except AssertionError:
        return False


def is_refused(sound: Sound, term: Term) -> bool:
    """Whether the command for poses refuses them."""
    try:
        sound.examined(term)
    except SutaCalibError:
        return True
    return False


def spoilt(hypothesis: Hypothesis, sound: Sound, seed: int, part: float) -> Term | None:
    """Data with a part of a fault; None where it cannot be made smaller."""
    before = sound.make(seed)
    after: Term = hypothesis.spoil(before, sound.values, np.random.default_rng(seed)).data
    return after if part == 1.0 else weakened(before, after, part)


def weakened(before: Term, after: Term, part: float) -> Term | None:
    """A term between two, by the numbers of their samples; None where other things differ."""
    a, b = before.poses, after.poses
    same = len(a) == len(b) and all(
        np.array_equal(a.samples.labels[name], values) for name, values in b.samples.labels.items()
    )
    changed: dict[str, Any] = {}
    for name in ("q", "position", "pixels") if same else ():
        first, second = getattr(a.samples, name), getattr(b.samples, name)
        if first is not None and not np.array_equal(first, second, equal_nan=True):
            changed[name] = first + part * (second - first)
    if a.samples.rotation is not None and changed:
        changed["rotation"] = _turned(a.samples.rotation, b.samples.rotation, part)
    samples = replace(b.samples, **changed)
    if isinstance(a, MeasuredPoses) and isinstance(b, MeasuredPoses):
        position = a.position + part * (b.position - a.position)
        rotation = _turned(a.rotation, b.rotation, part)
        return after.over_poses(MeasuredPoses(rotation, position, samples, exact=b.exact))
    return after.over_poses(b.with_samples(samples)) if changed else None


def _turned(a: Any, b: Any, part: float) -> Any:
    turn = Rotation.from_matrix(np.swapaxes(a, 1, 2) @ b)
    return a @ Rotation.from_rotvec(part * turn.as_rotvec()).as_matrix()


def power(hypothesis: Hypothesis, sets: int) -> dict[str, Any]:
    """How often a hypothesis is named, and the smallest part of the fault at which it is."""
    sound = scene_of(hypothesis.name)

    def named(part: float, enough: float) -> int | None:
        count, missed = 0, 0
        for seed in range(sets):
            try:
                term = spoilt(hypothesis, sound, seed, part)
            except SutaCalibError:
                return None
            if term is None:
                return None
            yes = is_named(hypothesis, sound, term)
            if yes is None:
                return None
            count, missed = count + yes, missed + (not yes)
            if missed > (1.0 - enough) * sets:
                break
        return count

    count, smallest = named(1.0, 0.0), None
    if not isinstance(hypothesis, UNSIZED) and count is not None and count >= NAMED * sets:
        smallest = 1.0
        for part in PARTS:
            at_part = named(part, NAMED)
            if at_part is None:
                smallest = None
                break
            if at_part < NAMED * sets:
                break
            smallest = part
    return {"sets": sets, "named": count, "smallest_part": smallest}


def false_alarms(sets: int, progress: Callable[[str], None]) -> dict[str, Any]:
    """What is said of sound data of every sort, by hypothesis."""
    alarms: Counter[str] = Counter()
    total = 0
    for name, sound in SORTS.items():
        progress(f"sound data: {name}")
        for seed in range(1000, 1000 + sets):
            total += 1
            term = sound.make(seed)
            alarms.update(f.hypothesis.name for f in examine(sound.examined(term)))
            answer = sound.fitted(term)
            for hypothesis in shipped(known_hypotheses()).values():
                if isinstance(hypothesis, Pattern) and hypothesis.applies(answer.problem):
                    alarms.update(hypothesis.name for _ in hypothesis.matches(answer))
    return {"sets": total, "by_hypothesis": dict(sorted(alarms.items()))}


def main() -> None:
    """Measure all or some of the hypotheses, and write the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=10, help="Spoilt sets of each hypothesis.")
    parser.add_argument("--sound", type=int, default=50, help="Sound sets of each sort; 0: none.")
    parser.add_argument("--only", action="append", metavar="NAME", help="Only this hypothesis.")
    parser.add_argument("--output", type=Path, default=RESULTS)
    asked = parser.parse_args()
    kept = json.loads(asked.output.read_text("utf-8")) if asked.output.exists() else {}
    measured: dict[str, Any] = {"power": {}, "false_alarms": {}} | kept

    def write(said: str) -> None:
        print(said, flush=True)
        text = json.dumps(measured, indent=1, sort_keys=True)
        asked.output.write_text(text + "\n", encoding="utf-8")

    for name, hypothesis in shipped(known_hypotheses()).items():
        if asked.only and name not in asked.only:
            continue
        sets = max(
            asked.sets // (2 if isinstance(hypothesis, Pattern | Reinterpretation) else 1), 1
        )
        measured["power"][name] = power(hypothesis, sets)
        write(f"{name}: {measured['power'][name]}")
    if asked.sound:
        measured["false_alarms"] = false_alarms(asked.sound, print)
        write(str(measured["false_alarms"]))


if __name__ == "__main__":
    main()
