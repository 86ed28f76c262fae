"""Sound jobs, corrupted as it happens in laboratories: refused, warned, or silently wrong?

The shipped jobs and a job of every kind of observation, with bounds and with priors, are corrupted
in every way of `CORRUPTIONS`: the files are written as somebody would have written them, read and
calibrated. All of it is simulated, so the truth is known. An answer is *silently wrong* if it is
usable, says nothing that the sound job's answer does not say too, and its tip is farther off the
truth (after registration, in postures it never saw) than three times what it states, and three
times what the sound job's is.
"""

from __future__ import annotations

import argparse
import json
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from rich.console import Console
from rich.progress import Progress
from tables import number_table

from suta_calib import Artefact, CalibrationJob, Samples, Solution, SutaCalibError, simulate
from suta_calib.arrays import FloatArray
from suta_calib.geometry import (
    quaternion_from_rotation,
    register_points,
    rms_length,
    rotation_from_quaternion,
)
from suta_calib.measurements import read_artefact, write_artefact
from suta_calib.simulation import Simulation, read_simulation, write_simulation
from suta_calib.units import deg, mm

Change = Callable[[Samples], Samples]
SUTA: Final = Path(__file__).resolve().parents[1] / "data" / "suta"
URDF: Final = SUTA.parents[1] / "urdf" / "suta.urdf"
# Times what is stated, from which on a tip is wrong; and what no job states less than, m.
WRONG: Final = 3.0
FINEST: Final = 1e-4


@dataclass(frozen=True)
class Corruption:
    """One thing that goes wrong.

    Attributes:
        name: what it is.
        words: parts of sentences, of which one must be said where the cause is named.
        samples: what becomes of a file's samples.
        artefact: what becomes of an artefact's file.
        needs: what the samples must have: ``position``, ``rotation``, ``artefact``, an ``order`` of
            what was observed, or a label.
        files: of which samples it happens to: those of every file, of every file that is fitted, of
            the first of these, or of all that was measured ``later`` than half of what is fitted.
        validation: which set stands in for the validation's.
        right: whether the tip stays right, so that only ± or the meaning of figures suffers.
    """

    name: str
    words: tuple[str, ...]
    samples: Change = lambda samples: samples
    artefact: Callable[[Artefact], Artefact] | None = None
    needs: str = ""
    files: str = "all"
    validation: str = "validation"
    right: bool = False


# ── What goes wrong ──────────────────────────────────────────────────────────────────────────
def joint(k: int, change: Callable[[FloatArray], FloatArray]) -> Change:
    """The readings of one joint, changed."""

    def changed(samples: Samples) -> Samples:
        q = samples.q.copy()
        q[:, k] = change(q[:, k])
        return replace(samples, q=q)

    return changed


def seen(change: Callable[[FloatArray], FloatArray]) -> Change:
    """What an instrument or a camera saw, changed."""

    def changed(samples: Samples) -> Samples:
        assert samples.position is not None
        return replace(samples, position=change(samples.position))

    return changed


def swapped_joints(samples: Samples) -> Samples:
    """The first two columns exchanged."""
    order = [1, 0, *range(2, samples.q.shape[1])]
    return replace(samples, q=samples.q[:, order])


def moved_half_way(position: FloatArray) -> FloatArray:
    """An instrument that was pushed 50 mm aside after half of the rows."""
    later = np.arange(len(position)) >= len(position) // 2
    return np.asarray(position + later[:, None] * [0.05, 0.0, 0.0])


def crept(position: FloatArray) -> FloatArray:
    """An instrument that sinks by 2 mm while the rows are measured."""
    return np.asarray(position + np.linspace(0.0, 2e-3, len(position))[:, None] * [0.0, 0.6, 0.8])


def inverted(samples: Samples) -> Samples:
    """Poses of the target in the camera written as those of the camera in the target."""
    assert samples.position is not None
    assert samples.rotation is not None
    back = np.swapaxes(samples.rotation, 1, 2)
    position = -np.einsum("nij,nj->ni", back, samples.position)
    return replace(samples, rotation=back, position=position)


def reordered(samples: Samples) -> Samples:
    """Quaternions w x y z in the columns of x y z w."""
    assert samples.rotation is not None
    quaternions = np.roll(quaternion_from_rotation(samples.rotation), 1, axis=1)
    return replace(samples, rotation=rotation_from_quaternion(quaternions))


