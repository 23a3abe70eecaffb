"""Effects as terms: many small laws, each added to the values of a stage of the chain.

A term is one evaluation of an effect's law: it takes some of a sample's signals, some of the
effect's values and constants of its own, and adds to some numbers of its stage (joint angles,
dimensions or the reading). A table holds the terms of any number of effects; laws are called by
their addresses, so a set of effects needs no compilation.

    law (T,)        addresses
    lead (T,)       place of its first signal
    reach (T, 2)    least and largest value of that signal at which the term is not zero: outside
                    of this range it is skipped
    end (T,)        first term after the run that a term is in: a run is of terms with the same
                    `lead`, in which neither bound of `reach` decreases
    span (T, 9)     begin and number of a term's signals, values and outputs in `signal`, `value`,
                    `output`; where its workspace begins, its size, where f stands in it
    work            the workspaces, constants already in their places
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.jit import call, compiled, record
from delta_calibration.model.law import Law

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Term:
    """Inputs of one evaluation of a law, and the places that its outputs are added to."""

    signals: tuple[int, ...]  # places in the sample's signals
    values: tuple[int, ...]  # places among the effect's parameters
    outputs: tuple[int, ...]  # places in the stage; negative: not added
    constants: tuple[float, ...] = ()
    reach: tuple[float, float] = (-np.inf, np.inf)  # range of its first signal, zero outside


@record
class Table(NamedTuple):
    """Terms in the form of the compiled loops; see the module docstring."""

    law: Index
    lead: Index
    reach: Array
    end: Index
    span: Index
    signal: Index
    value: Index
    output: Index
    work: Array


_AT_A_TIME = 128  # samples, whose signals stay in the processor's cache for all terms
S_AT, S_COUNT, V_AT, V_COUNT, O_AT, O_COUNT, W_AT, W_SIZE, F_AT = range(9)


def table_of(parts: Sequence[tuple[Law, Sequence[Term], int]]) -> Table:
    """Build the table of some effects, each a law, its terms, and where its values begin."""
    law, lead, reach, span, work = [], [], [], [], []
    signal: list[int] = []
    value: list[int] = []
    output: list[int] = []
    size = 0
    for own, terms, begin in parts:
        code, offsets = own.compiled, own.offsets
        for term in terms:
            law.append(code.addresses[-1])
            lead.append(term.signals[0] if term.signals else 0)
            reach.append(term.reach)
            span.append(
                [
                    len(signal),
                    len(term.signals),
                    len(value),
                    len(term.values),
                    len(output),
                    len(term.outputs),
                    size,
                    code.size,
                    offsets["f"],
                ]
            )
            signal += term.signals
            value += [begin + v for v in term.values]
            output += term.outputs
            space = np.zeros(code.size)
            space[offsets["c"] : offsets["c"] + len(term.constants)] = term.constants
            work.append(space)
            size += code.size
    return Table(
        np.array(law, dtype=np.int64),
        np.array(lead, dtype=np.int64),
        np.array(reach, dtype=float).reshape(-1, 2),
        np.array(_ends(lead, reach), dtype=np.int64),
        np.array(span, dtype=np.int64).reshape(-1, 9),
        np.array(signal, dtype=np.int64),
        np.array(value, dtype=np.int64),
        np.array(output, dtype=np.int64),
        np.concatenate([np.zeros(0), *work]),
    )


def _ends(lead: Sequence[int], reach: Sequence[tuple[float, float]]) -> list[int]:
    """Ends of runs, see `Table.end`."""
    ends = [len(lead)] * len(lead)
    for i in reversed(range(len(lead) - 1)):
        alike = lead[i] == lead[i + 1]
        rises = reach[i][0] <= reach[i + 1][0] and reach[i][1] <= reach[i + 1][1]
        ends[i] = ends[i + 1] if alike and rises else i + 1
    return ends


@compiled(borrows=True)
def busy_from(table: Table, term: int, signals: Array) -> int:
    """Return the first term from this one on that may be nonzero at a sample, or their number.

    A term whose first signal is NaN may be nonzero.
    """
    while term < len(table.law):
        led, end = signals[table.lead[term]], int(table.end[term])
        if led < table.reach[term, 0]:
            term = end
        elif led > table.reach[term, 1]:
            term += 1
            while term < end:
                middle = int(0.5 * (term + end))
                if led > table.reach[middle, 1]:
                    term = middle + 1
                else:
                    end = middle
        else:
            break
    return term


@compiled(borrows=True)
def evaluate(table: Table, term: int, signals: Array, values: Array, work: Array) -> None:
    """Evaluate one term on a sample's signals, in its workspace."""
    span, signal, value = table.span[term], table.signal, table.value
    own = work[span[W_AT] : span[W_AT] + span[W_SIZE]]
    first, count = span[S_AT], span[S_COUNT]
    for i in range(count):
        own[i] = signals[signal[first + i]]
    first = span[V_AT]
    for i in range(span[V_COUNT]):
        own[count + i] = values[value[first + i]]
    call(table.law[term], own)


@compiled(borrows=True)
def add_shift(table: Table, signals: Array, values: Array, work: Array, shift: Array) -> None:
    """Add the outputs of all terms to `shift`, (size of the stage,)."""
    term = busy_from(table, 0, signals)
    while term < len(table.law):
        evaluate(table, term, signals, values, work)
        span = table.span[term]
        first = span[W_AT] + span[F_AT]
        for i in range(span[O_COUNT]):
            row = table.output[span[O_AT] + i]
            if row >= 0:
                shift[row] += work[first + i]
        term = busy_from(table, term + 1, signals)


