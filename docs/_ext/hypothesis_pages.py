"""What an answer is tested for: every hypothesis, as it says of itself."""

from __future__ import annotations

from collections.abc import Iterator

from markdown_pieces import first_paragraph, table

from suta_calib.registry import shipped
from suta_calib.terms import KINDS
from suta_calib.trust.evidence import Rule
from suta_calib.trust.hypothesis import Hypothesis, known_hypotheses


def hypotheses_page() -> Iterator[str]:
    """The table of all hypotheses, and the one rule that they share."""
    rule = Rule()
    yield "# What an answer is tested for\n\n"
    yield (
        "After a fit has converged, one statistical test looks for errors that the model lacks "
        "(`suta_calib/trust/evidence.py`). It adds the derivatives of such an error to the fit, "
        "and estimates its size together with all parameters. The drop in the squared residuals "
        "is compared with the remaining noise. The strongest effect is reported under three "
        "conditions: all tests of one answer together give a false alarm in at most "
        f"{rule.false_alarm:g} of sound answers; it explains {rule.share:.0%} of the "
        "squared residuals (or less where the hypothesis says so); and its size is "
        f"{rule.times_std:g} times its standard deviation.\n\n"
    )
    rows = (
        (name, each.about, where(each), first_paragraph(type(each)))
        for name, each in shipped(known_hypotheses()).items()
    )
    yield table(("hypothesis", "what is wrong", "commands", "how it is described"), rows)


def where(hypothesis: Hypothesis) -> str:
    """The kinds of observation and the commands that can have it."""
    commands = (
        "`calibrate`, `extend`" if hypothesis.needs_arm else "`pivot`, `hand-eye`, `register`"
    )
    kinds = [
        f"`{name}`"
        for name, kind in shipped(KINDS).items()
        if any(issubclass(kind, one) for one in hypothesis.applies_to)
    ]
    return commands if len(kinds) == len(shipped(KINDS)) else f"{commands} over {', '.join(kinds)}"
