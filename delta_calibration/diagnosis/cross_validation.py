"""Cross-validation of candidate causes on data that the fit has not seen.

Sectors of the workspace are held out in turn, then stretches of time, which hold the blocks of
payload and temperature. A cause that is fitted to the others has to predict a share of what it
explains, summed over all parts. Its gain is the share that it removes of the avoidable squared
error: that before, less the noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.columns import Columns
from delta_calibration.diagnosis.constants import LEARNABLE, PARTS, SURE_QUANTILE
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.scores import PRECISION, change, most_likely
from delta_calibration.threads import mapped

Array = NDArray[np.float64]
_Result = TypeVar("_Result")

_CELL = 0.05  # [m] edge of the cells of `scattered`
_FLAT = 0.05  # share of its width below which a workspace, seen from above, is an upright plane
_DRAWS = 400


@dataclass(frozen=True)
class HeldOut:
    """Squared 3-D distance of measured and predicted, each sample by a fit without its part."""

    square: Array  # (n,) [m^2]; includes set-aside samples if `whole` was given
    part: NDArray[np.int64]  # (n,) number of the part it was held out with

    def rms(self, rows: NDArray[np.bool_]) -> float:
        """Root mean square of the 3-D distance over some samples [m]."""
        return float(np.sqrt(np.nanmean(self.square[rows])))


@dataclass(frozen=True)
class Foretold:
    """How well columns predict parts of the data that their values were not fitted to."""

    gain: float  # decrease of chi square of the parts, each with values fitted to the others
    share: float  # gain over the decrease by a fit to everything; 1 if only noise is in the way
    of_parts: float  # gain over that of the parts with the values of that fit; 1 if values agree


@dataclass(frozen=True)
class Gain:
    """Share of the avoidable held-out error that a term removes."""

    before: float  # [m]
    after: float  # [m]
    share: float  # of the avoidable squared error; 1: only noise remains
    low: float  # of the 95 % interval of `share`
    high: float
    in_motion: bool = False  # errors of readings on paths, as the term does not show at rest


def sectors(evidence: LinearizedModel) -> NDArray[np.int64]:
    """Sector of the workspace that each sample lies in, (n,): equal numbers of poses in each."""
    return _sectors(evidence, np.arange(len(evidence)) < evidence.poses)


def sectors_of_motion(evidence: LinearizedModel) -> NDArray[np.int64]:
    """Sectors with equal numbers of readings in motion, which may all lie in one pose sector."""
    moving = np.arange(len(evidence)) >= evidence.poses
    return np.where(moving, _sectors(evidence, moving), sectors(evidence))


def _sectors(evidence: LinearizedModel, even: NDArray[np.bool_]) -> NDArray[np.int64]:
    bearing = bearings(evidence.chain.mechanism.position(evidence.pose))
    return _parts(bearing, bearing[even])


def bearings(place: Array) -> Array:
    """Bearing of places (n, 3) [m] in the base frame, (n,) [rad].

    The bearing is about z. For a machine that works in an upright plane it is taken in that plane
    about its middle: about z all places would have one of two bearings. For places on a line it is
    the position along the line [m].
    """
    about = place - place.mean(axis=0)
    spread, ways = _spread(about)
    if spread[1] < _FLAT * spread[0]:
        return np.asarray(about @ ways[0])
    spread, ways = _spread(about[:, :2])
    if spread[1] >= _FLAT * spread[0]:
        return np.asarray(np.arctan2(place[:, 1], place[:, 0]))
    return np.asarray(np.arctan2(about[:, 2], about[:, :2] @ ways[0]))


def _spread(about: Array) -> tuple[Array, Array]:
    """Singular values (d,) [m] of centred places (n, d), largest first, and their axes (d, d)."""
    square, ways = np.linalg.eigh(about.T @ about)
    return np.sqrt(np.maximum(square[::-1], 0.0)), ways.T[::-1]


def stretches(evidence: LinearizedModel) -> NDArray[np.int64]:
    """Stretch of time that each sample lies in, (n,)."""
    time = evidence.at.time
    return _parts(time, time[: evidence.poses])


def scattered(evidence: LinearizedModel) -> NDArray[np.int64]:
    """One of five parts for each cell of the workspace, (n,); cells that share a face differ."""
    cell = np.round(evidence.chain.mechanism.position(evidence.pose) / _CELL).astype(np.int64)
    return np.asarray((cell @ np.array([1, 2, 4])) % PARTS)


def learnable(
    evidence: LinearizedModel, columns: Columns, part: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Whether enough information on each of k columns remains without any one part, (k,)."""
    whole = np.diag(evidence.information_of(columns))
    if len(np.unique(part)) < 2:
        return np.asarray(~(whole > 0))
    every = _without_each(evidence, columns, part, lambda _, __, known: _enough(known, whole))
    return np.asarray(np.all(every, axis=0))


def _enough(known: Array, whole: Array) -> NDArray[np.bool_]:
    return np.asarray(np.diag(known) >= LEARNABLE * whole)