def late(rows: int, samples: Samples) -> Samples:
    """What was observed stands so many rows too late beside the readings."""
    kept = np.arange(len(samples) - rows)
    read, other = samples.take(kept + rows), samples.take(kept)
    return replace(other, q=read.q, origin=read.origin)


def backwards(samples: Samples) -> Samples:
    """The readings in the opposite order of what was observed."""
    return replace(samples, q=samples.q[::-1])


def exchanged(label: str, samples: Samples) -> Samples:
    """Two of a label's names exchanged."""
    names = samples.labels[label]
    a, b = list(dict.fromkeys(names.tolist()))[:2]
    new = np.where(names == a, b, np.where(names == b, a, names))
    return replace(samples, labels={**samples.labels, label: new})


def reused(label: str, samples: Samples) -> Samples:
    """The name of the first place given to all others too, their repeats counted on."""
    names, labels = samples.labels[label], dict(samples.labels)
    if "repeat" in labels:
        pairs = zip(names, labels["repeat"], strict=True)
        labels["repeat"] = np.array([f"{name}.{repeat}" for name, repeat in pairs])
    labels[label] = np.full_like(names, "A")
    return replace(samples, labels=labels)


def numbered_on(label: str, samples: Samples) -> Samples:
    """Names that end with a number, counted from one too many; the last begins anew."""
    names = samples.labels[label]
    order = sorted({n for n in names.tolist() if n[-1].isdigit()})
    new = dict(zip(order, [*order[1:], *order[:1]], strict=True))
    changed = np.array([new.get(n, n) for n in names.tolist()])
    return replace(samples, labels={**samples.labels, label: changed})


def gross(samples: Samples) -> Samples:
    """Three of ten rows: seen elsewhere, or another posture's readings."""
    rng = np.random.default_rng(0)
    rows = rng.permutation(len(samples))[: round(0.3 * len(samples))]
    if samples.position is not None:
        position = samples.position.copy()
        position[rows] += rng.uniform(-0.05, 0.05, (len(rows), 3))
        return replace(samples, position=position)
    q = samples.q.copy()
    q[rows] += rng.normal(0.0, 0.03, (len(rows), q.shape[1]))
    return replace(samples, q=q)


def stretched(factors: FloatArray | float, artefact: Artefact) -> Artefact:
    """Every landmark's position times a factor, or one for each axis."""
    marks = {
        name: replace(mark, position=factors * mark.position)
        for name, mark in artefact.landmarks.items()
    }
    return replace(artefact, landmarks=marks)


