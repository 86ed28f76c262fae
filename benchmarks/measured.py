"""Measured arms: before, published, figaroh, pybotics, plain SciPy and ours, on what was held out.

    make measured
    python benchmarks/measured.py [FOLDER …] [--figaroh PYTHON] [--pybotics DIR] [--out PAGE]

FOLDER: further jobs, a folder with a calibration.yaml or one of such folders; a job needs
`validation`. Everybody gets the same samples in one run, one thread and a process of his own; what
fails is a row of the table. Writes the page, and a picture beside it for each job.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import platform
import resource
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import process_time

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
os.environ.update(ONE_THREAD)

import numpy as np  # noqa: E402 (after the number of threads)
from measured_peers import (  # noqa: E402
    Answer,
    CannotRunError,
    PlainScipy,
    figaroh,
    figaroh_version,
    pybotics,
)
from pybotics_peer import Residuals, version_in  # noqa: E402
from rich.console import Console  # noqa: E402
from tables import number_table  # noqa: E402

from suta_calib import Calibration, CalibrationJob, SutaCalibError, Term  # noqa: E402
from suta_calib.arrays import FloatArray, IntArray  # noqa: E402
from suta_calib.units import mm  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
# What comes with the repository; then what may stand beside it, whose licence or size keeps it out.
KEPT = ROOT / "examples"
BESIDE = ROOT.parent / "shared" / "data" / "real"
OURS = "**ours**"
# How the summary calls whom.
PEERS = {
    "before": "before",
    "figaroh": "figaroh",
    "pybotics": "pybotics",
    "plain SciPy": "plain SciPy",
    OURS: "ours",
}
# Of the bootstrap: 2,000 give the ends of a 95 % interval to some percent of its width.
DRAWS = 2000
# Half of the last digit that the tables show.
LEVEL_MM = 0.0005
# Five units that all favour one side are no evidence at 95 %: 2 / 2^5 of the time chance does that.
FEWEST_DRAWN = 6
HEADS = ("mean, mm", "RMS, mm", "max, mm", "s", "MB")
AGAINST = ("RMS of ours minus it, mm", "95 % interval", "so it is")


@dataclass(frozen=True)
class Source:
    """What is known of a set beside its data.

    Attributes:
        title: of its section.
        about: a sentence on how it was measured, and where it comes from.
        published: held-out figures as the source states them, each with what it is.
    """

    title: str
    about: str
    published: tuple[str, ...] = ()


SOURCES = {
    "ur5_laser_tracker": Source(
        "UR5, laser tracker",
        "700 poses fitted, 320 held out. P. Jacobi, Tsinghua University 2025, "
        "<https://github.com/pauljac7700/serial_robots_datasets>, MIT.",
        (
            "mean of the 20 random poses 2.566 mm as delivered",
            "0.155 mm with modified DH and a graph neural network, measured at compensated targets",
        ),
    ),
    "panda_sockets": Source(
        "Panda, ball in two sockets",
        "One place of the sockets fitted, seven held out. MUKCa, arXiv:2503.12584, "
        "<https://github.com/platonics-delft/kinematics_calibration>, MIT.",
        (
            "mean deviation from each socket's mean 7.79 mm before, 0.347 mm after; ours by that "
            "measure 0.33 mm (`python examples/panda_sockets/held_out.py`)",
        ),
    ),
    "tiago_qualisys": Source(
        "TIAGo, motion capture",
        "37 postures fitted, 62 of another day held out, not registered again. Where the marker "
        "sits is not known: before, it is at the origin of its link. "
        "<https://github.com/thanhndv212/figaroh-examples>, Apache-2.0; not kept here.",
        ("RMS 4.87 mm registered only, 4.23 mm with offsets, 3.22 mm with all geometry",),
    ),
}
# The same arm is not shown twice where the folder beside the repository has what is kept.
SAME = {"mukca_panda_2_clean": "panda_sockets", "ur5_tracker": "ur5_laser_tracker"}


@dataclass(frozen=True)
class Row:
    """One line of a table: errors, or why there are none."""

    name: str
    answer: Answer | None
    why: str = ""

    @property
    def rms(self) -> float:
        """Of the errors, mm; infinite where there are none."""
        error = None if self.answer is None else self.answer.errors
        return np.inf if error is None else mm(float(np.sqrt(np.mean(error**2))))

    @property
    def cells(self) -> list[str]:
        """Formatted figures; dashes where there are none."""
        if self.answer is None:
            return ["–"] * len(HEADS)
        error, memory = self.answer.errors, self.answer.memory_mb
        figures = (mm(error.mean()), self.rms, mm(error.max()))
        return [
            *(f"{v:.3f}" for v in figures),
            f"{self.answer.seconds:.2f}" if self.answer.seconds else "–",
            "–" if memory is None else f"{memory:.0f}",
        ]


HEADER = """\
# Measured arms

