"""A print that is longer along one axis than its file says: paper that was fed too fast."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.measurements import Artefact, Board
from suta_calib.terms.length_scale import is_stretch
from suta_calib.terms.term import Term
from suta_calib.trust import AddedVariable, Effect, Evidence, Examination, SpoiltData, Truth
from suta_calib.trust.examination import STEP


class Stretch(AddedVariable):
    """All x of an artefact or board are longer by one factor, all y by another: two numbers.

    What is common to both is the scale, which free lengths of the arm take up; the difference of
    the two is determined as soon as the body was met in more than one attitude.
    """

    name = "stretched body"
    about = "A print is longer along x or along y than its file states."
    # A board 0.4 % too long along x explains 18 % of the squared residuals of 20 pictures whose
    # corners scatter by 0.1 mm (simulated), and its ± is 0.04 %: few other things stretch a body.
    worth = 0.05

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each artefact and board."""
        bodies: dict[str, list[int]] = {}
        for k, term in enumerate(answer.problem.terms):
            body = body_of(term)
            if body is not None and not any(is_stretch(p) for p in term.own_parameters):
                bodies.setdefault(_called(body), []).append(k)
        for called, places in bodies.items():
            columns = (
                _by_certified(answer, places)
                if answer.problem.terms[places[0]].touched
                else (_by_board(answer, places))
            )
            # Along x and y, how far a sheet or a shrunk part may be off: two standard deviations of
            # the grade `printed` (`measurements.scale.GRADES`).
            yield Effect(called, columns, np.full(2, 0.01), about=called)

    def sentence(self, evidence: Evidence) -> str:
        """Which body, and how much longer x is than y."""
        difference = np.array([1.0, -1.0])
        more = float(difference @ evidence.size)
        std = float(np.sqrt(difference @ evidence.covariance @ difference))
        longer, other = ("x", "y") if more > 0 else ("y", "x")
        return (
            f"The {evidence.effect.about} seems to be stretched: the data agree better if its "
            f"lengths along {longer} are {100 * abs(more):.2f} ± {100 * std:.2f} % longer than its "
            f"file states, relative to those along {other}. Measure it with a caliper along both "
            "axes, or estimate the stretch (stretch: free in its file)."
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """A file that says 0.3 % too little along x, and as much too much along y."""
        body = body_of(data)
        if body is None:
            raise SamplesError(f"the kind {data.kind}", "a kind with an artefact or a board")
        size = 0.003 * np.array([1.0, -1.0]) * rng.choice([-1.0, 1.0])
        wrong = stretched(data, (1.0 / (1.0 + size[0]), 1.0 / (1.0 + size[1])))
        return SpoiltData(wrong, size, _called(body))


def body_of(term: Term) -> Artefact | Board | None:
    """The artefact or the board that a term looks at."""
    if term.touched is not None:
        return term.touched
    board = getattr(term, "board", None)
    return board if isinstance(board, Board) and term.poses.samples.pixels is not None else None


def _by_certified(answer: Examination, places: Sequence[int]) -> FloatArray:
    """(m, 2) derivative of the whitened rows by a stretch of an artefact along x and y."""
    mine = [b for k in places for b in answer.problem.terms[k].blocks]
    columns = []
    for r in answer.rows:
        block, (n, size) = r.line.view.block, r.line.residual.shape
        column = np.zeros((n, size, 2))
        if block.certified is not None and any(block is b for b in mine):
            # A key ends with the landmark's coordinates.
            position = np.array([key[2:4] for key in block.certified.keys], dtype=float)
            moved = position[block.certified.marks]
            column = np.einsum("ndkc,nkc->ndc", block.certified.derivative[..., :2], moved)
        columns.append((column / r.line.sigma[:, None, None]).reshape(n * size, 2))
    return np.vstack(columns)


def _by_board(answer: Examination, places: Sequence[int]) -> FloatArray:
    """The same of a board."""
    columns = [
        answer.by_terms(
            [
                stretched(term, along) if k in places else term
                for k, term in enumerate(answer.problem.terms)
            ]
        )
        for along in ((1.0 + STEP, 1.0), (1.0, 1.0 + STEP))
    ]
    return np.hstack(columns)


def _called(body: Artefact | Board) -> str:
    return f"artefact {body.name}" if isinstance(body, Artefact) else f"board ({body.type})"


def stretched(term: Term, along: tuple[float, float]) -> Term:
    """The term with the x and the y of its artefact's or board's points times two factors."""
    body, factors = body_of(term), np.array([*along, 1.0])
    if isinstance(body, Artefact):
        changed: dict[str, Any] = {"artefact": body.stretched(factors)}
    else:
        assert body is not None
        changed = {"board": body.stretched(factors)}
    return replace(term, **changed)
