"""``certificate.yaml``: what only the laboratory knows: who measured, and with which standards."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Final

from suta_calib.certificate.lengths import (
    EXPECTED,
    LENGTHS,
    OTHERS,
    PER_LENGTH,
    StandardsUncertainty,
    stated_uncertainty,
)
from suta_calib.display import Displayable
from suta_calib.errors import InputError
from suta_calib.measurements.fields import (
    TEXT,
    Fields,
    Value,
    fields_of,
    keyed,
    mapping,
    read_as,
    rows,
)
from suta_calib.measurements.yaml_file import KeyPath, YamlSection, read_yaml


def _range(lowest: float, highest: float, unit: str, hint: str = "") -> Value:
    """Two numbers of which the smaller is first, within what can be."""

    def read(section: YamlSection, name: str) -> tuple[float, float]:
        low, high = section.numbers(name, 2)
        if low > high:
            raise section.refuse(f"{low:g} above {high:g}", "the smaller number first", at=(name,))
        for number in (low, high):
            if not lowest <= number <= highest:
                expected = f"{lowest:g} to {highest:g} {unit}"
                raise section.refuse(f"{number:g} {unit}", expected, at=(name,), hint=hint)
        return low, high

    return Value("lowest, highest", read)


def _days(section: YamlSection, name: str, most: int) -> str:
    """One day, or the first and the last one."""
    text = section.text(name)
    found = text.split(" to ")
    expected = "a day such as 2026-11-27" + (
        ", or two such as 2026-11-26 to 2026-11-27" if most > 1 else ""
    )
    try:
        days = [date.fromisoformat(day) for day in found]
    except ValueError:
        days = []
    if not 1 <= len(days) <= most or not all(DAY.fullmatch(day) for day in found):
        raise section.refuse(text, expected, at=(name,))
    if days != sorted(days):
        raise section.refuse(text, "the earlier day first", at=(name,))
    return text


def _uncertainty(section: YamlSection, name: str) -> StandardsUncertainty:
    text = section.text(name)
    try:
        return stated_uncertainty(text)
    except ValueError:
        units = ", ".join((*LENGTHS, *PER_LENGTH, *OTHERS))
        hint = f"the units are {units}; k from 1 to 20"
        raise section.refuse(text, EXPECTED, at=(name,), hint=hint) from None


ONE_DAY: Final = Value("day", lambda section, name: _days(section, name, 1))
DAYS: Final = Value("day, or two", lambda section, name: _days(section, name, 2))
DAY: Final = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}")


@dataclass(frozen=True)
class Party(Displayable):
    """A laboratory, or who asked for the certificate."""

    name: str = keyed(TEXT, "Name.")
    address: str = keyed(TEXT, "Postal address.", "")
    accreditation: str = keyed(TEXT, "Of a laboratory: body and number of its accreditation.", "")


@dataclass(frozen=True)
class Item(Displayable):
    """What was calibrated."""

    name: str = keyed(TEXT, "What it is.")
    maker: str = keyed(TEXT, "Who made it.", "")
    model: str = keyed(TEXT, "Its type.", "")
    serial: str = keyed(TEXT, "Its serial number.", "")


@dataclass(frozen=True)
class Standard(Displayable):
    """A reference standard: an artefact, a tracker, a board."""

    name: str = keyed(TEXT, "What it is.")
    serial: str = keyed(TEXT, "Its serial number.", "")
    certificate: str = keyed(TEXT, "Number and date of its own certificate.", "")
    issued_by: str = keyed(TEXT, "Who issued that.", "")
    uncertainty: StandardsUncertainty | None = keyed(
        Value("uncertainty", _uncertainty),
        "Its uncertainty, as that certificate states it: 2 um (k = 2), or 15 um + 6 um/m (k = 2). "
        "Without k it is a standard uncertainty.",
        None,
    )
    of: str = keyed(
        TEXT,
        "Which reference of the answer it is, such as artefact, instrument or board; the only one "
        "without it.",
        "",
    )


@dataclass(frozen=True)
class Environment(Displayable):
    """Where and how warm it was."""

    place: str = keyed(TEXT, "Where it was measured.", "")
    temperature_c: tuple[float, float] | None = keyed(
        _range(-50.0, 80.0, "°C", "kelvins less 273.15 are degrees Celsius"),
        "Of the air, degrees Celsius.",
        None,
    )
    humidity_pct: tuple[float, float] | None = keyed(
        _range(0.0, 100.0, "%"), "Relative, per cent.", None
    )
    remarks: str = keyed(TEXT, "What else may have mattered.", "")


def _limits(section: YamlSection, name: str) -> dict[str, float]:
    below = section.section(name)
    return {str(key): below.number(str(key), "positive") for key in below.data}


@dataclass(frozen=True)
class Details(Displayable):
    """What only the laboratory knows; what it leaves out is a blank line on the paper."""

    number: str = keyed(TEXT, "Number of the certificate.", "")
    issued_on: str = keyed(ONE_DAY, "Day of issue, as 2026-11-27.", "", name="date")
    received_on: str = keyed(ONE_DAY, "Day on which the item was received.", "")
    measured_on: str = keyed(
        DAYS, "Day of the measurement, or first and last: 2026-11-26 to 2026-11-27.", ""
    )
    laboratory: Party | None = keyed(mapping(Party), "Who measured.", None)
    customer: Party | None = keyed(mapping(Party), "Who asked for it.", None)
    item: Item | None = keyed(mapping(Item), "What was calibrated.", None)
    environment: Environment | None = keyed(mapping(Environment), "The conditions.", None)
    standards: tuple[Standard, ...] = keyed(
        rows(lambda section: read_as(Standard, section), fields_of(Standard)),
        "Reference standards.",
        (),
    )
    limits: Mapping[str, float] = keyed(
        Value("numbers by name", _limits),
        "Limits to decide on, such as validation_rms_mm: 0.5. A name that the answer does not have "
        "is refused with a list of those that it has.",
        dict,
    )
    operator: str = keyed(TEXT, "Who measured, by name.", "")
    approved_by: str = keyed(TEXT, "Who signs, by name.", "")
    section: YamlSection | None = None

    @property
    def path(self) -> Path | None:
        """The file that states them."""
        return self.section.document.path if self.section else None

    def refuse(self, problem: str, expected: str, at: KeyPath, hint: str = "") -> InputError:
        """Error about a value of the file, to be raised by the caller."""
        if self.section:
            return self.section.refuse(problem, expected, at=at, hint=hint)
        return InputError(problem, expected, where=".".join(map(str, at)), hint=hint)


DETAILS_KEYS: Final[Fields] = fields_of(Details)


def read_details(path: Path) -> Details:
    """Read a ``certificate.yaml``.

    Raises:
        InputError: unreadable, or with keys or values that it cannot have.
    """
    section = YamlSection(read_yaml(path), InputError)
    details = read_as(Details, section, section=section)
    earlier = ""
    for name, days in (
        ("received_on", details.received_on),
        ("measured_on", details.measured_on),
        ("date", details.issued_on),
    ):
        first, last = days.split(" to ")[0], days.split(" to ")[-1]
        if days and first < earlier:
            raise section.refuse(first, f"no day before {earlier}", at=(name,), hint=ORDER)
        earlier = last or earlier
    return details


ORDER: Final = "an item is received, then measured, then its certificate is issued"
TO_BE_GIVEN: Final = "to be given"
# All that can be stated.
EXAMPLE: Final = """\
number: 2026-001
date: "2026-11-27"
received_on: "2026-11-25"
measured_on: "2026-11-26"
laboratory: {name: Name, address: "Street, town, country"}
customer: {name: Name, address: "Street, town, country"}
item: {name: measuring arm, maker: Maker, model: Model, serial: "0001"}
environment:
  place: Room
  temperature_c: [19.8, 20.4]
  humidity_pct: [40, 50]
standards:
  - {name: artefact, serial: "0001", certificate: "number, day", issued_by: Laboratory,
     uncertainty: "2 um + 3 um/m (k = 2)"}
limits: {validation_rms_mm: 0.5}
operator: Name
approved_by: Name
"""


def details_to_fill_in() -> str:
    """Such a file, with everything commented out but the number, which is yet to be given."""
    about = (
        "# What a certificate says beside the results:\n"
        "#   suta-calib certificate RESULT --details THIS_FILE --out certificate.pdf\n"
        "# Remove the # in front of what you state. The rest is a blank line on the paper.\n"
    )
    _, *others = EXAMPLE.splitlines()
    return about + f'number: "{TO_BE_GIVEN}"\n' + "".join(f"# {line}\n" for line in others)
