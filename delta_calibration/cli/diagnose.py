"""`delta-cal diagnose`: find the causes of errors that geometric calibration does not explain."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import monotonic

import click
from tqdm import tqdm

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import load_calibration, save_calibration
from delta_calibration.cli.check import checked_before, require_no_mistake
from delta_calibration.cli.fit import describe_poses
from delta_calibration.cli.making import report_on
from delta_calibration.cli.options import (
    SESSION,
    force_option,
    in_force_option,
    model_option,
    require_folder,
    robot_option,
    seed_option,
    table,
    topics_option,
    verbose_option,
    write_json,
    write_text,
)
from delta_calibration.cli.priors import population_in, priors_option
from delta_calibration.cli.verb import OUTPUT, verb
from delta_calibration.data import Survey, survey
from delta_calibration.diagnosis import (
    STEPS,
    Diagnosis,
    Finding,
    FoundEquation,
    Verdict,
    diagnose,
)
from delta_calibration.diagnosis.scores import Score
from delta_calibration.estimation import Population
from delta_calibration.export.effect_file import effect_file, project_file, require_effect_name
from delta_calibration.recording import Topics, read_session
from delta_calibration.report import require_libraries, write_page
from delta_calibration.robot import Robot, load_robot
from delta_calibration.wording import listed, measured, mm, plain, sure

TRIED = "Also list everything that was tried, with its score."
_VALUES = 16  # values of a cause that are listed at most, the clearest ones


@verb("diagnose")
@SESSION
@robot_option
@in_force_option
@click.option(
    "--json", "json_file", type=OUTPUT, default=None, help="JSON file to write the verdict to."
)
@click.option(
    "--out",
    type=OUTPUT,
    default=None,
    help="Calibration file to write, including the effects that were found.",
)
@click.option(
    "--report",
    "report_file",
    type=OUTPUT,
    default=None,
    help="HTML page to write; it opens offline.",
)
@click.option(
    "--law",
    "law_file",
    type=OUTPUT,
    default=None,
    help="Python file to write (FILE.py): the most likely equation of an unexplained error, as "
    "an effect of your own.",
)
@priors_option
@model_option
@seed_option
@topics_option
@force_option
@verbose_option(TRIED)
def command(
    session: Path,
    robot_file: str,
    in_force: Path | None,
    json_file: Path | None,
    out: Path | None,
    report_file: Path | None,
    law_file: Path | None,
    priors_file: Path | None,
    model: str | None,
    seed: int,
    topics: tuple[str, ...],
    force: bool,
    verbose: bool,
) -> None:
    """Find the causes of the errors in SESSION that geometric calibration does not explain.

    The geometry is identified first. Then every effect of the catalogue is tried on the remaining
    errors, alone and in combination. An effect that chance does not explain is named, with its
    values, the confidence in the name, and the improvement on held-out poses. Errors that match no
    cause are reported as unknown. Causes that this session cannot distinguish are listed with the
    measurement that would.
    """
    for path in (json_file, out, report_file, law_file):
        if path is not None:
            require_folder(path)
    if law_file is not None:
        require_effect_name(law_file)
    if report_file is not None:
        require_libraries()
    robot = load_robot(robot_file)
    calibration = None if in_force is None else load_calibration(in_force, robot)
    population = population_in(priors_file, robot, model)
    recorded = read_session(session, Topics.from_options(topics))
    checked = checked_before(recorded, robot, robot_file)
    refusing = out is not None and not force
    if refusing and not (json_file or law_file or report_file):  # else these are written first
        require_no_mistake(recorded, checked)
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    click.echo(describe_poses(seen.poses))
    found = diagnosed(seen, robot, model, seed, calibration, population)
    click.echo(describe(found.verdict, named=robot.named))
    for text in found.doubts:
        click.echo(f"warning: {text}")
    if verbose:
        click.echo(tried(found, robot.named))
    if json_file is not None:
        write_json(json_file, found.verdict.as_dict())
        click.echo(f"written: {json_file}")
    if out is not None and not (refusing and checked.found):
        save_calibration(out, found.identification, robot, seen.poses)
        click.echo(f"written: {out}")
    if law_file is not None:
        for line in write_law(law_file, found, session.name):
            click.echo(line)
    if report_file is not None:
        mistakes = checked.found
        made = report_on(session, recorded, found, robot, seed, calibration, mistakes=mistakes)
        write_page(report_file, made)
        click.echo(f"written: {report_file}")
    if refusing:
        require_no_mistake(recorded, checked)


def write_law(path: Path, found: Diagnosis, session: str) -> list[str]:
    """Write the likeliest law as a user-defined effect; return lines on what was written."""
    if not found.laws:
        return [f"not written: {path}: no equation for the remaining error is certain enough"]
    law, equations = found.laws[0], found.verdict.unknown_structure.laws
    seen = f"Seen in {session}, {sure(law.probability)} likely: {listed(equations[0].seen())}."
    write_text(path, effect_file(law.guess, path.stem, seen))
    project = path.with_name("pyproject.toml")
    if project.exists():
        return [f"written: {path} (entry point {path.stem} to be added to {project})"]
    write_text(project, project_file(path.stem))
    return [f"written: {path} and {project}; `pip install .` there makes the effect known"]


def diagnosed(
    seen: Survey,
    robot: Robot,
    model: str | None,
    seed: int,
    calibration: Calibration | None,
    population: Population | None = None,
) -> Diagnosis:
    """Diagnose with a progress bar that names the step, or a line per step if no terminal."""
    begun = monotonic()
    with tqdm(total=len(STEPS), delay=1.0, disable=None, leave=False, unit="step") as bar:

        def step(name: str) -> None:
            bar.update(STEPS.index(name) - bar.n)
            bar.set_description(name)
            if bar.disable:
                number, seconds = STEPS.index(name) + 1, monotonic() - begun
                line = f"step {number} of {len(STEPS)}, {name}: after {seconds:.0f} s"
                click.echo(line, err=True)

        return diagnose(
            seen,
            robot,
            model,
            seed=seed,
            calibration=calibration,
            step=step,
            population=population,
        )


def describe(
    verdict: Verdict, error: str = "3-D", of: str = "pose", named: Callable[[str], str] = str
) -> str:
    """Text of the verdict for the user.

    `error` names the kind of error and `of` the reading whose noise is given; `named` inserts the
    robot's own names before columns are aligned.
    """
    rows = [
        (named(f"{name}: {model.model}"), mm(model.held_out_rms_mm))
        for name, model in verdict.models()
    ]
    aside = verdict.session.set_aside()
    lines = [
        f"verdict: {verdict.sentence()}",
        "",
        table(("model", f"held-out error, {error} RMS [mm]"), rows),
        f"noise of a {of}: {mm(verdict.noise_mm)} mm",
        *([f"readings set aside: {aside}"] if aside else []),
        *([verdict.with_set_aside()] if verdict.with_set_aside() else []),
        *(line for finding in verdict.findings for line in ("", *_finding(finding))),
    ]
    unknown = verdict.unknown_structure
    if unknown.found:
        size = f", {unknown.rms_mm:.4f} mm RMS" if unknown.rms_mm is not None else ""
        where = f"; {unknown.where}" if unknown.where else ""
        lines += [
            "",
            f"unexplained error{size}: varies with {unknown.moves()}{where}",
        ]
    lines += [line for law in unknown.laws for line in _law(law)]
    if verdict.cannot_tell:
        lines += ["", "this session cannot distinguish:"]
        for entry in verdict.cannot_tell:
            lines.append(f"  {' / '.join(entry.between)}: {entry.why()}")
    return named("\n".join(lines))


def _finding(finding: Finding) -> list[str]:
    where = f" at {finding.location}" if finding.location else ""
    values = ", ".join(
        f"{name} {plain(measured(e.value, e.std, e.unit))}"
        for name, e in finding.clearest(_VALUES).items()
    )
    rest = len(finding.parameters) - _VALUES
    more = f", and {rest} more (--json)" if rest > 0 else ""
    lines = [
        f"{finding.cause}{where} ({finding.kind}): {values}{more}",
        f"  {sure(finding.confidence)} sure; {finding.errors()}: gain {finding.gain:.2f} "
        f"({finding.gain_low:.2f} to {finding.gain_high:.2f}); p {_chance(finding.p_value)}, "
        f"signal lambda = {finding.signal:.0f}",
    ]
    lines += [f"  {line}" for line in finding.found_in_full()]
    if finding.equivalents:
        same = f"{', '.join(finding.equivalents)}{finding.to_separate()}"
        lines.append(f"  indistinguishable in this session: {same}")
    return lines


def _law(law: FoundEquation) -> list[str]:
    values = ", ".join(
        f"{name} {plain(measured(e.value, e.std, e.unit))}" for name, e in law.values.items()
    )
    lines = [
        f"  law at {law.part} ({law.stage}), {sure(law.probability)} likely: {law.equation}",
        f"    {values}",
        f"    observed for {listed(law.seen())}",
    ]
    if law.rival:
        lines.append(f" or {law.rival}; to separate them: {law.separated_by}")
    return lines


def _chance(p: float) -> str:
    return f"= {p:.1e}" if p > 0 else "< 1e-300"


def tried(found: Diagnosis, named: Callable[[str], str]) -> str:
    """Table of the candidates tried on the calibrated model, in their best shape, best first."""
    best: dict[str, Score] = {}
    for score in found.found.first.scores:
        best.setdefault(named(score.candidate.label), score)
    rows = [
        (label, *(f"{v:.1f}" for v in (s.gain, s.degrees, s.log_bayes, s.tries)))
        for label, s in best.items()
    ]
    head = ("tried on the calibrated model", "chi square", "parameters", "ln Bayes", "tries")
    return "\n" + table(head, rows)
