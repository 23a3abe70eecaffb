"""Report of the diagnosis of one session, section by section."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from delta_calibration.accuracy import IsoReport
from delta_calibration.diagnosis.diagnose import Diagnosis
from delta_calibration.diagnosis.statement import MAP, SET_ASIDE
from delta_calibration.diagnosis.verdict import Finding, Verdict
from delta_calibration.report.candidates import evidence_figure, evidence_table
from delta_calibration.report.document import Report, Section, Table
from delta_calibration.report.effect_plots import giveaways, leftovers
from delta_calibration.report.glossary import glossary_section
from delta_calibration.report.judged import Judged
from delta_calibration.report.line import along_line, line_figure, line_table
from delta_calibration.report.noise import noise_figure, noise_table
from delta_calibration.report.parts import (
    correlation_figure,
    correlation_table,
    dimensions_figure,
    indices_table,
    set_by_data,
    unset_table,
)
from delta_calibration.report.provenance import Provenance
from delta_calibration.report.standard import standard_section
from delta_calibration.report.words import between, estimate, key_figures, statements, structure
from delta_calibration.report.workspace import maps, unknown_maps
from delta_calibration.robot import Robot
from delta_calibration.wording import (
    NO_VALUE,
    capital,
    chance,
    figures,
    listed,
    measured,
    mm,
    moment,
    spoken,
    sure,
)

_VALUES = 6  # largest number of values shown of a cause, the clearest ones


def report_of(
    diagnosis: Diagnosis,
    robot: Robot,
    provenance: Provenance,
    iso: IsoReport | str = "not requested",
) -> Report:
    """Make the report of a diagnosis.

    Args:
        diagnosis: diagnosis of a session, with the survey it was made from.
        robot: drawing, tolerances, tracker.
        provenance: provenance of the session and the robot file.
        iso: criteria of ISO 9283, or the reason why there are none.
    """
    verdict, judged = diagnosis.verdict, Judged.of(diagnosis)
    detail = verdict_section(verdict)
    warnings = tuple(f"Warning: {text}." for text in diagnosis.doubts)
    session = verdict.session
    told = (
        replace(detail, text=(*warnings, *detail.text)),
        _workspace(judged),
        _line(judged, robot),
        _causes(judged, robot),
        Section(
            "evidence",
            "Evidence for each candidate",
            (),
            (evidence_table(diagnosis),),
            (evidence_figure(diagnosis),),
        ),
        _parts(judged),
        _noise(judged, robot),
    )
    return Report(
        title=f"Calibration report: {robot.name}",
        subtitle=(
            f"{provenance.session}, recorded {moment(provenance.start_ns)}; {session.samples} "
            f"readings in {session.duration_s / 60:.0f} min, {session.poses} poses at rest"
        ),
        sentence=robot.named(verdict.sentence()),
        statements=tuple(
            replace(each, answer=robot.named(each.answer)) for each in statements(verdict)
        ),
        key_figures=tuple(
            replace(each, note=robot.named(each.note)) for each in key_figures(verdict)
        ),
        sections=(
            *(section.renamed(robot.named) for section in told),
            standard_section(iso),
            Section("provenance", "Provenance", (), (provenance.table(),)),
            glossary_section(),
        ),
        data={"verdict": verdict.as_dict()},
    )


def verdict_section(verdict: Verdict) -> Section:
    """Section with the details of the findings, and the causes that cannot be distinguished."""
    tables = []
    if verdict.findings:
        tables.append(
            Table(
                "findings",
                "Findings, strongest first",
                (
                    "cause",
                    "parameters",
                    "confidence",
                    "p",
                    "signal λ",
                    "held-out error, without it → with it [mm]",
                    "gain, 95 % [1]",
                    "equivalent causes here; how to separate them",
                ),
                tuple(_finding(f) for f in verdict.findings),
                words=(0, 1, 7),
            )
        )
    if verdict.cannot_tell:
        tables.append(
            Table(
                "cannot_tell",
                "What this session cannot distinguish",
                ("which", "because", "how to separate them"),
                tuple((between(e), e.because, e.next or NO_VALUE) for e in verdict.cannot_tell),
                words=(0, 1, 2),
            )
        )
    tables.append(_tests(verdict))
    if verdict.unknown_structure.laws:
        tables.append(_laws(verdict))
    return Section("verdict", "Verdict in detail", _set_aside(verdict), tuple(tables))


def _finding(finding: Finding) -> tuple[str, ...]:
    clearest = [estimate(name, e) for name, e in finding.clearest(_VALUES).items()]
    rest = len(finding.parameters) - len(clearest)
    more = f" and {rest} more" if rest else ""
    same = listed(map(spoken, finding.equivalents))
    part = f"; {finding.separated_by}" if finding.separated_by else ""
    return (
        f"{finding.called()} ({finding.kind})",
        ", ".join([*clearest, *finding.shape_told()]).replace(" +- ", " ± ") + more,
        sure(finding.confidence),
        chance(finding.p_value),
        figures(finding.signal),
        f"{mm(finding.rms_before_mm)} → {mm(finding.rms_after_mm)}"
        + (", in motion" if finding.in_motion else ""),
        f"{finding.gain:.2f} ({finding.gain_low:.2f} to {finding.gain_high:.2f})",
        same + part or NO_VALUE,
    )


def _tests(verdict: Verdict) -> Table:
    unknown = verdict.unknown_structure
    told = "The remaining errors are explained by chance, or are too small to matter."
    if unknown.found:
        told = capital(f"{structure(unknown)}.")
    rows = tuple((_test(name), chance(p)) for name, p in unknown.tests.items())
    return Table("left", "Tests of the remaining errors", ("test", "p"), rows, told)


def _laws(verdict: Verdict) -> Table:
    """Table of the equations found for errors without a known cause."""
    rows = tuple(
        (
            f"{spoken(law.part)} ({law.stage})",
            law.equation,
            ", ".join(f"{k} {measured(e.value, e.std, e.unit)}" for k, e in law.values.items()),
            sure(law.probability),
            ", ".join(law.seen()),
            f"{law.rival}; {law.separated_by}" if law.rival else NO_VALUE,
        )
        for law in verdict.unknown_structure.laws
    )
    told = (
        "Quantities are in SI units. An equation is supported in the region of its data only. "
        "It was selected among several thousand by how well each explains the data for its "
        "complexity, compared with a smooth map."
    )
    head = (
        "acts on",
        "equation",
        "values",
        "likely",
        "seen for",
        ("alternative; how to separate them"),
    )
    return Table(
        "laws", "Likely equations of the unexplained error", head, rows, told, (0, 1, 2, 4, 5)
    )


def _test(name: str) -> str:
    own = {
        MAP: "decrease of the errors by a smooth map",
        SET_ASIDE: "similarity of the errors of poses set aside",
    }
    if name in own:
        return own[name]
    kind, _, over = name.partition("moran_")
    return f"similarity of neighbours in {spoken(over)} (Moran's I)" if over else spoken(kind)


def _set_aside(verdict: Verdict) -> tuple[str, ...]:
    told = f"Readings set aside: {verdict.session.set_aside() or 'none'}."
    whole = verdict.with_set_aside()
    return (told, f"{capital(whole)}.") if whole else (told,)


def _workspace(judged: Judged) -> Section:
    baseline = judged.diagnosis.verdict.baseline.model
    added = listed(spoken(m.label) for m in judged.diagnosis.model.terms)
    errors = {
        f"before: {baseline}": judged.before,
        "calibrated: geometry + frame": judged.calibrated,
        f"extended: {added or 'nothing to add'}": judged.extended,
    }
    noise = judged.diagnosis.model.cell.noise.floor
    rows = tuple(
        (name, *(mm(1e3 * float(v)) for v in (np.sqrt(np.mean(e**2)), np.median(e), e.max())))
        for name, e in errors.items()
    )
    table = Table(
        "error_workspace",
        "Error over the workspace in numbers",
        ("held-out error, 3-D", "RMS [mm]", "median [mm]", "largest [mm]"),
        rows,
    )
    return Section(
        "workspace",
        "Error over the workspace",
        (),
        (table,),
        maps(judged.place, errors, judged.region, noise),
    )


def _line(judged: Judged, robot: Robot) -> Section:
    line = along_line(judged, robot)
    if line is None:
        return Section("line", "Along a line", ("This robot cannot reach the plan's line.",))
    return Section("line", line.title, (), (line_table(line),), (line_figure(line),))


def _causes(judged: Judged, robot: Robot) -> Section:
    title = "What points to the cause"
    shown = (*unknown_maps(judged), *giveaways(judged, robot))
    text = (
        () if shown else ("No effect was added to the geometry; the residuals are shown below.",)
    )
    return Section("causes", title, text, (), (*shown, leftovers(judged, robot)))


def _parts(judged: Judged) -> Section:
    found = judged.diagnosis.identification
    return Section(
        "geometry",
        "Geometry, correlations and what the data do not determine",
        (),
        (correlation_table(found), unset_table(found), indices_table(found)),
        (dimensions_figure(found), set_by_data(found), correlation_figure(found)),
    )


def _noise(judged: Judged, robot: Robot) -> Section:
    model = judged.diagnosis.model
    poses, noise = model.survey.poses, model.cell.noise
    figure = noise_figure(poses, robot)
    return Section(
        "noise",
        "Noise against the tracker's specification",
        (),
        (noise_table(noise, poses, robot),),
        () if figure is None else (figure,),
    )