How far is the calibrated arm from where it was measured? Each arm below was measured by others and
calibrated on a part of the samples. Every number is an error on the other part, which was **held
out**: no tool has seen it. The error of a sample is the distance between the predicted position of
the tip and the measured (or known) one. The pose of the instrument is the fitted one; the pose of
the sockets is estimated again. `make measured` wrote this page and ran every fit on it
(`benchmarks/measured.py`; Python {python}, {machine}).

* *Before* is the nominal geometry. Only the pose of the instrument or of the sockets is fitted.
* *figaroh* is the release on PyPI with its defaults: base, tip and its own choice of parameters.
  The better of its two levels stands in the first table.
* *pybotics* is the release on PyPI: SciPy's `least_squares` over each number of its modified
  Denavit-Hartenberg table, the tip and the pose of the instrument. Its own residual is the
  *distance* of the tip; the second row fits the *coordinates* of the tip with the same kinematics.
  The better of the two stands in the first table.
* *Plain SciPy* is one `least_squares` over the job's unknowns, with its loss and its priors,
  weighted with a noise of 0.5 mm; kinematics in NumPy, the Jacobian by differences.
* *Ours* is `suta-calib calibrate`. It learns the noise and the size of the priors from the fitted
  samples. *As stated* is ours without that: noise and priors are what the job says.

Times are processor time on one thread: for ours from reading the job's files to the result with its
verdict, for the others of the fit alone. Memory is the peak of the process, with its libraries. To
add your own jobs, run `python benchmarks/measured.py FOLDER`.
"""

CHANCE = """\
**Is a difference chance?** The same held-out samples are drawn again for both tools, with
replacement, 2,000 times: single samples, or whole placements of the sockets. The 95 % interval
holds the middle 95 % of these differences. *Level*: all of it is below 0.0005 mm. *Within chance*:
it contains zero, so these samples cannot say who is better. *Ours better* and *ours worse*: it does
not contain zero. *Too few to say*: fewer than six placements were drawn from. Other rows of ours
are compared with the first of them: *ours worse* there means that this other job is better.
"""


# ── one process for each ─────────────────────────────────────────────────────────────────────
def ours(path: Path) -> tuple[Answer, Answer, str]:
    """Before and after, and our own sentence about it."""
    began = process_time()
    result: Calibration = CalibrationJob.load(path).run()
    seconds = process_time() - began
    blocks = [term.blocks[0] for term in result.accuracy.validation]
    before, after = (
        np.concatenate([getattr(block, which) for block in blocks]) for which in ("before", "after")
    )
    return (
        Answer(before, 0.0),
        Answer(after, seconds, _memory_mb()),
        f"{result.assessment.word}. {result.assessment.sentence}.",
    )


def as_stated(path: Path) -> Answer:
    """Ours with the noise and the priors of the job, nothing learned."""
    began = process_time()
    job = CalibrationJob.load(path)
    result = replace(job, chosen=replace(job.options(), weights=None)).run()
    seconds = process_time() - began
    errors = [term.blocks[0].after for term in result.accuracy.validation]
    return Answer(np.concatenate(errors), seconds, _memory_mb())


def plain(path: Path) -> Answer:
    """The peer in SciPy."""
    answer = PlainScipy(CalibrationJob.load(path)).solve()
    return replace(answer, memory_mb=_memory_mb())


def of_pybotics(path: Path, folder: Path, residuals: Residuals) -> Answer:
    """The peer in pybotics."""
    answer = pybotics(CalibrationJob.load(path), folder, residuals)
    return replace(answer, memory_mb=_memory_mb())


def _memory_mb() -> float:
    """Most that this process had so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def plainly(text: str) -> str:
    """Without Markdown."""
    return text.replace("*", "").replace("`", "")


