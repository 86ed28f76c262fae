"""What the user probably meant: a hint for error messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """``did you mean 'x'?`` for the known word closest to ``word``, upper or lower case alike.

    Returns an empty string where nothing is close, so that the answer can go straight into
    `InputError`'s ``hint``.
    """
    by_lower_case = {name.lower(): name for name in known}
    close = difflib.get_close_matches(word.lower(), by_lower_case, n=1)
    return f"did you mean {by_lower_case[close[0]]!r}?" if close else ""