LATE: Final = (" late", " early", "opposite order")
CORRUPTIONS: Final = (
    Corruption("a joint's sign", ("counts the other way", "sign"), joint(1, np.negative)),
    Corruption("two joints swapped", ("exchanged",), swapped_joints),
    Corruption("a joint off by 90°", ("too much", "limit"), joint(2, lambda q: q + np.pi / 2)),
    Corruption("a joint off by a turn", ("turn",), joint(2, lambda q: q + 2 * np.pi), right=True),
    Corruption("degrees for radians", ("degrees",), lambda s: replace(s, q=deg(s.q))),
    Corruption(
        "a stuck encoder",
        ("encoder alive", "same in every row"),
        joint(3, lambda q: 0 * q + 1.9),
    ),
    Corruption(
        "a count lost per turn", ("lose or double counts",), joint(2, lambda q: q * (1 - 1 / 4096))
    ),
    Corruption(
        "an encoder slips half-way", ("slip",), joint(1, lambda q: q + 0.005), files="later"
    ),
    Corruption("mm for m (instrument)", (" mm, not m", "mm"), seen(mm), needs="position"),
    Corruption(
        "instrument 2 % too long",
        ("too long", "longer than nominal"),
        seen(lambda p: 1.02 * p),
        needs="position",
    ),
    Corruption(
        "instrument moved half-way",
        ("moved",),
        seen(moved_half_way),
        needs="position",
        files="fitted",
    ),
    Corruption(
        "instrument moved before validation",
        ("moved",),
        seen(lambda p: p + 0.05),
        needs="position",
        files="validation",
        right=True,
    ),
    Corruption(
        "instrument creeps by 2 mm", ("crept",), seen(crept), needs="position", files="fitted"
    ),
    Corruption("poses inverted", ("inverted",), inverted, needs="rotation"),
    Corruption("quaternion order", ("w x y z", "quaternion"), reordered, needs="rotation"),
    *(Corruption(f"{n} rows late", LATE, partial(late, n), needs="order") for n in (1, 5, 20)),
    Corruption("one file a row late", LATE, partial(late, 1), needs="order", files="first"),
    Corruption("rows in the opposite order", LATE, backwards, needs="order"),
    Corruption(
        "landmarks swapped", ("exchanged",), partial(exchanged, "landmark"), needs="landmark"
    ),
    Corruption(
        "landmarks numbered on",
        ("numbers are",),
        partial(numbered_on, "landmark"),
        needs="landmark",
    ),
    Corruption(
        "one label for all placements",
        ("was moved",),
        partial(reused, "placement"),
        needs="placement",
    ),
    Corruption("one label for all points", ("was moved",), partial(reused, "point"), needs="point"),
    Corruption(
        "duplicated rows",
        ("twice", "count once"),
        lambda s: s.take(np.tile(np.arange(len(s)), 3)),
        files="fitted",
        right=True,
    ),
    Corruption("30 % gross outliers", ("outliers", "times as large"), gross, files="fitted"),
    Corruption(
        "validation repeats the calibration",
        ("fitted too", "held out"),
        validation="calibration",
        right=True,
    ),
    Corruption(
        "artefact in m, written as mm",
        ("mm", "unit"),
        artefact=partial(stretched, 1e-3),
        needs="artefact",
    ),
    Corruption(
        "artefact 2 % too long",
        ("too long", "longer than nominal"),
        artefact=partial(stretched, 1.02),
        needs="artefact",
    ),
    Corruption(
        "artefact mirrored",
        ("mirror", "left-handed"),
        artefact=partial(stretched, np.array([-1.0, 1, 1])),
        needs="artefact",
    ),
)


# ── Sound jobs ───────────────────────────────────────────────────────────────────────────────
SIMULATION: Final = """\
arm: {{urdf: {urdf}, tip: tip}}
seed: 1
posture_deg: {{joint_1: 15, joint_2: 175, joint_3: 160, joint_4: 110, joint_5: -90, joint_6: -125}}
errors:
  - {{select: ["*.offset"], std_deg: 0.5}}
  - {{select: [joint_2.z, joint_4.z, joint_6.z, tip.y], std_mm: 1}}
noise:
  {{seating_mm: 0.1, seating_deg: 0.05, encoder_deg: 0.001,
    instrument_mm: 0.1, instrument_deg: 0.05}}
sets:
  calibration: {{kind: {kind}, {fitted}}}
  validation: {{kind: {kind}, {held_out}}}
"""
JOB: Final = """\
arm: {{urdf: {urdf}, tip: tip}}
parameters:
{parameters}observations: [{{kind: {kind}, {row}samples: calibration/*.csv}}]
validation: [{{kind: {kind}, {row}samples: validation/*.csv}}]
solver: {{starts: {starts}}}
"""
PARAMETERS: Final = {
    "bounds": '  - {select: ["*.offset"], bound_deg: 15}\n'
    "  - {select: [joint_2.z, joint_4.z, joint_6.z, tip.y], bound_mm: 30}\n",
    "priors": "  - {select: geometric, prior_mm: 1, prior_deg: 0.2}\n"
    '  - {select: ["*.offset"], prior_deg: 0.75}\n',
}


def places(name: str, first: str, *rows: tuple[float, float, float, float]) -> str:
    """Places ``A1, A2, …`` at x, y, z, mm, and, but for points, some tilt and a yaw, deg."""
    stated = []
    for k, (x, y, z, yaw) in enumerate(rows):
        turned = "" if name == "points" else f", rotation_rpy_deg: [0, {8 * k}, {yaw}]"
        stated.append(f"{first}{k + 1}: {{position_mm: [{x}, {y}, {z}]{turned}}}")
    return f"{name}: {{{', '.join(stated)}}}"