def alone(call: Callable[[Path], object], path: Path) -> object:
    """What a function answers in a fresh process, whose memory is then its own."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as pool:
        return pool.submit(call, path).result()


# ── a job ────────────────────────────────────────────────────────────────────────────────────
def rows_of(path: Path, python: str, folder: Path | None) -> tuple[list[Row], str]:
    """Everybody's rows for a job, and our own sentence: figaroh's interpreter, pybotics' folder."""
    rows, sentence = [], ""
    try:
        before, after, sentence = alone(ours, path)
        rows += [Row("before: nominal geometry, registered", before)]
        last = [Row(OURS, after)]
    except SutaCalibError as error:
        last = [Row(OURS, None, str(error))]

    if (version := figaroh_version(python)) is None:
        rows.append(Row("figaroh", None, "not installed: --figaroh PYTHON names who has it"))
    else:
        job, levels = CalibrationJob.load(path), ("joint_offset", "full_params")
        ways = {level: partial(figaroh, job, python, level) for level in levels}
        rows += rows_of_peer(f"figaroh {version}", ways)
    if folder is None or (version := version_in(folder)) is None:
        rows.append(Row("pybotics", None, "not installed: --pybotics FOLDER names where it is"))
    else:
        ways = {
            residuals: partial(
                alone, partial(of_pybotics, folder=folder, residuals=residuals), path
            )
            for residuals in ("distances", "coordinates")
        }
        rows += rows_of_peer(f"pybotics {version}", ways)
    rows += rows_of_peer("plain SciPy", {"": partial(alone, plain, path)})
    last += rows_of_peer(OURS, {"as stated": partial(alone, as_stated, path)})
    for other in sorted(path.parent.glob("calibration_*.yaml")):
        _, after, _ = alone(ours, other)
        last.append(Row(f"{OURS}, `{other.name}`", after))
    return [*rows, *last], sentence


def rows_of_peer(name: str, ways: Mapping[str, Callable[[], Answer]]) -> list[Row]:
    """A row for each way to use a peer; one alone where all of them fail for the same reason."""
    rows = list[Row]()
    for way, solve in ways.items():
        shown = f"{name}, {way}" if way else name
        try:
            rows.append(Row(shown, solve()))
        except CannotRunError as error:
            rows.append(Row(shown, None, str(error)))
        except Exception as error:  # noqa: BLE001 (a peer that fails is a result)
            rows.append(Row(shown, None, f"{type(error).__name__}: {error}".splitlines()[0]))
    alike = {row.why for row in rows} if all(row.answer is None for row in rows) else set[str]()
    return [Row(name, None, *alike)] if len(alike) == 1 else rows


def compared(rows: Sequence[Row]) -> dict[str, Row]:
    """Who stands in the summary: of figaroh's levels the better, of ours the job itself.

    Of several jobs of ours it is not the better one: who chooses by held-out errors has held
    nothing out.
    """
    found = {}
    for name, shown in PEERS.items():
        mine = [r for r in rows if (r.name == name if name == OURS else r.name.startswith(name))]
        if mine:
            found[shown] = min(mine, key=lambda row: row.rms)
    return found


def summary(sections: Mapping[str, Sequence[Row]], units: Mapping[str, IntArray]) -> str:
    """RMS of everybody on every set, and what it says of ours: the best is bold."""
    shown = list(PEERS.values())
    lines = [
        f"| held-out RMS, mm (time of the fit) | {' | '.join(shown)} |",
        "|---" + "|--:" * len(shown) + "|",
    ]
    for title, rows in sections.items():
        found = compared(rows)
        best = f"{min(row.rms for row in found.values()):.3f}"
        cells = list[str]()
        for who in shown:
            row = found.get(who)
            if row is None or row.answer is None:
                cells.append("–")
                continue
            rms = f"{row.rms:.3f}"
            took = f" ({row.answer.seconds:.1f} s)" if row.answer.seconds else ""
            says = "" if who in ("before", "ours") else against(row, found["ours"], units[title])[2]
            cells.append((f"**{rms}**" if rms == best else rms) + took + (says and f": {says}"))
        lines.append(f"| {title} | {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def units_of(terms: Sequence[Term]) -> IntArray:
    """(n,) what each held-out sample is drawn with: those of one placement together."""
    names, row = list[str](), 0
    for k, term in enumerate(terms):
        labels = term.poses.samples.labels
        for i in range(len(term.poses)):
            names.append(f"{k}/{labels['placement'][i]}" if "placement" in labels else str(row))
            row += 1
    return np.unique(names, return_inverse=True)[1]


def interval(ours: FloatArray, other: FloatArray, units: IntArray) -> tuple[float, float]:
    """95 % interval of ours minus the other's RMS, mm: the same drawn units for both."""
    count = np.bincount(units)
    drawn = np.random.default_rng(0).integers(len(count), size=(DRAWS, len(count)))
    rms = [
        np.sqrt(np.bincount(units, error**2)[drawn].sum(axis=1) / count[drawn].sum(axis=1))
        for error in (ours, other)
    ]
    low, high = np.quantile(mm(rms[0] - rms[1]), (0.025, 0.975))
    return float(low), float(high)


def against(row: Row, mine: Row, units: IntArray) -> tuple[str, str, str]:
    """Ours minus a row: the difference of the RMS, its interval, and what they say."""
    if row is mine or row.answer is None or mine.answer is None:
        return "–", "–", "–"
    low, high = interval(mine.answer.errors, row.answer.errors, units)
    says = "ours better" if high < 0 else "ours worse" if low > 0 else "within chance"
    # Both stop at the same minimum: an interval far below the last digit shown.
    says = "level" if max(abs(low), abs(high)) < LEVEL_MM else says
    says = says if units.max() + 1 >= FEWEST_DRAWN else "too few to say"
    return f"{mine.rms - row.rms:+.3f}", f"{low:+.3f} to {high:+.3f}", says


def picture(rows: Sequence[Row], title: str, file: Path) -> None:
    """Held-out errors of everybody: the part of the samples that is within an error."""
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = file.stem
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(7, 3.6), layout="constrained")
    for row in rows:
        if row.answer is not None:
            error = np.sort(mm(row.answer.errors))
            part = np.arange(1, len(error) + 1) / len(error)
            width, style = (2.5, "-") if "ours" in row.name else (1.5, "--")
            axis.step(error, part, style, where="post", linewidth=width, label=plainly(row.name))
    axis.set(xscale="log", xlabel="held-out error, mm", ylabel="part of the samples", title=title)
    axis.grid(alpha=0.3)
    axis.legend(fontsize="small", loc="best")
    figure.savefig(file, metadata={"Date": None})
    plt.close(figure)


