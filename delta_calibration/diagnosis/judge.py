"""From a fit to a verdict: search and confirm causes, test the residuals, judge the unknown.

All of a diagnosis after the first fit of the geometry (`STEPS`), whatever was measured.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from delta_calibration.diagnosis.by_law import Confirmed, by_law, names_of, without_maps
from delta_calibration.diagnosis.candidates import (
    Candidate,
    all_columns,
    bounds_of,
    moved_by,
    products_of,
)
from delta_calibration.diagnosis.constants import (
    ALPHA,
    IMPERFECT,
    LACKING,
    LEAST_SURE,
    LIKELIER,
    MOST,
    MUCH,
    NAMELESS,
    NEIGHBOURS,
    PART_OF_A_MAP,
    PLAIN,
    QUIETER,
    SOME,
    WITH_PAYLOAD,
)
from delta_calibration.diagnosis.cross_validation import HeldOut
from delta_calibration.diagnosis.findings import (
    MM,
    HeldOutModels,
    of_dimension,
    of_geometry,
    of_reflector,
    of_term,
)
from delta_calibration.diagnosis.fitted import Fitted, beside
from delta_calibration.diagnosis.geometry import scatter_of
from delta_calibration.diagnosis.identifiability import unseen, with_payload
from delta_calibration.diagnosis.law_grammar import COORDINATES, Grammar
from delta_calibration.diagnosis.law_search import Likely, doubts_of_names, likelier_than
from delta_calibration.diagnosis.model_selection import worth_it
from delta_calibration.diagnosis.name_checks import in_the_shadow, signal_of, untrusted
from delta_calibration.diagnosis.other_names import with_same_signal
from delta_calibration.diagnosis.residual_tests import ResidualTests, audit
from delta_calibration.diagnosis.scan import Scan, scanned
from delta_calibration.diagnosis.scores import Chance, decrease, most_likely
from delta_calibration.diagnosis.search import SearchResult, beyond_names, find
from delta_calibration.diagnosis.set_aside import Aside
from delta_calibration.diagnosis.statement import (
    LACK_OF_FIT,
    MAP,
    MOTION,
    SET_ASIDE,
    moves_with,
    shown,
)
from delta_calibration.diagnosis.verdict import (
    Finding,
    UnknownStructure,
    Verdict,
)
from delta_calibration.effects import Effect
from delta_calibration.errors import DataError

Array = NDArray[np.float64]

STEPS = ("geometry", "causes", "held-out data", "what is left")


@dataclass(frozen=True)
class Judgement:
    """The verdict, and the models, tests and held-out errors that it is based on."""

    verdict: Verdict
    model: Fitted  # the extended model
    found: SearchResult
    audit: ResidualTests
    held: HeldOutModels  # the held-out errors of the verdict, pose by pose
    before: HeldOut  # held-out errors of the baseline
    after: HeldOut  # held-out errors of the extended model
    refused: tuple[Candidate, ...] = ()  # found, but it makes predictions worse: not shipped
    laws: tuple[Likely, ...] = ()  # of the unknown structure, likeliest first


def judged(
    start: Fitted,
    effects: Sequence[Effect],
    rng: np.random.Generator,
    baseline: tuple[str, Callable[[HeldOutModels], HeldOut]] | None = None,
    step: Callable[[str], None] = lambda name: None,
) -> Judgement:
    """Find and confirm the causes of the residuals of a calibrated machine.

    Args:
        start: the machine with its geometry identified and no effects in the chain.
        effects: candidate effects.
        rng: random generator of the bootstraps.
        baseline: name of the baseline, and function that gives its held-out errors; the drawing if
            not given.
        step: progress callback, called with each of `STEPS` but the first as it begins.
    """
    step(STEPS[1])
    sought = find(start, effects, rng)
    quiet = start.quieter(sought.model)
    if quiet is not start:
        start, sought = quiet, find(quiet, effects, rng, sought.model.terms)
    start, sought = _in_louder_noise(start, sought, effects, rng)
    start, sought = _sought_again(start, sought, effects, rng)
    step(STEPS[2])
    found, held, said = _borne_out(sought, start, effects, rng)
    if not said and sought.mapped:
        maps = sought.first.maps
        named = find(start, effects, rng, gone=maps, earlier=sought)
        found, held, said = _borne_out(named, start, effects, rng, maps)
        if said:  # a map that does not predict held-out data still shows remaining structure
            found = replace(found, last=scanned(found.model, effects, rng))
    found, held, said = _less_than_a_law((found, held, said), start, effects, rng)
    step(STEPS[3])
    aside = Aside.of(found.model, rng)
    left = _audited(found.model, rng)
    names = {m: f for m, f in said.items() if not m.unexplained}
    doubtful = not names or any(_in_doubt(f, found.last) for f in names.values())
    unknown = _unknown(found, sought.model, left, aside, doubtful)
    if not unknown.found and len(names) < len(said):  # a map that is not stated is not used
        plain = without_maps(found.model).rested() if names else start
        found, held, said = replace(found, model=plain), HeldOutModels(plain), names
        left, aside = _audited(plain, rng), Aside.of(plain, rng)
        unknown = _unknown(found, plain, left, aside, doubtful)
    said = with_same_signal(_in_part(said, found), found.model.evidence)
    findings = [f for m, f in said.items() if not m.unexplained]
    laws: tuple[Likely, ...] = ()
    if unknown.found:
        lost = tuple(m for m in names_of(sought.model) if not _among(found.model.terms, m))
        check = partial(_stands, start=start, effects=effects, rng=rng)
        by = by_law((found, held, said), lost, effects, check, rng)
        laws, (found, held, said) = by.laws, by.confirmed
        unknown = replace(unknown, laws=by.equations)
        findings = [f for m, f in said.items() if not m.unexplained]
    found, after, refused = _shipped(found, held, said, start)
    terms = found.model.terms
    if unknown.found and not terms:  # readings in motion would bias a fit to the poses
        found = replace(found, model=start)
    bent = unknown.found or found.last.nameless
    findings += _of_what_is_fitted(found, held, bent, rng)
    findings.sort(key=lambda finding: -finding.signal)
    name, compared = _drawing(start) if baseline is None else baseline
    against = compared(held)
    verdict = Verdict(
        session=found.model.facts,
        noise_mm=MM * found.model.floor,
        baseline=held.told(name, against),
        calibrated=held.told(_name((), start.placed), held.terms((), held.sectors)),
        extended=held.told(_name(terms, start.placed), after),
        findings=tuple(findings),
        unknown_structure=unknown,
        cannot_tell=(
            *with_payload(tuple(said), found.model.evidence.at),
            *unseen(found.model.evidence, terms, effects, findings, unknown),
        ),
    )
    if any(f.cause == "smr_offset" and f.equivalents for f in findings):
        found = replace(found, model=found.model.placed_freely())  # as the finding tells it
    found = replace(found, fits=None)  # they are as large as the session
    return Judgement(verdict, found.model, found, left, held, against, after, refused, laws)


def _in_louder_noise(
    start: Fitted, sought: SearchResult, effects: Sequence[Effect], rng: np.random.Generator
) -> tuple[Fitted, SearchResult]:
    """The start and the result of a search in the noise that the residuals show, where needed.

    The noise of the robot file is a claim. If visits do not contradict, and what is left is larger
    but follows nothing, the claim is wrong, and the terms found by it may explain noise. Then all
    residuals count as noise at first, and less of them as causes are found in it. If that hides
    something that residuals follow, the claim stands.
    """
    if start.most_louder <= 1.0:
        return start, sought
    left = _tests(sought.model, rng)
    if shown(left.p) != (LACK_OF_FIT,) or not left.ratio <= start.most_louder:
        return start, sought
    louder = start.louder(_tests(start, rng).ratio)
    found = find(louder, effects, rng)
    left = _tests(found.model, rng)
    while left.ratio <= QUIETER and not louder.noise_apart:  # ends at the noise of the file
        louder = louder.louder(left.ratio)
        found = find(louder, effects, rng, found.model.terms)
        left = _tests(found.model, rng)
    follows = set(shown(left.p)) - {LACK_OF_FIT}
    return (start, sought) if follows else (louder, found)


def _sought_again(
    start: Fitted, sought: SearchResult, effects: Sequence[Effect], rng: np.random.Generator
) -> tuple[Fitted, SearchResult]:
    """The start and the result of a search with wider priors of the dimensions, where needed.

    Those of before if the wider priors lead to machines that cannot reach the poses.
    """
    loose = _loosened(start, sought.model, effects)
    if loose is start:
        return start, sought
    try:
        return loose, find(loose, effects, rng)
    except DataError:
        return start, sought


def _loosened(start: Fitted, found: Fitted, effects: Sequence[Effect]) -> Fitted:
    """The machine without terms, its dimensions with the scatter that they have beside these.

    Where they exceed their tolerances, these tell nothing: held by them the dimensions would leave
    errors, and a cause be found that is none. Not if structure is left, which bends them, nor if
    it is likelier that they keep their tolerances and the errors follow a law.
    """
    if found.misfit > LACKING:
        return start
    evidence = found.beside
    scatter = scatter_of(evidence)
    if not scatter.log_p < np.log(ALPHA):
        return start
    if found.placed and evidence.axes == COORDINATES:
        grammar = Grammar.of(evidence, effects[0].robot)
        if likelier_than(scatter.log_bayes, evidence, grammar):
            return start
    return start.loosened(scatter.tau)


def _less_than_a_law(
    confirmed: Confirmed, start: Fitted, effects: Sequence[Effect], rng: np.random.Generator
) -> Confirmed:
    """Remove causes for which a single law is likelier; otherwise reduce their confidence.

    A law is compared with all of them together, with those of one joint, and with each beside the
    others. They are removed even if no law is sure enough to be reported; then a map may take
    their place.
    """
    found, held, said = confirmed
    whole = found.model.evidence
    if not said or not found.model.placed or whole.axes != COORDINATES:
        return confirmed
    most, grammar = dict.fromkeys(said, 0.0), Grammar.of(whole, effects[0].robot)
    for named in _perhaps_one(tuple(said)):
        others = tuple(m for m in found.model.terms if m not in named)
        without = beside(whole, others)  # about the fit with them: it favours them
        # the law may also make up for errors of the models of the others
        spare = IMPERFECT / 2 * sum(said[m].signal for m in others if m in said)
        part = held.parts_for(without, all_columns(named, without))
        doubt = doubts_of_names(without, named, grammar, part, spare)
        most |= {m: max(most[m], doubt) for m in named}
        left = min(_doubted(said[m], doubt).confidence for m in named)
        if doubt >= LIKELIER or left < LEAST_SURE:
            kept = tuple(m for m in said if m not in named and not m.unexplained)
            bare = found.model.fitted(kept)
            last = scanned(bare, effects, rng).without((*named, *kept))
            mapped = bare if last.map is None else bare.fitted((*kept, last.map.candidate))
            fewer = _holding(replace(found, model=mapped, last=last), start, rng)
            return _less_than_a_law(fewer, start, effects, rng)
    return found, held, {m: _doubted(f, most[m]) for m, f in said.items()}


def _stands(
    confirmed: Confirmed, start: Fitted, effects: Sequence[Effect], rng: np.random.Generator
) -> Confirmed | None:
    """Causes beside a law, with all doubts; None if another law is likelier than one of them."""
    found, held, said = _less_than_a_law(confirmed, start, effects, rng)
    if {*said} != {*confirmed[2]}:
        return None
    return found, held, with_same_signal(_in_part(said, found), found.model.evidence)


def _perhaps_one(said: Sequence[Candidate]) -> Iterator[tuple[Candidate, ...]]:
    """Sets of named causes that may be one law: all of them, several of one joint, and each."""
    named = tuple(m for m in said if m.effect is not None and not m.unexplained)
    if named:
        yield named
    for place in dict.fromkeys(m.location for m in named if m.location is not None):
        here = tuple(m for m in named if m.location == place)
        if 1 < len(here) < len(named):
            yield here
    if len(named) > 1:
        yield from ((m,) for m in named)


def _doubted(finding: Finding, doubt: float) -> Finding:
    return replace(finding, confidence=finding.confidence * (1 - doubt))


def _shipped(
    found: SearchResult, held: HeldOutModels, said: Mapping[Candidate, Finding], start: Fitted
) -> tuple[SearchResult, HeldOut, tuple[Candidate, ...]]:
    """The extended model, its held-out errors, and the terms that were refused.

    A model that predicts held-out poses worse than the calibrated one is not shipped, unless all
    its terms show in motion only. These stay, but must change nothing at rest: geometry, frame and
    reflector are those of the calibrated model.
    """
    terms, plain = found.model.terms, held.terms((), held.sectors)
    if held.foretells((), terms):
        return found, held.terms(terms, held.sectors), ()
    if all(term in said and said[term].in_motion for term in terms):
        return replace(found, model=found.model.resting_as(start)), plain, ()
    return replace(found, model=start), plain, terms


def _borne_out(
    found: SearchResult,
    start: Fitted,
    effects: Sequence[Effect],
    rng: np.random.Generator,
    gone: tuple[Candidate, ...] = (),
) -> Confirmed:
    """Remove, one by one, terms that cannot be trusted or do not hold on held-out data.

    A cause that becomes significant only after such terms are removed is added.
    """
    while True:
        sought = found.model.terms
        found, held, said = _holding(found, start, rng)
        gone += tuple(m for m in sought if not _among(tuple(said), m))
        better = tuple(said)
        if gone:
            found = replace(found, last=scanned(found.model, effects, rng).without(gone))
        if gone and said:
            better = _beside_what_holds(found)
            gone += tuple(m for m in said if not _among(better, m))
        if better == tuple(said):
            return found, held, said
        found = replace(found, model=found.model.fitted(better))


def _beside_what_holds(found: SearchResult) -> tuple[Candidate, ...]:
    """The terms with a cause that has become significant, or with a map in the place of names."""
    terms = found.model.terms
    last = found.last.without(terms)
    freed = worth_it(last, found.model) if len(terms) < MOST else None
    if freed is None or freed.candidate.unexplained:
        return beyond_names(found.model, found.last, found.short)
    return (*terms, freed.candidate)


def _among(terms: Sequence[Candidate], one: Candidate) -> bool:
    return any(one.same_cause(term) for term in terms)


def _in_part(said: Mapping[Candidate, Finding], found: SearchResult) -> dict[Candidate, Finding]:
    """Reduce the confidence in causes that may only look like an error without a name.

    A step at the only change of payload may be an effect of the payload. A cause may be a part of
    a map in the model that explains more, if that map could also make the signal of the cause, or
    if the cause does not clearly improve predictions of held-out data; or of a map that explains
    some of the errors left beside it.
    """
    maps = [term for term in found.model.terms if term.unexplained]
    larger = max((f.signal for m, f in said.items() if m.unexplained), default=0.0)

    def doubted(term: Candidate, finding: Finding) -> Finding:
        vague = finding.signal < larger and not finding.gain_low > 0.0
        shadowed = vague or any(in_the_shadow(found.model, term, other) for other in maps)
        doubt = 1.0 if shadowed else _map_beside(finding, found.last)
        sure = finding.confidence * (1 - (1 - PART_OF_A_MAP) * doubt)
        if term.effect is not None and term.effect.begins_with_payload(found.model.evidence.at):
            sure *= WITH_PAYLOAD
        return replace(finding, confidence=sure)

    return {m: f if m.unexplained else doubted(m, f) for m, f in said.items()}


def _map_beside(finding: Finding, last: Scan) -> float:
    """Probability that a smooth map, which explains some errors beside a cause, is real.

    Its prior is that of an error without a name. The result is 1 if the map is significant and
    explains more than `SOME` of the cause's signal. A map that may be due to chance must explain
    more of it: no model is perfect.
    """
    if _in_doubt(finding, last):
        return 1.0
    some = (
        s.log_bayes
        for s in last.scores
        if s.candidate.unexplained and s.gain > MUCH * finding.signal
    )
    odds = NAMELESS / (1 - NAMELESS) * float(np.exp(min(max(some, default=-np.inf), PLAIN)))
    return odds / (1 + odds)


def _in_doubt(finding: Finding, last: Scan) -> bool:
    """Whether a map explains so much beside a cause that the cause may be a part of it."""
    return last.nameless and last.left is not None and last.left.gain > SOME * finding.signal


def _holding(found: SearchResult, start: Fitted, rng: np.random.Generator) -> Confirmed:
    """As `_borne_out`, but without a scan for causes that become significant."""
    while True:
        weak = untrusted(found.model)
        if not weak:
            found = replace(found, model=found.model.rested())
            held = HeldOutModels(found.model)
            said: dict[Candidate, Finding] = {}
            for m in _by_signal(found.model, found.model.terms):  # the first to fail ends it
                finding = of_term(found, m, held, rng)
                if finding is None:
                    weak = (m,)
                    break
                said[m] = finding
            if not weak:
                return found, held, {m: said[m] for m in found.model.terms}
        weakest = _by_signal(found.model, weak)[0]
        kept = tuple(m for m in found.model.terms if m is not weakest)
        found = replace(found, model=found.model.fitted(kept) if kept else start)


def _by_signal(model: Fitted, terms: Sequence[Candidate]) -> list[Candidate]:
    """Terms of a model by the strength of their signals, weakest first."""
    return sorted(terms, key=lambda m: signal_of(model, m)) if len(terms) > 1 else list(terms)


def _of_what_is_fitted(
    found: SearchResult, held: HeldOutModels, bent: bool, rng: np.random.Generator
) -> list[Finding]:
    """Findings among the parameters of every calibration: one or all dimensions, the reflector.

    Unknown structure biases them (`bent`): then only an outlier among the dimensions is a finding.
    """
    reflector, model = of_reflector(found, held, rng), found.model
    if reflector is not None and reflector.equivalents and not bent:
        model = model.placed_freely()  # the tool may only take a part of what the reflector is off
    scatter = scatter_of(model.beside)
    one = None
    if scatter.outlier is not None:
        one = of_dimension(found, scatter.tau, scatter.outlier, held, rng)
    if bent:
        return [] if one is None else [one]
    every = of_geometry(found, scatter, held, rng) if one is None else None
    return [f for f in (one, every, reflector) if f is not None]


def _audited(model: Fitted, rng: np.random.Generator) -> ResidualTests:
    """Residual tests of a model, without lack of fit if the residuals determine the noise."""
    left = _tests(model, rng)
    if model.noise_apart:
        return left
    return replace(left, p={name: p for name, p in left.p.items() if name != LACK_OF_FIT})


def _tests(model: Fitted, rng: np.random.Generator) -> ResidualTests:
    return audit(model.beside, model.noise_degrees, rng)


def _drawing(start: Fitted) -> tuple[str, Callable[[HeldOutModels], HeldOut]]:
    """Name and held-out errors of the nominal machine, in its best-fit frame if it has one."""
    name = "nominal + frame" if start.placed else "nominal"
    return name, lambda held: held.placed(start.registered())


def _name(terms: tuple[Candidate, ...], placed: bool) -> str:
    frame = ["frame"] if placed else []
    return " + ".join(["geometry", *frame, *(m.label for m in terms)])


def _unknown(
    found: SearchResult, sought: Fitted, left: ResidualTests, aside: Aside, doubtful: bool
) -> UnknownStructure:
    """Unknown structure that a smooth map describes, or that the tests find in the residuals.

    A significant map is structure, even if it predicts too little to be of use and was removed
    from the model again. Whether structure is reported follows from the tests alone
    (`statement.py`).

    Args:
        found: the confirmed model, and the scan of its residuals.
        sought: the model at the end of the search.
        left: residual tests of the confirmed model.
        aside: the poses that were set aside.
        doubtful: whether no name holds, or one is in doubt because of the structure beside it.
    """
    tests: dict[str, float | None] = {LACK_OF_FIT: None, **left.p}
    if aside.alike is not None:
        tests[SET_ASIDE] = aside.alike
    for with_map in _where_a_map_is(found, sought, doubtful):
        for term in with_map.terms:
            if term.unexplained:
                mapped = {**tests, MAP: _chance_of_map(with_map, term, found.first.tests)}
                if MAP in shown(mapped):
                    return _mapped(with_map, term, mapped)
    said = shown(tests)
    if not said:
        return UnknownStructure(False, None, None, None, tests)
    worst = said[0]
    size = {MOTION: left.in_motion, SET_ASIDE: aside.rms}.get(worst, left.excess)
    where = {MOTION: None, SET_ASIDE: aside.worst}.get(worst, left.worst)
    told = None if where is None else _around(where)
    large = MM * size or None  # errors alike among neighbours may not exceed the noise
    return UnknownStructure(True, told, moves_with(worst), large, tests)


def _chance_of_map(model: Fitted, term: Candidate, asked: int) -> float:
    """p of a map beside the other terms, multiplied by the number of tests."""
    evidence = beside(model.evidence, tuple(m for m in model.terms if m is not term))
    columns = products_of(term, evidence)
    information = evidence.information_of(columns)
    along = columns.along(evidence.weigh(evidence.column))
    value = most_likely(information, along[:, 0], *bounds_of(term))
    gain = decrease(information, along[:, 0], value)
    log_p = Chance.of(information).log_p(gain, model.noise_degrees) + float(np.log(asked))
    return float(np.exp(min(0.0, log_p)))


def _where_a_map_is(found: SearchResult, sought: Fitted, doubtful: bool) -> Iterator[Fitted]:
    """Fits that may contain a map: the model, and the same plus a map of what is left or sought.

    A map from the end of the search counts beside the causes that hold: these may explain it.
    """
    terms = found.model.terms
    yield found.model
    if doubtful and found.last.map is not None:
        yield found.model.fitted((*terms, found.last.map.candidate))
    maps = tuple(m for m in sought.terms if m.unexplained and not _among(terms, m))
    if maps:
        yield found.model.fitted((*terms, *maps)) if terms else sought


def _mapped(model: Fitted, term: Candidate, tests: Mapping[str, float | None]) -> UnknownStructure:
    """Unknown structure as described by a map: its size, and where it is largest."""
    place, shift = unabsorbed(model, term)
    square = np.sum(shift**2, axis=1)
    _, near = cKDTree(place).query(place, max(1, round(NEIGHBOURS * len(place))))
    where = _around(place[int(np.argmax(square[near].reshape(len(place), -1).mean(axis=1)))])
    family = term.effect.moves_with if term.effect is not None else None
    return UnknownStructure(True, where, family, MM * float(np.sqrt(np.mean(square))), tests)


def unabsorbed(model: Fitted, term: Candidate) -> tuple[Array, Array]:
    """Positions of the poses (n, 3) [m] and what a map adds to the readings there (n, 3) [m].

    Only the part of its displacement that refitted geometry and frame do not absorb, because the
    rest does not appear in the errors of a calibrated machine.
    """
    evidence = model.evidence
    moved = moved_by(term, evidence, model.scaled(term)).reshape(evidence.residual.shape)
    alone = replace(evidence, residual=moved)
    rows = np.flatnonzero(evidence.believed[: evidence.poses])
    place = evidence.chain.mechanism.position(evidence.pose[rows])
    return place, alone.missed(alone.best(model.misfit))[rows]


def _around(place: Array) -> str:
    x, y, z = (MM * place).tolist()
    return f"most around x = {x:.0f}, y = {y:.0f}, z = {z:.0f} mm"
