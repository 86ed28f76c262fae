"""Everything that can go wrong for a reason the user can mend.

A message says what was found, where, what was expected and what to do about it, in one line:
``FILE:LINE: WHERE: found X; expected Y; HINT``. The command line prints it and exits with
`SutaCalibError.exit_code`; nobody is shown a traceback for bad input.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Self


class SutaCalibWarning(UserWarning):
    """Something that can be used, or done without, but that the user should look at."""


class SutaCalibError(Exception):
    """Root of every error this package raises on purpose."""

    exit_code = 2


def is_interrupt(error: BaseException) -> bool:
    """Whether it is Ctrl-C, around which CasADi's calls may put a SystemError, and another one."""
    inner: BaseException | None = error
    while isinstance(inner, SystemError):
        inner = inner.__cause__ or inner.__context__
    return isinstance(inner, KeyboardInterrupt)


class InputError(SutaCalibError):
    """Something the user gave cannot be used.

    Args:
        found: what is there ("found 'abc'" is written by this class: give only ``'abc'``).
        expected: what should be there instead.
        file: the file it was found in, if it came from one.
        line: line number in that file, from 1.
        where: the key, column, joint or row it was found at.
        hint: what to do about it.
    """

    def __init__(
        self,
        found: str,
        expected: str = "",
        *,
        file: str | Path | None = None,
        line: int | None = None,
        where: str = "",
        hint: str = "",
    ) -> None:
        self.found, self.expected, self.where, self.hint = map(
            shortened, (found, expected, where, hint)
        )
        self.file = None if file is None else Path(file)
        self.line = line
        super().__init__(self._sentence())

    @classmethod
    def of(
        cls,
        problem: InputError,
        file: Path | None,
        line: int | None,
        where: str = "",
        hint: str = "",
    ) -> Self:
        """The same with a place in a file, for what was found without knowing of files.

        What it says already of where, and of what to do, is said where nothing is given.
        """
        return cls(
            problem.found,
            problem.expected,
            file=file,
            line=line,
            where=where or problem.where,
            hint=hint or problem.hint,
        )

    def _sentence(self) -> str:
        place = "" if self.file is None else str(self.file)
        if self.line is not None:
            place += f":{self.line}" if place else f"line {self.line}"
        expected = f"expected {self.expected}" if self.expected else ""
        sentence = "; ".join(filter(None, (f"found {self.found}", expected, self.hint)))
        return ": ".join(filter(None, (place, self.where, sentence)))


class UrdfError(InputError):
    """The URDF is missing, malformed, or has no usable chain from base to tip."""


class SamplesError(InputError):
    """A samples file is missing, malformed or does not fit the arm or the artefact."""


class MissingColumnError(SamplesError):
    """A samples file has no such column."""


class EmptyCellError(SamplesError):
    """A cell of a samples file is empty where a number is needed."""


class ArtefactError(InputError):
    """The artefact file is missing, malformed or describes an impossible artefact."""


class BoardError(InputError):
    """A calibration board's file is missing, malformed or describes no board."""


class CameraError(InputError):
    """A camera's file is missing, malformed or of a camera that there is no model of here."""


class ForeignFileError(InputError):
    """A file of another program is not of the format it is read as, or says too little."""


class JobError(InputError):
    """A key of the job file is missing, unknown or has an unusable value."""


class ParameterError(InputError):
    """A parameter name, bound or prior that the arm and the terms do not support."""


class SolverError(InputError):
    """A solver that somebody gave raises, or answers something that cannot be used."""


class UnusableResultError(InputError):
    """An answer says of itself that it must not be used, and somebody would use it."""


class DeviceFileError(InputError):
    """A key of ``device.yaml`` is missing, unknown or has a value no device can have."""


class DeviceError(SutaCalibError):
    """The device on the other end of the cable, or the port it is on, does not do its part."""


class PortNotFoundError(DeviceError):
    """There is no such port; the message lists those that exist."""


class PortBusyError(DeviceError):
    """Another program has the port open."""


class PortPermissionError(DeviceError):
    """This user may not open the port."""


class DeviceSilentError(DeviceError):
    """The port is open and not a single byte comes."""


class DisconnectedError(DeviceError):
    """The port was there and is gone: cable pulled out, device switched off, connection closed."""


class WrongFormatError(DeviceError):
    """Bytes come, but not what ``device.yaml`` announces: baud rate, format or joints differ."""


class MissingExtraError(SutaCalibError):
    """A command needs a package of an optional extra that is not installed."""


class OutputError(SutaCalibError):
    """A result could not be written; nothing was left half-written."""


def shortened(text: str) -> str:
    """A text for a message, without most of what is too long to be looked at."""
    # Longer words (a number of thousands of digits, a line without blanks) are cut to so many
    # characters; no path that a message names is longer, nor a list of names than the whole.
    longest_word, shown_of_word, longest_part = 300, 40, 1500
    if len(text) <= longest_word:
        return text
    long = rf"\S{{{shown_of_word}}}\S{{{longest_word - shown_of_word},}}"
    text = re.sub(long, lambda word: f"{word[0][:shown_of_word]}…", text)
    return text if len(text) <= longest_part else f"{text[:longest_part]}…"


def did_you_mean(word: str, candidates: Iterable[str]) -> str:
    """``did you mean 'x'?`` for the known word closest to ``word``, upper or lower case alike.

    The word itself is no hint: where it is known, and wrong for another reason, there is none.
    Returns an empty string where nothing is close, so that the answer can go straight into
    `InputError`'s ``hint``.
    """
    close = close_words(word, candidates)
    return f"did you mean {close[0]!r}?" if close else ""


def close_words(word: str, candidates: Iterable[str]) -> list[str]:
    """The known word closest to ``word``, as of `did_you_mean`; none where nothing is close."""
    by_lower_case = {name.lower(): name for name in candidates if name != word}
    close = difflib.get_close_matches(word.lower(), by_lower_case, n=1)
    return [by_lower_case[name] for name in close]