PUT_DOWN: Final = (
    (512.5, 12.5, 0, -105), (462.5, -37.5, 0, 15), (462.5, 62.5, 0, 30), (512.5, 112.5, 0, 30)
)  # fmt: skip
PUT_DOWN_LATER: Final = (437.5, -12.5, 0, -90), (487.5, 37.5, 0, -105)
TWICE: Final = f"artefact: {SUTA / 'artefact.yaml'}, repeats: 2"
# By kind: what the two sets say, and what the job's rows say.
KINDS: Final = {
    **{
        kind: (
            f"{TWICE}, {places('placements', 'P', *PUT_DOWN)}",
            f"{TWICE}, {places('placements', 'V', *PUT_DOWN_LATER)}",
            "artefact: artefact.yaml, ",
        )
        for kind in ("pairwise_distance", "landmark")
    },
    "fixed_point": (
        f"directions: 30, axis: [0, 0, -1], {places('points', 'P', *PUT_DOWN)}",
        f"directions: 25, axis: [0, 0, -1], {places('points', 'V', *PUT_DOWN_LATER)}",
        "",
    ),
    "plane": (
        f"directions: 30, size_mm: 100, probe_radius_mm: 5, {places('planes', 'P', *PUT_DOWN)}",
        f"directions: 25, probe_radius_mm: 5, {places('planes', 'V', *PUT_DOWN_LATER)}",
        "probe_radius_mm: 5, ",
    ),
    **{
        kind: (f"samples: 60, {frames}", f"samples: 40, {frames}", "")
        for kind, frames in (
            (
                "tracked_point",
                "orientation: true, base_in_instrument: "
                "{position_mm: [1500, 200, -300], rotation_rpy_deg: [5, -10, 130]}",
            ),
            (
                "hand_eye",
                "eye_in_tip: {position_mm: [20, -40, 60], rotation_rpy_deg: [10, 0, 45]}, "
                "target_in_base: {position_mm: [600, 100, -50], rotation_rpy_deg: [180, 0, 20]}",
            ),
        )
    },
}


@dataclass(frozen=True)
class Sound:
    """A job before anything goes wrong: its name, its text, and what was measured for it."""

    name: str
    text: str
    made: Simulation

    @property
    def samples(self) -> dict[str, Samples]:
        """By file; ``calibration/P1.csv``."""
        return {file.path: file.samples for file in self.made.files}

    def suffers(self, corruption: Corruption) -> bool:
        """Whether it can happen to this job."""
        if corruption.needs == "artefact":
            return "artefact:" in self.text
        return any(has(samples, corruption.needs) for samples in self.samples.values())


def has(samples: Samples, needed: str) -> bool:
    """Whether samples have what a corruption needs."""
    if needed == "order":  # in which rows were seen, or landmarks were touched
        return samples.position is not None or "landmark" in samples.labels
    if needed in ("position", "rotation"):
        return getattr(samples, needed) is not None
    return needed in ("", "artefact", *samples.labels)


def sound_jobs(
    kinds: Iterable[str] = KINDS, *, shipped: bool = True, starts: int = 4
) -> Iterator[Sound]:
    """The shipped jobs, and one of every kind with bounds and one with priors."""
    if shipped:
        made = simulate(read_simulation(SUTA / "simulation.yaml"))
        for name in ("calibration", "calibration_full"):
            text = (SUTA / f"{name}.yaml").read_text().replace("../../urdf/suta.urdf", str(URDF))
            text = text.replace("starts: 8", f"starts: {starts}")
            used = tuple(file for file in made.files if file.path.split("/")[0] in text)
            yield Sound(name, text, replace(made, files=used))
    for kind in kinds:
        fitted, held_out, row = KINDS[kind]
        with TemporaryDirectory() as folder:
            file = Path(folder) / "simulation.yaml"
            sets = {"kind": kind, "fitted": fitted, "held_out": held_out}
            file.write_text(SIMULATION.format(urdf=URDF, **sets))
            made = simulate(read_simulation(file))
        for what, parameters in PARAMETERS.items():
            rows = {"kind": kind, "row": row, "parameters": parameters, "starts": starts}
            yield Sound(f"{kind}, {what}", JOB.format(urdf=URDF, **rows), made)


# ── What becomes of them ─────────────────────────────────────────────────────────────────────
@dataclass(frozen=True)
class Outcome:
    """What became of one job.

    Attributes:
        job, corruption: their names.
        level: of the answer's assessment, or ``refused`` where there is no answer.
        said: what is said of it, sentence by sentence.
        error: RMS of the tip's true error, m; NaN without a usable answer.
        stated: the same as its covariance states it.
    """

    job: str
    corruption: str
    level: str
    said: tuple[str, ...]
    error: float = np.nan
    stated: float = np.nan


