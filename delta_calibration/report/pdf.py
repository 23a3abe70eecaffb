"""Conversion of a report to PDF by fpdf2: no browser or system library; text is searchable.

The font is DejaVu Sans, which comes with matplotlib and contains all letters in use.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from delta_calibration import __version__
from delta_calibration.errors import InputError
from delta_calibration.files import written_whole
from delta_calibration.report.document import KeyFigure, Report, Section, Statement, Table
from delta_calibration.report.drawing import Figure
from delta_calibration.report.missing import required
from delta_calibration.report.picture import STYLE, draw

PURPOSE = "a PDF"
_MARGIN = 18.0  # [mm]
_INK, _SOFT, _LINE = (26, 26, 26), (95, 95, 95), (200, 200, 200)
_FONT = "DejaVu"
_BODY, _SMALL = 9.0, 7.5  # [pt]
_DPI = 200
_KEEP = 40.0  # [mm] free height required below a heading
_MANY = 8  # columns above which a table has a smaller font
_TIGHT = 6.3  # [pt]


def write_pdf(path: Path, content: bytes) -> None:
    """Write the result of `pdf_of` to a file atomically.

    Raises:
        InputError: the file cannot be written.
    """
    with written_whole(path) as beside:
        beside.write_bytes(content)


def pdf_of(report: Report) -> bytes:
    """Convert a report to PDF (A4).

    Raises:
        InputError: fpdf2 or matplotlib is not installed, or the font lacks a letter.
    """
    pdf = _new(report)
    try:
        _require_letters(pdf, report)
    except InputError:
        for font in pdf.fonts.values():  # otherwise closed by `output` only
            font.ttfont.close()
        raise
    _head(pdf, report)
    for number, section in enumerate(report.sections, start=1):
        _section(pdf, number, section)
    if not report.signatures:
        _signatures(pdf, ("Checked by", "Date"))
    return bytes(pdf.output())


def _new(report: Report) -> Any:
    fpdf = required("fpdf", PURPOSE)
    fonts = Path(required("matplotlib", PURPOSE).get_data_path()) / "fonts" / "ttf"

    class Pages(fpdf.FPDF):  # type: ignore[misc, name-defined]
        """PDF with the title and the page number in the footer."""

        def footer(self) -> None:
            self.set_y(-12)
            self.set_font(_FONT, size=_SMALL)
            self.set_text_color(*_SOFT)
            self.cell(0, 4, f"{report.title} · delta_calibration {__version__}")
            self.set_x(self.l_margin)
            self.cell(0, 4, f"page {self.page_no()} of {{nb}}", align="R")

    pdf = Pages(format="A4")
    pdf.set_margins(_MARGIN, 16.0)
    pdf.set_auto_page_break(True, margin=18.0)
    for style, name in (("", "DejaVuSans"), ("B", "DejaVuSans-Bold")):
        pdf.add_font(_FONT, style, str(fonts / f"{name}.ttf"))
    pdf.set_title(report.title)
    pdf.set_creator(f"delta_calibration {__version__}")
    pdf.add_page()
    return pdf


def _require_letters(pdf: Any, report: Report) -> None:
    """Refuse letters that the font lacks: they would be empty boxes on a signed document."""
    known = pdf.fonts[_FONT.lower()].cmap
    for text in _texts(report):
        lacking = sorted({letter for letter in text if ord(letter) not in known} - {"\n"})
        if lacking:
            raise InputError(
                f"the font of the PDF has no letters {' '.join(lacking)} (of {text!r}); write "
                "HTML and "
                "print it"
            )


def _texts(report: Report) -> Iterator[str]:
    yield from (report.title, report.subtitle, report.sentence)
    for statement in report.statements:
        yield statement.answer
    for section in report.sections:
        yield from section.text
    for table in report.tables():
        yield table.caption
        for row in table.rows:
            yield from row


def _write(
    pdf: Any, text: str, size: float = _BODY, bold: bool = False, soft: bool = False
) -> None:
    """Write a paragraph over the whole width."""
    pdf.set_font(_FONT, "B" if bold else "", size)
    pdf.set_text_color(*(_SOFT if soft else _INK))
    pdf.multi_cell(0, size * 0.48, text, new_x="LMARGIN", new_y="NEXT", align="L")


def _head(pdf: Any, report: Report) -> None:
    _write(pdf, report.title, 10, bold=True)
    _write(pdf, report.subtitle, _SMALL, soft=True)
    pdf.ln(3)
    _write(pdf, report.sentence, 15, bold=True)
    pdf.ln(3)
    if report.key_figures:
        _key_figures(pdf, report.key_figures)
    for statement in report.statements:
        _statement(pdf, statement)
    if report.signatures:
        _signatures(pdf, report.signatures)


def _key_figures(pdf: Any, keys: tuple[KeyFigure, ...]) -> None:
    """Write the key figures side by side between two lines."""
    top, width = pdf.get_y(), pdf.epw / len(keys)
    bottom = top
    for number, key in enumerate(keys):
        left = _MARGIN + number * width
        pdf.set_xy(left, top + 2)
        for text, size, bold in (
            (key.name, _SMALL, False),
            (f"{key.value} {key.unit}".strip(), 13, True),
            (key.note, 6.5, False),
        ):
            pdf.set_x(left)
            pdf.set_font(_FONT, "B" if bold else "", size)
            pdf.set_text_color(*(_INK if bold else _SOFT))
            pdf.multi_cell(width - 3, size * 0.47, text, new_x="LEFT", new_y="NEXT", align="L")
        bottom = max(bottom, pdf.get_y())
    pdf.set_draw_color(*_LINE)
    for y in (top, bottom + 2):
        pdf.line(_MARGIN, y, _MARGIN + pdf.epw, y)
    pdf.set_xy(_MARGIN, bottom + 4)


def _statement(pdf: Any, statement: Statement) -> None:
    top = pdf.get_y()
    pdf.set_font(_FONT, "B", _BODY - 0.5)
    pdf.set_text_color(*_INK)
    pdf.multi_cell(32, 4.2, statement.question, new_x="RIGHT", new_y="TOP", align="L")
    pdf.set_font(_FONT, "", _BODY - 0.5)
    pdf.set_xy(_MARGIN + 34, top)
    pdf.multi_cell(0, 4.2, statement.answer, new_x="LMARGIN", new_y="NEXT", align="L")
    pdf.ln(1.2)


def _section(pdf: Any, number: int, section: Section) -> None:
    _keep(pdf, _KEEP)
    pdf.ln(4)
    pdf.set_draw_color(*_INK)
    pdf.line(_MARGIN, pdf.get_y(), _MARGIN + pdf.epw, pdf.get_y())
    pdf.ln(2)
    pdf.start_section(section.title)
    _write(pdf, f"{number}  {section.title}", 11, bold=True)
    pdf.ln(1.5)
    for paragraph in section.text:
        _write(pdf, paragraph)
        pdf.ln(1.5)
    for figure in section.figures:
        _figure(pdf, figure, section.title)
    for table in section.tables:
        _table(pdf, table)


def _keep(pdf: Any, height: float) -> None:
    """Begin a new page if the height [mm] does not fit on this one."""
    if pdf.will_page_break(height):
        pdf.add_page()


def _figure(pdf: Any, figure: Figure, title: str) -> None:
    pyplot = required("matplotlib.pyplot", PURPOSE)
    required("matplotlib").use("Agg")
    with pyplot.rc_context(STYLE):
        canvas = draw(figure)
        width, height = canvas.get_size_inches()
        picture = io.BytesIO()
        canvas.savefig(picture, dpi=_DPI, format="png")
        pyplot.close(canvas)
    picture.seek(0)
    wide = min(pdf.epw, 25.4 * width * 0.72)
    _keep(pdf, wide * height / width + 8)
    pdf.image(picture, w=wide, alt_text=figure.title or title)
    if figure.caption:
        _write(pdf, figure.caption, _SMALL, soft=True)
    pdf.ln(3)


def _table(pdf: Any, table: Table) -> None:
    if table.title:
        _keep(pdf, 25.0)
        _write(pdf, table.title, _BODY, bold=True)
        pdf.ln(0.5)
    if table.rows:
        _rows(pdf, table)
    if table.caption:
        pdf.ln(1)
        _write(pdf, table.caption, _SMALL, soft=True)
    pdf.ln(3)


def _rows(pdf: Any, table: Table) -> None:
    fonts = required("fpdf.fonts", PURPOSE)
    columns = len(table.rows[0])
    size = _TIGHT if columns > _MANY else _SMALL
    headed = any(table.head)
    pdf.set_font(_FONT, "", size)
    pdf.set_text_color(*_INK)
    pdf.set_draw_color(*_LINE)
    widths = _widths(pdf, table, headed)
    with pdf.table(
        borders_layout="HORIZONTAL_LINES",
        width=sum(widths),
        col_widths=widths,
        text_align=tuple("LEFT" if k in table.words else "RIGHT" for k in range(columns)),
        line_height=size * 0.52,
        first_row_as_headings=headed,
        headings_style=fonts.FontFace(emphasis="BOLD"),
        align="LEFT",
        padding=(0.6, 0.8, 0.6, 0.8),
        v_align="TOP",
    ) as drawn:
        for row in ([table.head] if headed else []) + list(table.rows):
            drawn.row(row)


def _widths(pdf: Any, table: Table, headed: bool) -> list[float]:
    """Widths of the columns [mm]: as needed, with wide columns reduced to fit the page."""
    cells = [*table.rows, *([table.head] if headed else [])]
    wanted = [
        max(pdf.get_string_width(row[k]) for row in cells) * 1.1 + 3.0
        for k in range(len(table.rows[0]))
    ]
    room, least = pdf.epw, min(pdf.epw / len(wanted), 60.0)
    narrow = sum(w for w in wanted if w <= least)
    wide = sum(w for w in wanted if w > least)
    if narrow + wide <= room:
        return wanted
    share = (room - narrow) / wide
    return [w if w <= least else w * share for w in wanted]


def _signatures(pdf: Any, who: tuple[str, ...]) -> None:
    _keep(pdf, 34.0)
    pdf.ln(18)
    width, y = pdf.epw / len(who), pdf.get_y()
    pdf.set_draw_color(*_INK)
    pdf.set_font(_FONT, "", _SMALL)
    pdf.set_text_color(*_SOFT)
    for number, name in enumerate(who):
        left = _MARGIN + number * width
        pdf.line(left, y, left + width - 6, y)
        pdf.set_xy(left, y + 1)
        pdf.cell(width - 6, 4, name)
    pdf.ln(6)