def known(path: Path) -> Source:
    """What is known of a job's data."""
    name = path.parent.name
    return SOURCES.get(SAME.get(name, name), Source(name, "Given to this run."))


def section(path: Path, rows: Sequence[Row], units: IntArray, sentence: str, out: Path) -> str:
    """A job's part of the page."""
    name, source = path.parent.name, known(path)
    image = out.with_name(out.stem) / f"{name}.svg"
    image.parent.mkdir(exist_ok=True)
    picture(rows, source.title, image)
    mine = compared(rows)["ours"]
    lines = [
        f"## {source.title}",
        "",
        source.about,
        "",
        f"| held out | {' | '.join((*HEADS, *AGAINST))} |",
        "|---" + "|--:" * (len(HEADS) + len(AGAINST)) + "|",
        *(
            f"| {row.name} | {' | '.join((*row.cells, *against(row, mine, units)))} |"
            for row in rows
        ),
        "",
        *(f"* published: {line}" for line in source.published),
        *(
            f"* {plainly(row.name)}: {row.answer.note}"
            for row in rows
            if row.answer and row.answer.note
        ),
        *(f"* {plainly(row.name)}: no answer: {row.why}" for row in rows if row.answer is None),
        *([f"* our own verdict: {sentence}"] if sentence else []),
        "",
        f"![held-out errors]({out.stem}/{image.name})",
        "",
    ]
    table = number_table(source.title, "held out", *HEADS)
    for row in rows:
        table.add_row(plainly(row.name), *row.cells)
    Console(width=110).print(table)
    return "\n".join(lines)


def jobs(folders: Sequence[Path]) -> Iterator[Path]:
    """The jobs that are there, each once: kept, beside the repository, given."""
    seen = set[str]()
    for folder in (KEPT, BESIDE, *folders):
        found = sorted({*folder.glob("calibration.yaml"), *folder.glob("*/calibration.yaml")})
        if not found and folder in folders:
            sys.exit(
                f"{folder}: found no calibration.yaml there or one folder below; expected a job or "
                "a folder of jobs"
            )
        for path in found:
            if (path.parent / "simulation.yaml").is_file():
                continue  # nobody measured it
            name = SAME.get(path.parent.name, path.parent.name)
            if name not in seen:
                seen.add(name)
                yield path


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--figaroh", default=sys.executable, metavar="PYTHON")
    parser.add_argument("--pybotics", type=Path, metavar="FOLDER")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "measured.md")
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    parts, sections, units = list[str](), dict[str, list[Row]](), dict[str, IntArray]()
    for path in list(jobs(given.folders)):  # a folder without jobs is refused before anything runs
        validation = CalibrationJob.load(path).validation
        if not validation:
            parts.append(f"## {path.parent.name}\n\nLeft out: the job has no validation.\n")
            continue
        rows, sentence = rows_of(path, given.figaroh, given.pybotics)
        title = known(path).title
        sections[title], units[title] = rows, units_of(validation)
        parts.append(section(path, rows, units[title], sentence, given.out))
    header = HEADER.format(python=platform.python_version(), machine=platform.machine())
    parts = [header, summary(sections, units), CHANCE, *parts]
    given.out.write_text("\n".join(parts), encoding="utf-8")
    print(f"Written to {given.out}")


if __name__ == "__main__":
    main()
