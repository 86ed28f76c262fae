"""Which candidates would make an unidentified parameter identified, and which none can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from suta_calib.analysis.planning.candidates import Candidate
from suta_calib.analysis.planning.information import SharedInformation, Space
from suta_calib.analysis.planning.situation import Situation
from suta_calib.diagnostics.explanation import Explanation, explain
from suta_calib.solver.solve import identify_at


@dataclass(frozen=True)
class Remedy:
    """A parameter the present data cannot tell.

    Attributes:
        parameter: its name.
        candidates: names of those that determine it, each by itself, the surest first.
        sorts: what sorts of candidates these are.
        by_all: whether all candidates together determine it; where they do not, none can.
        why: what the direction does, so that no observation sees it.
        advice: what else would help, or that nothing is needed.
    """

    parameter: str
    candidates: tuple[str, ...]
    sorts: tuple[str, ...]
    by_all: bool
    why: str
    advice: str


def remedies(
    situation: Situation,
    space: Space,
    present: SharedInformation,
    candidates: Sequence[Candidate],
    information: Sequence[SharedInformation],
) -> tuple[Remedy, ...]:
    """One for each parameter of the arm that the present data leave open.

    A candidate determines a parameter if that would no longer be held with it, and fewer would be
    held in all: of a combination, holding another one instead is no gain.

    Args:
        situation: the present data.
        space: the unknowns.
        present: what the present data tell.
        candidates: what could be added.
        information: what each would tell.
    """
    identification = space.identify(present)
    arm = set(space.names[: space.arm_count])
    names = [c.fixed for c in identification.combinations if c.fixed in arm]
    texts = _explanations(situation)
    everything = sum(information, present)
    found = []
    left = [_fixed(space, present + more) for more in information]
    left_by_all = _fixed(space, everything)
    for name in names:
        able = [
            (candidate, _curvature(space, name, more))
            for candidate, more, fixed in zip(candidates, information, left, strict=True)
            if name not in fixed and len(fixed) < len(names)
        ]
        best = [candidate for candidate, _ in sorted(able, key=lambda pair: -pair[1])]
        text = texts.get(name, Explanation(name, "", ""))
        found.append(
            Remedy(
                parameter=name,
                candidates=tuple(c.name for c in best),
                sorts=tuple(dict.fromkeys(c.sort for c in best)),
                by_all=name not in left_by_all and len(left_by_all) < len(names),
                why=text.sentence,
                advice=text.remedy,
            )
        )
    return tuple(found)


def _fixed(space: Space, information: SharedInformation) -> frozenset[str]:
    """The arm's parameters that would be held."""
    arm = set(space.names[: space.arm_count])
    return frozenset(c.fixed for c in space.identify(information).combinations if c.fixed in arm)


def _curvature(space: Space, name: str, information: SharedInformation) -> float:
    """How much a candidate alone tells of a parameter alone."""
    k = space.names.index(name)
    return float(information.curvature[k, k])


def _explanations(situation: Situation) -> Mapping[str, Explanation]:
    problem, x = situation.problem, situation.x
    identification = identify_at(problem, x, situation.sigmas)
    return {e.fixed: e for e in explain(problem, x, identification)}
