"""What planning is worth: the planned set beside the thesis' grid and beside random sets.

Everything is simulated: the SUTA with the thirteen errors of `data/suta/simulation.yaml`, its five
flat placements on a table with three repeats each (225 samples), and sets of five candidates of as
many samples from the planner's pool. Predicted: from the Jacobian alone. Simulated: calibrations of
samples with seating and encoder noise; the error of the tip over the region, after the best rigid
registration, root mean square over postures and trials. What a calibration holds stays at nominal,
in both.

    python benchmarks/bench_plan.py [--sets 200] [--trials 5]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from suta_calib import (
    KINDS,
    ArmPoses,
    CalibrationJob,
    InverseKinematics,
    Noise,
    Problem,
    Samples,
    SolverOptions,
    Term,
    solve,
)
from suta_calib.analysis.planning import (
    Candidate,
    Design,
    Placement,
    Pool,
    Reach,
    Region,
    SharedInformation,
    SharedUnknowns,
    Situation,
    best_set,
    candidate_information,
    candidate_pool,
    forecast,
    no_information,
    random_sets,
    tip_weight,
)
from suta_calib.arrays import FloatArray
from suta_calib.geometry import register_points, rotation_from_vector
from suta_calib.simulation import Targets, read_simulation, true_values
from suta_calib.terms import Setup
from suta_calib.threads import single_threaded
from suta_calib.trust import Sensitivity

SUTA = Path(__file__).resolve().parent.parent / "data" / "suta"
SET_SIZE = 5
# A job's thirteen: what else is wrong with the simulated arm would hide what is looked at here.
SEATING, SEATING_ANGLE, ENCODER = 0.167e-3, np.radians(0.05), np.radians(0.001)


@dataclass(frozen=True, eq=False)
class Scene:
    """A pool of candidates, the thesis' grid first in it, with what each tells and simulates.

    Attributes:
        truth: true values of the arm.
        candidates: the grid's placements, then the planner's pool.
        grid: how many of them are the grid's.
        told: information of each.
        readings: (trials, touches, joints) of each.
    """

    job: CalibrationJob
    situation: Situation
    region: Region
    space: SharedUnknowns
    tip: Sensitivity
    truth: dict[str, float]
    candidates: tuple[Candidate, ...]
    grid: int
    information: tuple[SharedInformation, ...]
    readings: tuple[FloatArray, ...]

    @property
    def pool(self) -> list[int]:
        """Numbers of the planner's candidates."""
        return list(range(self.grid, len(self.candidates)))

    def design(self, rows: Sequence[int]) -> Design:
        """A choice among some of the candidates."""
        weight = tip_weight(self.space, self.tip)
        information = [self.information[k] for k in rows]
        return Design.over(self.space, information, weight, "tip", no_information(self.space))

    def planned(self, rows: Sequence[int], size: int = SET_SIZE) -> list[int]:
        """The best set of some of the candidates."""
        return [rows[k] for k in best_set(self.design(rows), no_information(self.space), size)]

    def predicted(self, rows: Sequence[int]) -> float:
        """Uncertainty of the tip with held parameters exact, m."""
        information = sum((self.information[k] for k in rows), no_information(self.space))
        return forecast(self.space, information, self.tip).tip_estimated

    def simulated(self, rows: Sequence[int]) -> FloatArray:
        """(trials,) root mean square error of the tip over the region, m."""
        return np.array([self._trial(rows, k) for k in range(len(self.readings[0]))])

    def _trial(self, rows: Sequence[int], trial: int) -> float:
        terms = self._terms(rows, trial)
        solution = solve(Problem(terms, self.job.parameters), SolverOptions(starts=1))
        arm = self.job.arm
        _, true = arm.forward(self.tip.q, self.truth)
        _, found = arm.forward(self.tip.q, solution.values)
        R, p = register_points(found, true)
        return float(np.sqrt(np.mean(np.sum((found @ R.T + p - true) ** 2, axis=1))))

    def _terms(self, rows: Sequence[int], trial: int) -> list[Term]:
        terms: list[Term] = []
        chosen = [(self.candidates[k], self.readings[k][trial]) for k in rows]
        placed = [pair for pair in chosen if isinstance(pair[0].place, Placement)]
        points = [pair for pair in chosen if not isinstance(pair[0].place, Placement)]
        if placed:
            labels = {
                "placement": [c.name for c, q in placed for _ in q],
                "repeat": [str(k // len(c.marks)) for c, q in placed for k in range(len(q))],
                "landmark": [c.marks[k % len(c.marks)] for c, q in placed for k in range(len(q))],
            }
            terms.append(self._term("pairwise_distance", placed, labels))
        if points:
            labels = {"point": [c.name for c, q in points for _ in q]}
            terms.append(self._term("fixed_point", points, labels))
        return terms

    def _term(
        self,
        kind: str,
        chosen: Sequence[tuple[Candidate, FloatArray]],
        labels: dict[str, list[str]],
    ) -> Term:
        q = np.vstack([readings for _, readings in chosen])
        samples = Samples.from_arrays(self.job.arm.joints, q, labels=labels)
        setup = Setup(self.situation.artefact, Noise(None, 1.35e-3))
        return KINDS[kind].over(ArmPoses(self.job.arm, samples), setup)


@single_threaded
def scene(trials: int, pool: Pool, seed: int = 0) -> Scene:
    """Make the grid and the pool, and simulate every candidate ``trials`` times."""
    spec = read_simulation(SUTA / "simulation.yaml")
    job = CalibrationJob.load(SUTA / "calibration.yaml")
    everything = true_values(job.arm, spec, spec.seed)
    truth = {p.name: p.nominal for p in job.arm.parameters.values()}
    truth |= {name: everything[name] for name in job.parameters.names}
    nominal = Problem(job.observations, job.parameters)
    x = nominal.start(truth)
    # As repeats of a touch scatter: a distance has the noise of two.
    sigma = float(np.sqrt(2.0) * np.hypot(SEATING, 0.25 * ENCODER))
    situation = Situation(nominal, x, (sigma,), True)
    (grid_set,) = [s for s in spec.sets if s.name == "calibration"]
    grid = [Placement(n, p.position, p.rotation) for n, p in grid_set.places.items()]
    region = Region.around(situation)
    repeats = situation.repeats
    places = [*grid, *candidate_pool(situation, region, pool, repeats, seed)]
    reached = Reach(situation, repeats, seed).candidates(places)
    space = SharedUnknowns.of(situation)
    information = tuple(candidate_information(situation, space, c) for c in reached.candidates)
    tip = region.sensitivity(situation, space.names, seed)
    names = [place.name for place in grid]
    found = [c.name for c in reached.candidates[: len(grid)]]
    assert found == names, f"the grid is out of reach: {sorted(set(names) - set(found))}"
    readings = _simulated(situation, reached.candidates, truth, trials, seed)
    return Scene(
        *(job, situation, region, space, tip, truth, reached.candidates, len(grid), information),
        readings,
    )


def _simulated(
    situation: Situation,
    candidates: Sequence[Candidate],
    truth: dict[str, float],
    trials: int,
    seed: int,
) -> tuple[FloatArray, ...]:
    """Readings (trials, touches, joints) of each candidate, with seating and encoder noise."""
    kinematics = InverseKinematics(situation.arm.at(truth), {})
    found = []
    for k, candidate in enumerate(candidates):
        rng = np.random.default_rng([seed, k])
        q = np.tile(candidate.q, (candidate.repeats, 1))
        rotation, position = situation.arm.forward(q, truth)
        n = trials * len(q)
        where = np.tile(position, (trials, 1)) + SEATING * rng.standard_normal((n, 3))
        lean = rotation_from_vector(SEATING_ANGLE * rng.standard_normal((n, 3)))
        targets = Targets(where, np.tile(rotation, (trials, 1, 1)) @ lean)
        answer = kinematics.solve(targets, np.tile(q, (trials, 1)), rng, 4)
        noisy = answer.q + ENCODER * rng.standard_normal(answer.q.shape)
        found.append(noisy.reshape(trials, len(q), -1))
    return tuple(found)


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--trials", type=int, default=5)
    arguments = parser.parse_args()
    began = time.perf_counter()
    made = scene(arguments.trials, Pool())
    grid = list(range(made.grid))
    placements = [k for k in made.pool if made.candidates[k].place.kind == "placement"]
    flat = [k for k in placements if made.candidates[k].sort == "placement, flat"]
    rows = {
        "the thesis' grid: 5 flat placements": grid,
        "planned, flat placements only": made.planned(flat),
        "planned, placements only": made.planned(placements),
        "planned": made.planned(made.pool),
    }
    print(f"{len(made.pool)} candidates, {made.candidates[0].samples * made.grid} samples a set")
    print("tip over the region after registration, mm RMS      predicted  simulated")
    figures = {}
    for name, chosen in rows.items():
        figures[name] = (made.predicted(chosen), rms(made.simulated(chosen)))
        print(f"{name:50s} {1e3 * figures[name][0]:9.3f}  {1e3 * figures[name][1]:9.3f}")
    design = made.design(made.pool)
    sets = [[made.pool[k] for k in s] for s in random_sets(design, SET_SIZE, arguments.sets, 1)]
    random = np.array([(made.predicted(s), rms(made.simulated(s))) for s in sets])
    median = np.median(random, axis=0)
    name = f"{len(sets)} random sets, median"
    print(f"{name:50s} {1e3 * median[0]:9.3f}  {1e3 * median[1]:9.3f}")
    best = np.array(figures["planned"])
    over_grid = np.array(figures["the thesis' grid: 5 flat placements"]) / best
    print(f"planned over grid: {over_grid[0]:.2f} predicted, {over_grid[1]:.2f} simulated")
    over_random = median / best
    print(f"planned over random: {over_random[0]:.2f} predicted, {over_random[1]:.2f} simulated")
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
