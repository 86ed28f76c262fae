"""A certificate on paper: PDF with selectable text and embedded fonts, by fpdf2."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Collection, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Literal

import matplotlib as mpl
from fpdf import FPDF
from fpdf.enums import XPos, YPos
from fpdf.fonts import FontFace, TTFFont

from suta_calib.certificate.content import CertifiedValue, Decision, ValueTable
from suta_calib.certificate.details import Party, Standard
from suta_calib.certificate.issued import Certificate
from suta_calib.errors import InputError
from suta_calib.measurements.files import read_bytes
from suta_calib.trust.uncertainty_budget import UncertaintyBudget
from suta_calib.units import NOTHING, rounded_text, std_text, unit_name

Paper = Literal["a4", "letter"]
MARGIN: Final = 20.0
# Points.
BODY: Final = 9
# What is to be filled in by hand.
BLANK: Final = "_" * 32


def pdf_bytes(
    certificate: Certificate, paper: Paper = "a4", more_signs: Path | None = None
) -> bytes:
    """The certificate as a PDF.

    Args:
        certificate: what it says.
        paper: size of the pages.
        more_signs: a font (TTF or OTF) for signs that DejaVu Sans lacks, such as Chinese ones.

    Raises:
        InputError: signs that no font has, or that are written from right to left; or no font.
    """
    sheet = _Sheet(certificate, paper)
    try:
        if more_signs is not None:
            sheet.add_signs(more_signs)
        sheet.write_all()
        sheet.refuse_lost()
        return bytes(sheet.output())
    finally:
        for font in sheet.embedded:
            font.close()


class _Sheet(FPDF):
    """Pages with the number of the certificate at the top and the page at the bottom."""

    def __init__(self, certificate: Certificate, paper: Paper) -> None:
        super().__init__(format=paper)
        self._certificate = certificate
        # Texts with signs that cannot be printed, and the first of these.
        self._lost: dict[str, str] = {}
        fonts = Path(mpl.get_data_path()) / "fonts" / "ttf"
        for style, name in (("", "DejaVuSans"), ("B", "DejaVuSans-Bold")):
            self.add_font("sans", style, fonts / f"{name}.ttf")
        self._signs = {sign for font in self.embedded for sign in font.cmap}
        self.set_margins(MARGIN, MARGIN)
        self.set_auto_page_break(auto=True, margin=MARGIN)
        self.set_title(f"{certificate.content.title}, {certificate.number}")
        self.set_creator("suta_calib")
        self.set_lang("en")
        # The same certificate is the same file.
        self.set_creation_date(datetime(1970, 1, 1, tzinfo=UTC))
        self.add_page()

    # ── signs ───────────────────────────────────────────────────────────────────────────────
    @property
    def embedded(self) -> list[TTFFont]:
        """Fonts of the document."""
        return [font for font in self.fonts.values() if isinstance(font, TTFFont)]

    def add_signs(self, path: Path) -> None:
        """Use a font for the signs that the other one lacks.

        Raises:
            InputError: it is no font.
        """
        expected = "a font, TTF or OTF"
        if read_bytes(path)[:4] not in (b"\0\1\0\0", b"true", b"OTTO"):
            raise InputError("a file that is no font", expected, file=path)
        try:
            for style in ("", "B"):
                self.add_font("more", style, path)
        except Exception as problem:  # noqa: BLE001 - whatever a broken file makes it raise
            raise InputError(f"a damaged font ({problem})", expected, file=path) from None
        self.set_fallback_fonts(["more"], exact_match=False)
        self._signs = {sign for font in self.embedded for sign in font.cmap}

    def _text(self, words: str) -> str:
        """Words that can be printed; those that cannot are noted."""
        words = " ".join(unicodedata.normalize("NFC", words).split())
        for sign in words:
            backwards = unicodedata.bidirectional(sign) in ("R", "AL")
            if backwards or ord(sign) not in self._signs:
                self._lost.setdefault(words, sign)
                return "?"
        return words

    def refuse_lost(self) -> None:
        """Refuse text of which paper would show boxes.

        Raises:
            InputError: there is such text.
        """
        certificate = self._certificate
        for words, sign in self._lost.items():
            short = words if len(words) <= 60 else f"{words[:60]}…"
            name = unicodedata.name(sign, f"U+{ord(sign):04X}")
            raise InputError(
                f"the sign {sign} ({name}) in: {short}",
                "signs of the font, written from left to right",
                file=certificate.details.path or certificate.result,
                hint="give a font that has it with --font FILE.ttf, or write it in other letters",
            )

    # ── every page ──────────────────────────────────────────────────────────────────────────
    def header(self) -> None:
        """Number of the certificate, from the second page on."""
        if self.page_no() > 1:
            self.set_font("sans", "", 8)
            self.set_text_color(90)
            number = self._text(f"Certificate {self._certificate.number}")
            # As much of it as a line holds.
            while self.get_string_width(number) > self.epw and len(number) > 1:
                number = f"{number[:-2]}…"
            self.cell(0, 5, number, align="R")
            self.ln(9)
            self.set_text_color(0)

    def footer(self) -> None:
        """Page x of y."""
        self.set_y(-15)
        self.set_font("sans", "", 7)
        self.set_text_color(90)
        words = "May be copied as a whole only. Results hold for the item as it was calibrated."
        self.cell(0, 5, words)
        self.set_x(MARGIN)
        self.cell(0, 5, f"page {self.page_no()} of {{nb}}", align="R")
        self.set_text_color(0)

    # ── parts ───────────────────────────────────────────────────────────────────────────────
    def write_all(self) -> None:
        """All sections, in the order of ISO/IEC 17025:2017, 7.8.2 and 7.8.4."""
        certificate, content = self._certificate, self._certificate.content
        self._title()
        self._who()
        self._heading("Measurand")
        self._paragraph(content.measurand)
        self._heading("Method")
        self._paragraph(content.method)
        self._conditions()
        self._standards()
        self._heading("Results", rows=_lines(content.groups[0]) + 3)
        for group in content.groups:
            self._group(group)
        self._paragraph(
            "U is the expanded uncertainty: the standard uncertainty times the coverage factor k, "
            "for a coverage of 95.45 %. A dash under U: it is not known for this figure."
        )
        for budget in content.budgets:
            self._budget(budget)
        if any(part.student for budget in content.budgets for part in budget.contributions):
            self._paragraph(
                "* These standard uncertainties are √(ν/(ν - 2)) times what scatters, because few "
                "measurements tell the scatter (ν degrees of freedom; JCGM 101:2008, 6.4.9.4). "
                "Therefore k needs no more allowance for ν: k = 2 covers 95.45 %."
            )
        if content.checked:
            self._heading("Validation")
            self._table(("what", "found"), content.checked, (6, 5))
        self._conformity(certificate.decisions)
        self._heading("Notes")
        self._paragraph(f"The software's verdict on the answer: {certificate.verdict}.")
        for note in certificate.notes:
            self._paragraph(f"• {note}")
        self._origin()
        self._signatures()

    def _title(self) -> None:
        certificate = self._certificate
        self.set_font("sans", "", 9)
        self.cell(0, 5, "Certificate", new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.set_font("sans", "B", 16)
        title = certificate.content.title
        self.multi_cell(0, 8, title, align="L", new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.set_font("sans", "", BODY)
        self.ln(2)

    def _who(self) -> None:
        details = self._certificate.details
        item = details.item
        described = (
            ", ".join(
                filter(
                    None,
                    (item.name, item.maker, item.model, item.serial and f"serial {item.serial}"),
                )
            )
            if item
            else ""
        )
        self._table(
            None,
            (
                ("number", self._certificate.number),
                ("laboratory", _party(details.laboratory)),
                ("customer", _party(details.customer)),
                ("item", described or BLANK),
                *([("received on", details.received_on)] if details.received_on else []),
                ("measured on", details.measured_on or BLANK),
                ("issued on", details.issued_on or BLANK),
            ),
            (1, 4),
        )

    def _conditions(self) -> None:
        environment = self._certificate.details.environment
        self._heading("Conditions")
        if environment is None:
            self._paragraph(f"Not stated. Place, temperature, humidity: {BLANK}")
            return
        warm, humid = environment.temperature_c, environment.humidity_pct
        rows = (
            ("place", environment.place),
            ("temperature of the air", warm and f"{warm[0]:g} to {warm[1]:g} °C"),
            ("relative humidity", humid and f"{humid[0]:g} to {humid[1]:g} %"),
            ("remarks", environment.remarks),
        )
        self._table(None, [(what, said) for what, said in rows if said], (1, 3))

    def _standards(self) -> None:
        details, content = self._certificate.details, self._certificate.content
        self._heading("Reference standards and traceability")
        if details.standards:
            self._table(
                ("standard", "of", "serial", "certificate", "issued by", "its uncertainty"),
                [
                    tuple(said or NOTHING for said in _standard(standard))
                    for standard in details.standards
                ],
                (3, 2, 2, 3, 2, 3),
            )
            self._paragraph(
                "Chain: the results rest on the lengths of these standards, and these on the SI by "
                "the certificates named."
            )
            if lacking := self._certificate.without_uncertainty:
                self._paragraph(lacking)
        else:
            self._paragraph(
                "No reference standard with a certificate is named: no metrological traceability "
                "is claimed."
            )
        for reference in content.references:
            self._paragraph(f"• {reference.sentence}.")
        for sentence in self._certificate.standards_not_included:
            self._paragraph(f"• {sentence}")

    def _group(self, group: ValueTable) -> None:
        self._heading(group.title, small=True, rows=_lines(group))
        if group.about:
            self._paragraph(group.about)
        remarks = any(one.remark for one in group.quantities)
        heads = ("quantity", "value", "U", "k", "unit", *(("remark",) if remarks else ()))
        rows = [(*_measured(one), *((one.remark,) if remarks else ())) for one in group.quantities]
        widths = (8, 5, 4, 3, 3, 17) if remarks else (6, 3, 3, 1, 1)
        self._table(heads, rows, widths, numbers={1, 2, 3})

    def _budget(self, budget: UncertaintyBudget) -> None:
        unit = budget.unit
        title = f"Uncertainty budget: {budget.of}"
        self._heading(title, small=True, rows=len(budget.contributions) + 2)
        rows: list[tuple[str, ...]] = [
            (
                part.source,
                part.evaluation,
                std_text(part.std, unit, with_unit=False),
                # Beyond it a coverage factor is that of infinitely many.
                (f"{part.freedom:.0f}" if part.freedom < 1e4 else "∞") + "*" * part.student,
            )
            for part in (*budget.contributions, budget.combined)
        ]
        rows.append(
            (
                f"expanded, k = {budget.factor:.2f}",
                "",
                std_text(budget.expanded, unit, with_unit=False),
                "",
            )
        )
        heads = ("source", "type", f"standard uncertainty, {unit_name(unit)}", "deg. of freedom")
        self._table(heads, rows, (16, 3, 12, 8), numbers={2, 3})

    def _conformity(self, decisions: Sequence[Decision]) -> None:
        if not decisions:
            return
        self._heading("Statement of conformity", rows=len(decisions) + 2)
        self._table(
            ("quantity", "value", "U", "limit", "unit", "decision"),
            [
                (
                    d.quantity.name,
                    _measured(d.quantity)[1],
                    _measured(d.quantity)[2],
                    *d.limit_text.rsplit(" ", 1),
                    d.words,
                )
                for d in decisions
            ],
            (5, 2, 2, 2, 1, 5),
            numbers={1, 2, 3},
        )
        for words in dict.fromkeys(d.about for d in decisions if d.about):
            self._paragraph(f"• {words}.")
        self._paragraph(self._certificate.content.rule)

    def _origin(self) -> None:
        certificate = self._certificate
        files = {**certificate.inputs, **certificate.outputs}
        # The signatures are on a page with it.
        self._heading("Software and data", rows=len(files) + 10)
        versions = ", ".join(f"{name} {v}" for name, v in certificate.versions.items())
        rows = [("computed with", versions), ("run", certificate.run or NOTHING)]
        self._table(None, rows, (2, 5))
        rows = [(certificate.result.name, certificate.digest)]
        rows += [(Path(name).name, digest) for name, digest in files.items()]
        self._table(("file", "SHA-256"), rows, (2, 5))

    def _signatures(self) -> None:
        details = self._certificate.details
        self._heading("Signatures", rows=4)
        self._table(
            ("", "name", "date", "signature"),
            [
                ("measured", details.operator, details.measured_on.split(" to ")[-1], ""),
                ("approved", details.approved_by, details.issued_on, ""),
            ],
            (2, 4, 2, 5),
            height=8,
            borders="ALL",
        )

    # ── what they are made of ───────────────────────────────────────────────────────────────
    def _heading(self, words: str, *, small: bool = False, rows: int = 2) -> None:
        # Never alone at the end of a page; nor is a short table broken.
        height = 10 + 5.5 * (rows + 1)
        if self.will_page_break(height if height < 0.4 * self.eph else 24):
            self.add_page()
        self.ln(2 if small else 4)
        self.set_font("sans", "B", 9.5 if small else 11)
        words = self._text(words)
        self.multi_cell(0, 5.5, words, align="L", new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.set_font("sans", "", BODY)
        self.ln(0.5)

    def _paragraph(self, words: str) -> None:
        words = self._text(words)
        self.multi_cell(0, 4.6, words, align="L", new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.ln(1)

    def _table(
        self,
        heads: Sequence[str] | None,
        rows: Sequence[Sequence[str]],
        widths: Sequence[int],
        *,
        numbers: Collection[int] = (),
        height: float = 4.6,
        borders: str = "HORIZONTAL_LINES",
    ) -> None:
        self.set_font("sans", "", 8)
        bold = FontFace(emphasis="BOLD")
        every = [
            [self._text(str(cell)) for cell in row] for row in ([heads] if heads else []) + [*rows]
        ]
        try:
            with self.table(
                every,
                col_widths=tuple(widths),
                text_align=tuple("RIGHT" if k in numbers else "LEFT" for k in range(len(widths))),
                borders_layout=borders if heads else "NONE",
                first_row_as_headings=heads is not None,
                headings_style=bold,
                line_height=height,
                padding=(0.4, 1.0),
            ):
                pass
        except ValueError:
            longest = max((cell for row in every for cell in row), key=len)
            raise InputError(
                f"a text of {len(longest)} characters: {longest[:60]}…",
                "texts that fit on a page",
                file=self._certificate.details.path or self._certificate.result,
                hint="shorten it",
            ) from None
        self.set_font("sans", "", BODY)
        self.ln(1)


def _lines(group: ValueTable) -> int:
    """How many lines a table takes with what is said above it, of some 95 letters each."""
    return len(group.quantities) + math.ceil(len(group.about) / 95)


def _party(party: Party | None) -> str:
    if party is None:
        return BLANK
    return ", ".join(filter(None, (party.name, party.address, party.accreditation)))


def _standard(one: Standard) -> tuple[str, ...]:
    stated = one.uncertainty.text if one.uncertainty else ""
    return one.name, one.of, one.serial, one.certificate, one.issued_by, stated


def _measured(one: CertifiedValue) -> tuple[str, str, str, str, str]:
    """Name, value, U, k and unit; to the last of two digits of U (JCGM 100:2008, 7.2.6)."""
    unit, spread = one.unit, one.expanded or 0.0
    value = rounded_text(one.value, spread or one.resolution or 0.0, unit)
    if one.is_uncertainty:
        value = std_text(one.value, unit, with_unit=False)
    if not spread:
        return one.name, value, NOTHING, NOTHING, unit_name(unit)
    return (
        one.name,
        value,
        std_text(spread, unit, with_unit=False),
        f"{one.factor:.2f}",
        unit_name(unit),
    )