@compiled(borrows=True)
def slopes_of(slope: Array, output: Index, value: Index, by_stage: Array, found: Array) -> None:
    """Add derivatives by the values of one term, through its stage, to `found` (d, K).

    Args:
        slope: derivative of each output by each value, one output after the other.
        output: rows of the stage; negative: not added.
        value: columns of `found`.
        by_stage: derivatives of d quantities by the stage, (d, size of the stage).
        found: their derivatives by the values, (d, K).
    """
    for i in range(len(output)):
        row = output[i]
        if row < 0:
            continue
        for j in range(len(value)):
            own = slope[i * len(value) + j]
            if own == 0.0:
                continue  # most of many outputs depend on one value each
            for side in range(len(found)):
                if by_stage[side, row] != 0.0:  # 0 times NaN counts as 0
                    found[side, value[j]] += by_stage[side, row] * own


@compiled(borrows=True)
def slopes_into(table: Table, signals: Array, work: Array, by_stage: Array, slopes: Array) -> None:
    """Add derivatives by all values, through a stage of `by_stage` (d, size), to `slopes` (d, K).

    The terms have been evaluated on these signals; their derivatives are in the workspaces.
    """
    term = busy_from(table, 0, signals)
    while term < len(table.law):
        span = table.span[term]
        output = table.output[span[O_AT] : span[O_AT] + span[O_COUNT]]
        value = table.value[span[V_AT] : span[V_AT] + span[V_COUNT]]
        first = span[W_AT] + span[F_AT] + span[O_COUNT]
        slopes_of(work[first:], output, value, by_stage, slopes)
        term = busy_from(table, term + 1, signals)


@compiled(borrows=True)
def takes(table: Table, begin: int, count: int) -> bool:
    """Whether any term takes one of the `count` signals from `begin` on."""
    for term in range(len(table.law)):
        span = table.span[term]
        for i in range(span[S_COUNT]):
            if begin <= table.signal[span[S_AT] + i] < begin + count:
                return True
    return False


@compiled()
def shifts(table: Table, signals: Array, values: Array, size: int) -> Array:
    """Sum of all terms on a stage at every sample, (n, size)."""
    found, work = np.zeros((len(signals), size)), table.work.copy()
    for row in range(len(signals)):
        add_shift(table, signals[row], values, work, found[row])
    return found


@compiled()
def firsts(table: Table, signals: Array, values: Array) -> Array:
    """First output of each term at every sample, (n, terms)."""
    found, work = np.zeros((len(signals), len(table.law))), table.work.copy()
    for row in range(len(signals)):
        term = busy_from(table, 0, signals[row])
        while term < len(table.law):
            evaluate(table, term, signals[row], values, work)
            span = table.span[term]
            found[row, term] = work[span[W_AT] + span[F_AT]]
            term = busy_from(table, term + 1, signals[row])
    return found


@compiled(borrows=True)
def _derive(
    table: Table,
    signals: Array,
    values: Array,
    by_stage: Array,
    place: Index,
    work: Array,
    found: Array,
) -> None:
    """Derivatives of all terms by their values at every sample.

    Args:
        table: the terms.
        signals: (n, S).
        values: (K,).
        by_stage: see `columns`.
        place: see `slopes`; empty to find columns.
        work: the workspaces.
        found: columns (n, d, K), or slopes (1, rows, n).
    """
    count, shared = len(signals), len(by_stage) == 1
    apart = len(place) > 0  # slopes are wanted; without values there are none
    for begin in range(0, count, _AT_A_TIME):
        for term in range(len(table.law)):
            span, law = table.span[term], table.law[term]
            taken, moves, outputs = span[S_COUNT], span[V_COUNT], span[O_COUNT]
            signal = table.signal[span[S_AT] : span[S_AT] + taken]
            value = table.value[span[V_AT] : span[V_AT] + moves]
            output = table.output[span[O_AT] : span[O_AT] + outputs]
            own = work[span[W_AT] : span[W_AT] + span[W_SIZE]]
            first = span[F_AT] + outputs
            lead, low, high = table.lead[term], table.reach[term, 0], table.reach[term, 1]
            for j in range(moves):
                own[taken + j] = values[value[j]]
            for row in range(begin, min(begin + _AT_A_TIME, count)):
                if signals[row, lead] < low or signals[row, lead] > high:
                    continue
                for i in range(taken):
                    own[i] = signals[row, signal[i]]
                call(law, own)
                if apart:
                    for j in range(moves):
                        where = place[value[j]]
                        if where >= 0:
                            found[0, where, row] = own[first + j]
                else:
                    through = by_stage[0 if shared else row]
                    slopes_of(own[first:], output, value, through, found[row])


@compiled()
def columns(table: Table, signals: Array, values: Array, by_stage: Array) -> Array:
    """Derivatives of d quantities by the values, through a stage, at every sample, (n, d, K).

    Args:
        table: the terms.
        signals: (n, S).
        values: (K,).
        by_stage: derivatives of the d quantities by the stage, (n, d, size of the stage), or
            (1, d, size) where all samples share it.
    """
    found = np.zeros((len(signals), by_stage.shape[1], len(values)))
    nowhere = np.zeros(0, dtype=np.int64)
    _derive(table, signals, values, by_stage, nowhere, table.work.copy(), found)
    return found


@compiled()
def slopes(table: Table, signals: Array, values: Array, place: Index, rows: int) -> Array:
    """Derivative of the one number that each value moves, at every sample, (rows, n).

    Args:
        table: terms of one output each, with values that no other term takes.
        signals: (n, S).
        values: (K,).
        place: row of each value, (K,); negative: left out.
        rows: number of rows.
    """
    found, none = np.zeros((rows, len(signals))), np.zeros((0, 0, 0))
    whole = found.reshape((1, rows, len(signals)))
    _derive(table, signals, values, none, place, table.work.copy(), whole)
    return found
