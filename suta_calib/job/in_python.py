"""What a job takes that is put together in Python: terms, unknowns, and a row for each term."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from suta_calib.errors import InputError, ParameterError, did_you_mean
from suta_calib.job.schema import ObservationSpec
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import (
    GEOMETRIC,
    OFFSET,
    ParameterSet,
    Selection,
    with_usual_priors,
)
from suta_calib.model.robot import AnyArm, Robot
from suta_calib.terms import ArmPoses, Term
from suta_calib.terms.several_chains import over_chains_of

# What is unknown, as `CalibrationJob.of_terms` takes it.
Free = str | Selection | ParameterSet | Sequence[str | Selection]
# What messages call the file of a job that was put together in Python.
IN_PYTHON: Final = Path("calibrate")


def terms_over(arm: ArmModel | Robot, name: str, terms: Term | Sequence[Term]) -> tuple[Term, ...]:
    """Terms of a job in Python, all of them over its arm, or over chains of its robot."""
    where = f"calibrate: {name}"
    if not isinstance(arm, ArmModel | Robot):
        raise InputError(repr(arm), "an ArmModel or a Robot", where="calibrate: arm")
    chains = arm.arms if isinstance(arm, ArmModel) else (*arm.chains.values(), *arm.arms)
    try:
        several = (terms,) if isinstance(terms, Term) else tuple(terms)
    except TypeError:
        raise InputError(repr(terms), "terms", where=where) from None
    for term in several:
        if not isinstance(term, Term):
            hint = (
                "make one with from_arrays of its kind, such as TrackedPoint.from_arrays(arm, q, …)"
            )
            raise InputError(repr(term), "a term", where=where, hint=hint)
        if not isinstance(term.poses, ArmPoses):
            raise InputError(f"{term!r} without an arm", "a term over an arm", where=where)
        if term.poses.arm not in chains:
            hint = "read the arm once, and give it to every term and to calibrate"
            raise InputError(f"{term!r} of another ArmModel", "this arm", where=where, hint=hint)
    return several if isinstance(arm, ArmModel) else over_chains_of(arm, several)


def unknowns_of(arm: AnyArm, free: Free) -> tuple[tuple[Selection, ...], ParameterSet]:
    """Rows of a job and the parameters that they select, with usual priors."""
    if isinstance(free, ParameterSet):
        for name in free:
            if name not in arm.offered:
                hint = did_you_mean(name, arm.offered)
                raise ParameterError(repr(name), "parameters of this arm", hint=hint)
        return (), free
    several: Any = free if isinstance(free, Iterable) and not isinstance(free, str) else [free]
    given = [*several]
    bases = arm.unplaced if isinstance(arm, Robot) else ()
    rows, expected = list[Selection](), "names, globs, Selections or 'geometric'"
    if bases:
        rows.append(Selection(bases))
    rows += [row for sensor in arm.tilt_sensors for row in sensor.selections]
    if not given:
        raise ParameterError("nothing to estimate", expected, where="calibrate: free")
    for row in given:
        if not isinstance(row, str | Selection):
            raise ParameterError(repr(row), expected, where="calibrate: free")
        rows.append(row if isinstance(row, Selection) else Selection(row))
    if given != [GEOMETRIC]:
        chosen = arm.select(*rows)
        arm.check_masses_felt(chosen)
        return tuple(rows), _with_usual_priors(chosen, bases)
    rows.append(Selection(f"*.{OFFSET}"))
    chosen = arm.select(*rows)
    unlike = ParameterSet(p for n, p in chosen.items() if n not in arm.like_offsets)
    return tuple(rows), _with_usual_priors(unlike, bases)


def _with_usual_priors(chosen: ParameterSet, bases: Collection[str]) -> ParameterSet:
    """`with_usual_priors`, but of bases that may stand anywhere."""
    usual = with_usual_priors(chosen.values())
    return ParameterSet(p if name in bases else usual[name] for name, p in chosen.items())


def row_of(term: Term) -> ObservationSpec:
    """What a job's file would say of a term."""
    return ObservationSpec(
        term.kind,
        (),
        (),
        # No file: what tells artefacts apart.
        None if term.touched is None else Path(term.touched.name),
        label=getattr(term, "label", "default"),
        seating=getattr(term, "seating", None),
        given=term.given,
        scale=term.scale,
        chain=term.poses.chain,
    )