@dataclass(frozen=True)
class Judged:
    """An outcome beside that of the sound job.

    Attributes:
        outcome: of the corrupted job.
        fate: ``refused``, ``warned``, ``unharmed``, ``unsaid`` (the tip is right, but its ± or a
            figure's meaning is not), or ``silently wrong``.
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
    artefact = read_artefact(SUTA / "artefact.yaml")
    if corruption is not None:
        text = text.replace("validation/*.csv", f"{corruption.validation}/*.csv")
        artefact = artefact if corruption.artefact is None else corruption.artefact(artefact)
    write_artefact(folder / "artefact.yaml", artefact)
    job = folder / "calibration.yaml"
    job.write_text(text, encoding="utf-8")
    return job


def outcome(sound: Sound, corruption: Corruption | None) -> Outcome:
    """Calibrate the job from its files, as the command does."""
    names = sound.name, "nothing" if corruption is None else corruption.name
    with TemporaryDirectory() as folder:
        try:
            result = CalibrationJob.load(corrupted(sound, corruption, Path(folder))).run()
        except SutaCalibError as error:
            return Outcome(*names, "refused", (str(error),))
    judged = result.assessment
    said = (judged.sentence, *judged.notes)
    errors = tip_errors(sound.made, result.solution) if judged.usable else ()
    return Outcome(*names, judged.level, said, *errors)


def tip_errors(made: Simulation, solution: Solution) -> tuple[float, float]:
    """RMS distance of the tip from the truth after registration, and as stated, m."""
    rng = np.random.default_rng(0)
    middle = np.array([row.reading for row in made.spec.posture])
    q = middle + rng.uniform(-0.5, 0.5, (200, len(middle)))
    arm = {n: solution.values[n] for n in solution.problem.arm_parameters}

    def tip(values: dict[str, float]) -> FloatArray:
        return made.arm.forward(q, values)[1]

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
    return apart(found, tip(dict(made.values))), float(np.sqrt(np.mean(np.square(drawn))))


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
    elif found.error > WRONG * max(found.stated, clean.error, FINEST):
        fate = "silently wrong"
    else:
        fate = "unsaid" if corruption.right else "unharmed"
    note = next((sentence for sentence in new if sentence in found.said[1:]), (new or [""])[0])
    return Judged(found, fate, named, note)


def study(jobs: Sequence[Sound], most: int | None = None, shown: bool = True) -> Iterator[Judged]:
    """Every job, and what became of it with every corruption that can happen to it.

    Args:
        jobs: sound ones.
        most: only so many corruptions of each.
        shown: whether progress is.
    """
    suffered = [(job, [c for c in CORRUPTIONS if job.suffers(c)][:most]) for job in jobs]
    with Progress(disable=not shown) as progress:
        done = progress.add_task("", total=sum(1 + len(own) for _, own in suffered))
        for job, own in suffered:
            progress.update(done, description=job.name)
            clean = outcome(job, None)
            yield Judged(clean, "sound", True, "; ".join(clean.said[1:]))
            progress.advance(done)
            for corruption in own:
                yield judge(outcome(job, corruption), clean, corruption)
                progress.advance(done)


# ── Tables ───────────────────────────────────────────────────────────────────────────────────
FATES: Final = ("refused", "warned", "unharmed", "unsaid", "silently wrong")


def show(found: Sequence[Judged], console: Console) -> None:
    """Totals by corruption and by job, and what is wrong or unexplained, one by one."""
    harmed = [each for each in found if each.fate != "sound"]
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
    parser.add_argument("--json", type=Path, help="Write every outcome here, a line each.")
    asked = parser.parse_args()
    kinds = asked.kind or (["tracked_point", "landmark"] if asked.quick else [*KINDS, "shipped"])
    simulated = [kind for kind in kinds if kind != "shipped"]
    jobs = [*sound_jobs(simulated, shipped="shipped" in kinds, starts=asked.starts)]
    found = []
    with Path(asked.json or os.devnull).open("w", encoding="utf-8") as file:
        for each in study(jobs, 8 if asked.quick else None):
            found.append(each)
            file.write(json.dumps(asdict(each)) + "\n")
            file.flush()
    show(found, Console(width=180))


if __name__ == "__main__":
    main()
