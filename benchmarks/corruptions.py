"""Sound jobs, corrupted as it happens in laboratories: refused, warned, or silently wrong?

The shipped jobs and a job of every kind of observation, with bounds and with priors (`sound_jobs`),
are corrupted in every way of `what_goes_wrong`: the files are written as somebody would have
written them, read and calibrated. All of it is simulated, so the truth is known. What an answer
states of its tip is what its covariance says, and what it says of parameters that are held: how the
tip moves with them, for as much as they are off in truth. An answer is *silently wrong* if it is
usable, says nothing that the sound job's answer does not say too, and its tip is farther off the
truth (after registration, in postures it never saw) than three times what it states. Sound jobs are
judged by the same rule: *overstated*, or a *false alarm* where they are refused or warned of
anything but what is held.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from types import MappingProxyType
from typing import Final

import numpy as np
from rich.console import Console
from rich.progress import Progress
from sound_jobs import KINDS, SUTA, Sound, has, sound_jobs
from tables import number_table
from what_goes_wrong import CORRUPTIONS, Corruption
from wrong_samples import URDF

from suta_calib import (
    CalibrationJob,
    Samples,
    Solution,
    SutaCalibError,
    Term,
    TrackedPoint,
)
from suta_calib.arrays import FloatArray
from suta_calib.geometry import register_points, rms_length
from suta_calib.measurements import read_artefact, write_artefact
from suta_calib.registry import shipped
from suta_calib.simulation import Simulation, write_simulation
from suta_calib.terms import KINDS as KINDS_BY_NAME
from suta_calib.trust import Hypothesis, known_hypotheses
from suta_calib.units import mm

# The two arms of the tests are those of the study.
sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.support.two_armed import ROBOT, both_hands, judged_hands, spoilt
from tests.support.two_armed import tip_errors as tip_errors_of_chains

# Times what is stated, from which on a tip is wrong; and what no job states less than, m.
WRONG: Final = 3.0
FINEST: Final = 1e-4
# What is said of parameters that the data cannot tell.
HELD: Final = re.compile(r"keeps? (?:its|their) URDF value")
# What any answer rests on is no alarm.
SCALE: Final = "carries the scale"


@dataclass(frozen=True)
class Outcome:
    """What became of one job.

    Attributes:
        job, corruption: their names.
        level: of the answer's assessment, or ``refused`` where there is no answer.
        said: what is said of it, sentence by sentence.
        error: RMS of the tip's true error, m; NaN without a usable answer.
        stated: the same as it states it: by its covariance, and by what it says is held.
        seconds: of processor time that it took.
    """

    job: str
    corruption: str
    level: str
    said: tuple[str, ...]
    error: float = np.nan
    stated: float = np.nan
    seconds: float = np.nan


@dataclass(frozen=True)
class Judged:
    """An outcome beside that of the sound job.

    Attributes:
        outcome: of the corrupted job.
        fate: ``refused``, ``warned``, ``unharmed``, ``unsaid`` (the tip is right, but its ± or a
            figure's meaning is not), or ``silently wrong``; of a sound job ``sound``,
            ``overstated`` or ``false alarm``.
        named: whether the cause is named.
        note: the first thing that is said beyond what is said of the sound job.
    """

    outcome: Outcome
    fate: str
    named: bool
    note: str


def held_out(path: str) -> bool:
    """Whether a file is not fitted."""
    return path.startswith("validation/")


def corrupted(sound: Sound, corruption: Corruption | None, folder: Path) -> Path:
    """Write a job into an empty folder, its files as somebody would have got them wrong."""
    text, files, done = sound.text, [], 0
    fitted = sum(len(f.samples) for f in sound.made.files if not held_out(f.path))
    for file in sound.made.files:
        rows = np.arange(done, done + len(file.samples))
        done += len(rows)
        meant = {
            "all": rows >= 0,
            "fitted": np.full(len(rows), not held_out(file.path)),
            "first": np.full(len(rows), file.path == sound.made.files[0].path),
            "validation": np.full(len(rows), held_out(file.path)),
            "later": (rows >= fitted // 2) | held_out(file.path),
        }
        if corruption is not None and has(file.samples, corruption.needs):
            suffers = meant[corruption.files]
            parts = [file.samples.take(~suffers), file.samples.take(suffers)]
            if suffers.any():
                parts[1] = corruption.samples(parts[1])
            samples = Samples.concatenate([part for part in parts if len(part)])
            file = replace(file, samples=samples, displacement=np.zeros((len(samples), 3)))
        files.append(file)
    write_simulation(replace(sound.made, files=tuple(files)), folder)
    artefact = SUTA / "artefact.yaml"
    if corruption is not None and corruption.artefact is not None:
        write_artefact(folder / artefact.name, corruption.artefact(read_artefact(artefact)))
    else:
        shutil.copy(artefact, folder)
    if corruption is not None:
        if corruption.urdf is not None:
            arm = folder / URDF.name
            arm.write_text(corruption.urdf(URDF.read_text(encoding="utf-8")), encoding="utf-8")
            text = text.replace(str(URDF), str(arm))
        text = text.replace("validation/*.csv", f"{corruption.validation}/*.csv")
    job = folder / "calibration.yaml"
    job.write_text(text, encoding="utf-8")
    return job


def outcome(sound: Sound, corruption: Corruption | None) -> Outcome:
    """Calibrate the job from its files, as the command does."""
    names = sound.name, "nothing" if corruption is None else corruption.name
    began = process_time()
    with TemporaryDirectory() as folder:
        try:
            result = CalibrationJob.load(corrupted(sound, corruption, Path(folder))).run()
        except SutaCalibError as error:
            return Outcome(*names, "refused", (str(error),), seconds=process_time() - began)
    judged = result.assessment
    said = (judged.sentence, *judged.notes)
    errors = (np.nan, np.nan)
    if judged.usable:
        errors = tip_errors(sound.made, result.solution, judged.notes)
    return Outcome(*names, judged.level, said, *errors, process_time() - began)


@dataclass(frozen=True)
class RegistryFault:
    """The fault that a hypothesis of the registry puts into data (`Hypothesis.spoil`)."""

    hypothesis: Hypothesis
    right: bool = False

    @property
    def name(self) -> str:
        """As the hypothesis describes itself."""
        return self.hypothesis.about

    def happens_to(self, sound: Sound) -> bool:
        """Whether a job has one row of observations, of a kind that can have it."""
        rows = re.findall(r"kind: (\w+), samples|kind: (\w+), artefact", sound.text)
        kinds = {first or second for first, second in rows}
        of = KINDS_BY_NAME.get(next(iter(kinds))) if len(kinds) == 1 else None
        return of is not None and issubclass(of, self.hypothesis.applies_to)

    def outcome(self, sound: Sound) -> tuple[Outcome, str] | None:
        """Spoil what is fitted and calibrate; and what a note calls the fault.

        None where it cannot happen to these data, as exchanged landmarks to a tracker's.
        """
        names, began, effect = (sound.name, self.name), process_time(), ""
        with TemporaryDirectory() as folder:
            job = CalibrationJob.load(corrupted(sound, None, Path(folder)))
            first, *others = job.observations
            problem = job.problem()
            values = problem.values(problem.start(sound.made.values))
            try:
                spoilt = self.hypothesis.spoil(first, values, np.random.default_rng(0))
            except (LookupError, AttributeError, SutaCalibError):
                return None
            try:
                effect = spoilt.effect
                result = replace(job, observations=(spoilt.data, *others)).run()
            except SutaCalibError as error:
                said = (str(error),)
                return Outcome(*names, "refused", said, seconds=process_time() - began), effect
        judged = result.assessment
        said = (judged.sentence, *judged.notes)
        errors = (np.nan, np.nan)
        if judged.usable:
            errors = tip_errors(sound.made, result.solution, judged.notes)
        return Outcome(*names, judged.level, said, *errors, process_time() - began), effect


def registry_faults(jobs: Sequence[Sound]) -> Iterator[Judged]:
    """Every job, and what became of it with the fault of every hypothesis that applies to it."""
    faults = [RegistryFault(h) for h in shipped(known_hypotheses()).values() if h.needs_arm]
    for job in jobs:
        clean = outcome(job, None)
        for fault in faults:
            found_effect = fault.outcome(job) if fault.happens_to(job) else None
            if found_effect is not None:
                found, effect = found_effect
                called = (effect.strip() or fault.name, *fault.hypothesis.name.split(" ")[:1])
                yield judge(found, clean, Corruption(fault.name, called))


def chain_faults() -> Iterator[Judged]:
    """Two arms on one torso, and what became of them with the fault of every hypothesis in one.

    The cause is named where its arm is named with it: its joint, its file or its chain.
    """
    every = shipped(known_hypotheses()).values()
    faults = [h for h in every if h.needs_arm and issubclass(TrackedPoint, h.applies_to)]
    clean = _of_chains("two arms", "nothing", *both_hands(1))
    yield judge_sound(clean, "There are no validation data")
    for arm, side in enumerate(ROBOT.chains):
        for hypothesis in faults:
            try:
                fault, terms = spoilt(hypothesis, arm)
            except (LookupError, AttributeError, SutaCalibError):
                continue
            found = _of_chains(f"two arms, {side}", hypothesis.about, terms, both_hands(1)[1])
            first = hypothesis.name.split(" ")[0].replace("tip", "tool")
            words = fault.effect.strip() or hypothesis.name, first
            judged = judge(found, clean, Corruption(hypothesis.about, words))
            yield replace(judged, named=judged.named and any(side in s for s in found.said))


def _of_chains(job: str, fault: str, terms: Sequence[Term], truth: Mapping[str, float]) -> Outcome:
    began, rng = process_time(), np.random.default_rng(0)
    try:
        solution, judged = judged_hands(terms)
    except SutaCalibError as error:
        return Outcome(job, fault, "refused", (str(error),), seconds=process_time() - began)
    error, stated = np.nan, np.nan
    if judged.usable:
        hands = tip_errors_of_chains(ROBOT, solution, dict(truth), rng).values()
        error, stated = max(hands, key=lambda hand: hand.error / hand.stated)
    said = (judged.sentence, *judged.notes)
    return Outcome(job, fault, judged.level, said, error, stated, process_time() - began)


def tip_errors(
    made: Simulation, solution: Solution, notes: Sequence[str] = ()
) -> tuple[float, float]:
    """RMS distance of the tip from the truth after registration, and as stated, m.

    A held parameter is stated if a note names it as held and says what the tip loses by it.
    """
    rng = np.random.default_rng(0)
    middle = np.array([row.reading for row in made.spec.posture])
    q = middle + rng.uniform(-0.5, 0.5, (200, len(middle)))
    arm = {n: solution.values[n] for n in solution.problem.arm_parameters}
    fitted = solution.problem.arm
    assert fitted is not None

    def tip(values: dict[str, float]) -> FloatArray:
        return fitted.forward(q, values)[1]

    def apart(one: FloatArray, other: FloatArray) -> float:
        rotation, position = register_points(one, other)
        return rms_length(one @ rotation.T + position - other)

    free = solution.free[solution.free < len(arm)]
    names, covariance = [*arm], solution.covariance[np.ix_(free, free)]
    steps = rng.multivariate_normal(np.zeros(len(free)), covariance, 30, check_valid="ignore")
    found = tip(arm)
    drawn = []
    for step in steps:
        other = {names[k]: arm[names[k]] + more for k, more in zip(free, step, strict=True)}
        drawn.append(apart(tip(arm | other), found))
    told = [note for note in notes if HELD.search(note) and "the tip is wrong by" in note]
    moved = dict(arm)
    for held in solution.identification.combinations:
        if any(re.search(rf"\b{re.escape(held.fixed)}\b", note) for note in told):
            off = made.values.get(held.fixed, arm[held.fixed]) - arm[held.fixed]
            for name in held.direction.keys() & arm.keys():
                moved[name] += off * held.direction[name]
    stated = np.hypot(np.sqrt(np.mean(np.square(drawn))), apart(tip(moved), found))
    return apart(found, made.arm.forward(q, made.values)[1]), float(stated)


def judge_sound(found: Outcome, says: str | None = None) -> Judged:
    """Whether a sound job's answer is right, and nothing said against it but what is held.

    ``says``: words of what is true besides.
    """
    against = [
        note
        for note in found.said[1:]
        if not HELD.search(note) and SCALE not in note and not (says and says in note)
    ]
    if found.level in ("refused", "bad") or (found.level == "care" and against):
        fate = "false alarm"
    else:
        fate = "overstated" if wrong(found) else "sound"
    return Judged(found, fate, fate == "sound", "; ".join(found.said[1:]))


def wrong(found: Outcome) -> bool:
    """Whether the tip is farther off than what is stated allows."""
    return bool(found.error > WRONG * max(found.stated, FINEST))


def judge(found: Outcome, clean: Outcome, corruption: Corruption) -> Judged:
    """Hold an outcome against that of the sound job."""

    def told(sentence: str) -> str:
        return re.sub(r"[\d.]+", "#", sentence)

    known = {told(sentence) for sentence in clean.said}
    new = [sentence for sentence in found.said if told(sentence) not in known]
    named = any(word in sentence for sentence in new for word in corruption.words)
    if found.level in ("refused", "bad"):
        fate = "refused"
    elif found.level == "care" and any(s in found.said[1:] for s in new):
        fate = "warned"
    elif wrong(found):
        fate = "silently wrong"
    else:
        fate = "unsaid" if corruption.right else "unharmed"
    note = next((sentence for sentence in new if sentence in found.said[1:]), (new or [""])[0])
    return Judged(found, fate, named, note)


def study(
    jobs: Sequence[Sound],
    corruptions: Sequence[Corruption] = CORRUPTIONS,
    most: int | None = None,
    shown: bool = True,
    known: Mapping[tuple[str, str], Outcome] = MappingProxyType({}),
) -> Iterator[Judged]:
    """Every job, and what became of it with every corruption that can happen to it.

    Args:
        jobs: sound ones.
        corruptions: of them, those that can happen to a job.
        most: only so many corruptions of each.
        shown: whether progress is.
        known: outcomes by job and corruption that need not be found again.
    """

    def found(job: Sound, corruption: Corruption | None) -> Outcome:
        name = "nothing" if corruption is None else corruption.name
        return known.get((job.name, name)) or outcome(job, corruption)

    suffered = [(job, [c for c in corruptions if job.suffers(c)][:most]) for job in jobs]
    with Progress(disable=not shown) as progress:
        done = progress.add_task("", total=sum(1 + len(own) for _, own in suffered))
        for job, own in suffered:
            progress.update(done, description=job.name)
            clean = found(job, None)
            yield judge_sound(clean, job.says)
            progress.advance(done)
            for corruption in own:
                yield judge(found(job, corruption), clean, corruption)
                progress.advance(done)


# ── Tables ───────────────────────────────────────────────────────────────────────────────────
FATES: Final = ("refused", "warned", "unharmed", "unsaid", "silently wrong")
OF_SOUND: Final = ("sound", "overstated", "false alarm")


def show(found: Sequence[Judged], console: Console) -> None:
    """Totals by corruption and by job, and what is wrong or unexplained, one by one."""
    harmed = [each for each in found if each.fate not in OF_SOUND]
    for title, key in (
        ("by corruption", lambda each: each.outcome.corruption),
        ("by job", lambda each: each.outcome.job),
    ):
        table = number_table(f"Corrupted jobs {title}", "", "jobs", *FATES, "cause named")
        rows = {name: [e for e in harmed if key(e) == name] for name in map(key, harmed)}
        for name, own in (rows | {"all": harmed}).items():
            counts = Counter(each.fate for each in own)
            spoken = [each for each in own if each.fate in ("refused", "warned")]
            named = f"{sum(each.named for each in spoken)} of {len(spoken)}"
            cells = (str(counts[fate] or "") for fate in FATES)
            table.add_row(name, str(len(own)), *cells, named)
        console.print(table)
    for title, own in {
        "Sound jobs": [e for e in found if e.fate == "sound"],
        "Sound jobs that overstate themselves": [e for e in found if e.fate == "overstated"],
        "Sound jobs with a false alarm": [e for e in found if e.fate == "false alarm"],
        "Silently wrong": [e for e in harmed if e.fate == "silently wrong"],
        "Unsaid": [e for e in harmed if e.fate == "unsaid"],
        "Refused or warned, cause not named": [
            e for e in harmed if e.fate in ("refused", "warned") and not e.named
        ],
    }.items():
        table = number_table(title, "job", "corruption", "level", "tip error", "stated, mm")
        table.add_column("first note", overflow="fold")
        for each in own:
            o = each.outcome
            figures = (f"{mm(figure):.3f}" for figure in (o.error, o.stated))
            table.add_row(o.job, o.corruption, o.level, *figures, each.note[:160])
        console.print(table)


def main() -> None:
    """Run the study, and print what became of every job."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="Two kinds, eight corruptions each.")
    parser.add_argument("--kind", action="append", choices=[*KINDS, "shipped"], help="Only these.")
    parser.add_argument("--starts", type=int, default=4, help="Of each calibration.")
    parser.add_argument("--corruption", action="append", metavar="WORDS", help="Only such ones.")
    parser.add_argument(
        "--json",
        type=Path,
        help="Write every outcome here, a line each; those that stand there are not found again.",
    )
    parser.add_argument(
        "--registry", action="store_true", help="The faults of trust/hypotheses in place of these."
    )
    parser.add_argument(
        "--chains", action="store_true", help="The same faults in one arm of two on one torso."
    )
    asked = parser.parse_args()
    if asked.chains:
        show(list(chain_faults()), Console(width=180))
        return
    kinds = asked.kind or (["tracked_point", "landmark"] if asked.quick else [*KINDS, "shipped"])
    simulated = [kind for kind in kinds if kind != "shipped"]
    jobs = [*sound_jobs(simulated, shipped="shipped" in kinds, starts=asked.starts)]
    if asked.registry:
        show(list(registry_faults(jobs)), Console(width=180))
        return
    chosen = [
        c for c in CORRUPTIONS if not asked.corruption or any(w in c.name for w in asked.corruption)
    ]
    found, known = [], read_outcomes(asked.json) if asked.json and asked.json.exists() else {}
    with Path(asked.json or os.devnull).open("a", encoding="utf-8") as file:
        for each in study(jobs, chosen, 8 if asked.quick else None, known=known):
            found.append(each)
            if (each.outcome.job, each.outcome.corruption) not in known:
                file.write(json.dumps(asdict(each)) + "\n")
                file.flush()
    show(found, Console(width=180))


def read_outcomes(file: Path) -> dict[tuple[str, str], Outcome]:
    """What a study that was stopped has written, by job and corruption."""
    known = {}
    for line in file.read_text(encoding="utf-8").splitlines():
        told = json.loads(line)["outcome"]
        found = Outcome(**(told | {"said": tuple(told["said"])}))
        known[found.job, found.corruption] = found
    return known


if __name__ == "__main__":
    main()
