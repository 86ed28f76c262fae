"""The terms of a job: read from the files of its rows, and held against each other."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

from suta_calib.errors import (
    EmptyCellError,
    InputError,
    JobError,
    MissingColumnError,
    SamplesError,
    SutaCalibWarning,
)
from suta_calib.job.schema import JobSpec, ObservationSpec
from suta_calib.measurements import (
    Artefact,
    Samples,
    read_artefact,
    read_samples,
)
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.measurements.sample_files import TIME, has_column, has_readings
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Parameter
from suta_calib.model.robot import Robot
from suta_calib.model.urdf_tree import read_tree
from suta_calib.terms import KINDS, ArmPoses, Noise, Setup, Term
from suta_calib.terms.poses import joint_ranges
from suta_calib.terms.several_chains import labelled
from suta_calib.trust.patterns import may_read_alike
from suta_calib.words import seen_from


def read_arm_samples(
    arm: ArmModel,
    files: Sequence[Path],
    kind: str,
    *,
    time: bool = False,
    settings: Mapping[str, Any] | None = None,
) -> Samples:
    """Samples of an arm for one kind of observation, perhaps with the time of each."""
    felt = [sensor.columns for sensor in arm.tilt_sensors]
    columns = KINDS[kind].columns_in(settings or {})
    return read_samples(files, joint_ranges(arm), replace(columns, time=time), felt)


def read_term(
    mechanism: ArmModel | Robot,
    row: ObservationSpec,
    job: Path,
    *,
    fitted: bool = False,
    artefact: Callable[[Path], Artefact] = read_artefact,
) -> Term:
    """The term of one row of a job, over the arm at nominal, its samples read.

    Args:
        mechanism: whose readings they are; of a robot, the chain that the row names.
        row: the row, checked.
        job: the file it stands in, for messages.
        fitted: whether the samples must be enough to be fitted.
        artefact: reads one.

    Raises:
        InputError: samples or artefact that cannot be used.
    """
    name = seen_from(row.chain, row.base_chain)
    # With the readings of other chains too, where the file has them: these arms hang on joints that
    # yield.
    arm = mechanism.laid_out[name] if isinstance(mechanism, Robot) else mechanism
    try:
        samples = read_arm_samples(
            *(arm, row.sample_files, row.kind), time=_timed(row), settings=row.settings
        )
    except (EmptyCellError, MissingColumnError) as error:
        hint = _of_other_chain(mechanism, name, error) if isinstance(mechanism, Robot) else ""
        if not hint:
            raise
        raise SamplesError.of(error, error.file, error.line, hint=hint) from None
    setup = Setup(
        None if row.artefact is None else artefact(row.artefact),
        _noise(row.sigma_m, row.huber_m, row.sigma_fixed),
        _noise(row.sigma_rad, row.huber_rad, row.sigma_fixed),
        row.label,
        row.seating,
        row.settings,
    )
    try:
        if row.exclude is not None:
            samples = row.exclude.remaining(samples)
        term = KINDS[row.kind].over(ArmPoses(arm, samples), setup)
        term = replace(term, given=row.given) if row.given else term
        term = replace(term, scale=row.scale) if row.scale else term
        if samples.time is not None:
            term = replace(term, time_offset=row.time_offset)
        elif row.time_offset is not None:
            warnings.warn(
                f"{job}:{row.line}: samples without a column time, although the clock of "
                f"{row.label} has a time offset. It is not applied to them: right for an arm that "
                "rested at each row",
                SutaCalibWarning,
                stacklevel=3,
            )
        term.check_given()
        if fitted:
            term.check_enough()
    except InputError as error:
        raise placed(error, job, row.line) from None
    if isinstance(mechanism, Robot):
        term = labelled(term, arm)
        if not row.base_chain and (moved := _moving_base(arm, row.sample_files)):
            warnings.warn(
                f"{job}:{row.line}: the base '{arm.chain.base}' of chain {row.chain} moves with "
                f"{moved}, whose readings change in the samples. What is seen or touched must then "
                "move with that base too; if it stands beside the robot, leave out base",
                SutaCalibWarning,
                stacklevel=3,
            )
    for note in term.notes:
        warnings.warn(f"{job}:{row.line}: {note}", SutaCalibWarning, stacklevel=3)
    return term


def _moving_base(arm: ArmModel, files: Sequence[Path]) -> str:
    """A joint before the base of a chain whose readings change in its samples; empty for none."""
    before = [joint.name for joint in read_tree(*arm.urdf).path_to_root(arm.chain.base)]
    for table in map(read_csv_table, files if before else ()):
        for name in (name for name in before if name in table.columns):
            # A column that nothing needs may lack numbers.
            with suppress(SamplesError):
                # Less than any joint moves on purpose, rad or m.
                if np.ptp(table.numbers(name)) > 1e-3:
                    return name
    return ""


def _of_other_chain(robot: Robot, chain: str, error: SamplesError) -> str:
    """What to do about a file that lacks readings of its chain and may be of another one."""
    if isinstance(error, EmptyCellError):
        return (
            "fill in the reading, or delete the row; if these are rows of two chains in one file, "
            "give each chain a file of its own"
        )
    assert error.file is not None
    ranges = {name: joint_ranges(arm) for name, arm in robot.laid_out.items()}
    suits = [name for name, joints in ranges.items() if has_readings(error.file, joints)]
    between = {seen_from(*pair) for pair in permutations(robot.chains, 2)}
    other_keys = " or ".join(name for name in suits if name not in between)
    if not other_keys or chain in suits:
        return ""
    remedy = "" if chain in between else f"write chain: {other_keys}, or "
    return f"the file has the joints of {other_keys}: {remedy}name another file"


def _timed(row: ObservationSpec) -> bool:
    """Whether the times of its samples are read."""
    if row.time_offset is None:
        return False
    return row.time or all(has_column(path, TIME) for path in row.sample_files)


def held_together(
    spec: JobSpec, observations: Sequence[Term], validation: Sequence[Term]
) -> tuple[tuple[Term, ...], tuple[Term, ...]]:
    """The terms of a job, to fit and held out, as they are beside each other.

    Rows that say two things of the same, and fitted samples that stand in two rows, are refused.
    """
    _check_once(spec, observations)
    _check_given_alike(spec, observations, validation)
    terms = (*observations, *validation)
    _check_shared(spec, terms)
    terms = tuple(term.beside(terms) for term in terms)
    return terms[: len(observations)], terms[len(observations) :]


def _given_unknowns(terms: Sequence[Term]) -> dict[str, Parameter]:
    """Own unknowns of which a given pose says something."""
    return {
        p.name: p
        for term in terms
        if term.given
        for p in term.unknowns
        if p not in term.own_parameters
    }


def _check_given_alike(
    spec: JobSpec, observations: Sequence[Term], validation: Sequence[Term]
) -> None:
    """Refuse a pose of a held-out row that would go unheard: what is fitted keeps its place."""
    fitted = {p.name for term in observations for p in term.own_parameters}
    given = _given_unknowns(observations)
    for row, term in zip(spec.validation, validation, strict=True):
        for name, parameter in _given_unknowns([term]).items():
            if name in fitted and given.get(name) != parameter:
                raise JobError(
                    f"a given pose that differs from that of the observations in {name}",
                    "one pose per place",
                    file=spec.path,
                    line=row.line,
                    hint=(
                        "give it in the row of the observations; or, if it stands elsewhere, give "
                        "it another label"
                    ),
                )


def _check_shared(spec: JobSpec, terms: Sequence[Term]) -> None:
    """Refuse rows that share a camera or a board, and say two things of it."""
    rows = (*spec.observations, *spec.validation)
    for k, (row, term) in enumerate(zip(rows, terms, strict=True)):
        for before in terms[:k]:
            try:
                term.check_beside(before)
            except SamplesError as error:
                raise placed(error, spec.path, row.line) from None


def _check_once(spec: JobSpec, terms: Sequence[Term]) -> None:
    """Refuse rows of a job that are one another's samples: they would count twice."""
    if len(terms) < 2:
        return
    rows_by_kind: dict[str, list[tuple[int, set[bytes]]]] = {}
    for k, (row, term) in enumerate(zip(spec.observations, terms, strict=True)):
        keys = set(term.poses.samples.as_keys())
        for other, theirs in rows_by_kind.setdefault(row.kind, []):
            both = len(keys & theirs)
            # Touches of one point may happen to read alike, a few of them, by coarse encoders.
            few = max(1, min(len(keys), len(theirs)) // 2)
            if both > (few if may_read_alike(term.poses.samples) else 1):
                raise JobError(
                    f"{both} samples that are in observations[{other}] too",
                    "other samples in every row of the same kind",
                    file=spec.path,
                    line=row.line,
                    where=f"observations[{k}].samples",
                    hint="name every file only once",
                )
        rows_by_kind[row.kind].append((k, keys))


def placed(error: InputError, job: Path, line: int | None) -> InputError:
    """The same error with a place in the job, for what was found without knowing of files."""
    return error if error.file is not None else JobError.of(error, job, line)


def _noise(sigma: float | None, huber: float | None, fixed: bool) -> Noise:
    return Noise(sigma, math.inf if huber is None else huber, fixed and sigma is not None)
