"""Reports and certificates with tables and figures, as offline pages; the only package that plots.

A report is data (`document.py`): sections of sentences, tables and figures, each figure a
description of arrays with units (`drawing.py`). One description is drawn three ways: live in the
page (`browser.py`), as a picture (`picture.py`), and as numbers (`numbers.py`).
"""

from delta_calibration.report.about import About, read_about
from delta_calibration.report.certificate import Certificate
from delta_calibration.report.certificate_page import page_of_certificate
from delta_calibration.report.circles import circle_report
from delta_calibration.report.dcc import require_stated, write_dcc
from delta_calibration.report.dcc_schema import require_valid
from delta_calibration.report.decision import Decision
from delta_calibration.report.document import Report, Section, Table
from delta_calibration.report.drift import (
    CalibrationRecord,
    drift_of_calibrations,
    read_calibration,
)
from delta_calibration.report.examined import Examined, examined_by, examined_fit
from delta_calibration.report.glossary import GLOSSARY
from delta_calibration.report.missing import require_libraries
from delta_calibration.report.numbers import write_numbers
from delta_calibration.report.page import build_page, page_of, write_page
from delta_calibration.report.pdf import pdf_of, write_pdf
from delta_calibration.report.picture import write_figures
from delta_calibration.report.provenance import Provenance, hash_of, session_provenance
from delta_calibration.report.session_report import report_of
from delta_calibration.report.verdict_file import VerdictFile, read_verdict
from delta_calibration.report.verdicts import drift_of_verdicts

__all__ = [
    "GLOSSARY",
    "About",
    "CalibrationRecord",
    "Certificate",
    "Decision",
    "Examined",
    "Provenance",
    "Report",
    "Section",
    "Table",
    "VerdictFile",
    "build_page",
    "circle_report",
    "drift_of_calibrations",
    "drift_of_verdicts",
    "examined_by",
    "examined_fit",
    "hash_of",
    "page_of",
    "page_of_certificate",
    "pdf_of",
    "read_about",
    "read_calibration",
    "read_verdict",
    "report_of",
    "require_libraries",
    "require_stated",
    "require_valid",
    "session_provenance",
    "write_dcc",
    "write_figures",
    "write_numbers",
    "write_page",
    "write_pdf",
]