def held_out(
    evidence: LinearizedModel, part: NDArray[np.int64], whole: LinearizedModel | None = None
) -> HeldOut:
    """Predict every part by a fit to the others.

    Args:
        evidence: linearized model of all samples; the fit may use everything in its nuisance.
        part: number of the part that each sample is held out with, (n,).
        whole: the same including samples that the fits set aside, to be predicted as well.
    """
    square, misfit = np.full(len(evidence), np.nan), evidence.misfit
    predicted = evidence if whole is None else whole

    def predict(rows: NDArray[np.int64]) -> None:
        missed = predicted.take(rows).missed(evidence.but(rows).best(misfit))
        square[rows] = np.sum(missed**2, axis=1)

    mapped(predict, _each_of(part))
    return HeldOut(square, part)


def foretold(
    evidence: LinearizedModel,
    columns: Columns,
    bounds: tuple[Array, Array],
    part: NDArray[np.int64],
    precision: float = PRECISION,
) -> Foretold:
    """How much of the chi square that columns explain they also predict.

    The shares are 0 if they explain nothing, for example with values at their bounds.

    Every part is predicted with the values v fitted to the others. With D the decrease of chi
    square, the decrease of the part is the growth of ln p(part | others, v), doubled, with the
    nuisance parameters marginalized:

        sum_parts D_all(v) - D_others(v),    over D_all at the most likely values

    This share is small for a signal that dimensions could also make, but only far beyond their
    tolerances: the other parts already determine these dimensions, and the one held out adds
    little. Then `of_parts` still tells whether the parts agree on the values v.

    Args:
        evidence: of all samples.
        columns: the k columns of a candidate.
        bounds: lower and upper bounds of its values, (k,) each.
        part: number of the part that each sample is held out with, (n,).
        precision: of the prior of each value that the other parts do not determine.
    """
    information, b = evidence.information_of(columns), _along(evidence, columns)
    value = most_likely(information, b, *bounds)

    def predicted(others: LinearizedModel, own: Columns, known: Array) -> tuple[float, float]:
        along = _along(others, own)
        prior = np.where(_enough(known, np.diag(information)), PRECISION, precision)
        by_others = most_likely(known, along, *bounds, prior)
        first, second = (
            change(information, b, v) - change(known, along, v) for v in (by_others, value)
        )
        return first, second

    each = _without_each(evidence, columns, part, predicted)
    total, of_parts = np.sum(each, axis=0).tolist() if each else (0.0, 0.0)
    wholes = change(information, b, value), of_parts
    share, agreed = (total / whole if whole > 0.0 else 0.0 for whole in wholes)
    return Foretold(total, share, agreed)


def _along(evidence: LinearizedModel, columns: Columns) -> Array:
    return columns.along(evidence.weigh(evidence.column))[:, 0]


def _without_each(
    evidence: LinearizedModel,
    columns: Columns,
    part: NDArray[np.int64],
    function: Callable[[LinearizedModel, Columns, Array], _Result],
) -> list[_Result]:
    """Results of a function without each part in turn.

    It is given the evidence, its columns and their information (k, k). The products of a part are
    subtracted from those of all samples, which are computed once.
    """
    inner, across = columns.inner(), evidence.possible.across(columns)

    def without(rows: NDArray[np.int64]) -> _Result:
        others = np.delete(np.arange(len(part)), rows)
        held, known = (columns.part(own, evidence.coordinates) for own in (rows, others))
        beside = evidence.possible.part(rows, evidence.coordinates)
        left, shown = evidence.but(rows), across - beside.across(held)
        seen = left.rest.seen_of(known)
        return function(left, known, left.left_of(inner - held.inner(), shown, seen))

    return mapped(without, _each_of(part))


def _each_of(part: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """The samples of each part; none if there is only one part."""
    numbers = np.unique(part)
    return [np.flatnonzero(part == number) for number in numbers] if len(numbers) > 1 else []


def gain(
    before: HeldOut,
    after: HeldOut,
    noise: Array,
    rows: NDArray[np.bool_],
    place: NDArray[np.int64],
    rng: np.random.Generator,
) -> Gain:
    """Gain of one model over another on the same held-out samples, with a bootstrap over places.

    Args:
        before: held-out errors without the term.
        after: held-out errors with it.
        noise: variance of a reading's 3-D distance, (n,) [m^2].
        rows: mask of the samples whose error is reported, (n,).
        place: number of each sample's place, (n,); samples of one place are drawn together.
        rng: random generator of the bootstrap.
    """
    numbers, which = np.unique(place, return_inverse=True)
    metres = (np.where(rows, v, 0.0) for v in (before.square, after.square, noise))
    totals = np.stack([np.bincount(which, v) for v in metres], axis=1)
    drawn = totals[rng.integers(0, len(numbers), (_DRAWS, len(numbers)))].sum(axis=1)
    shares = _share(drawn)
    low, high = np.quantile(shares, [SURE_QUANTILE, 1 - SURE_QUANTILE])
    return Gain(
        before=before.rms(rows),
        after=after.rms(rows),
        share=float(_share(totals.sum(axis=0)[None])[0]),
        low=float(low),
        high=float(high),
    )


def _share(totals: Array) -> Array:
    """Share of the avoidable error that is removed; (k, 3) before, after, noise -> (k,)."""
    before, after, noise = totals[:, 0], totals[:, 1], totals[:, 2]
    avoidable = np.maximum(before - noise, 0.05 * before)
    return np.asarray(np.clip((before - after) / avoidable, -1.0, 1.0))


def _parts(value: Array, even: Array) -> NDArray[np.int64]:
    edges = np.quantile(even, np.linspace(0, 1, PARTS + 1)[1:-1])
    return np.searchsorted(edges, value).astype(np.int64)
