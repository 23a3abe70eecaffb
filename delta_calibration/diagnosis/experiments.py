"""Choose the next experiment that separates two candidate causes.

The samples that an experiment would add are joined to those of the session, and the contrast of
the two candidates is computed over all of them. The cheapest sufficient experiment is proposed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.columns import Plain
from delta_calibration.diagnosis.constants import NAMED, SAME
from delta_calibration.diagnosis.contrast import Contrast, Pair
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.predicted_information import Foresight, Products, stacked
from delta_calibration.diagnosis.proposals import Session, proposals
from delta_calibration.diagnosis.stacking import stacked as pooled
from delta_calibration.effects import Effect
from delta_calibration.robot import Robot

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NOTHING = "nothing that this cell can do would separate them"
NOT_SAID = "no further measurements were offered"
NONE_OF_IT = "none of the offered measurements would separate them"
ALREADY = "the measurements already separate them"
_OVER = {1: "", 3: ", three times over", 10: ", ten times over"}
_ON_PATHS = 400  # about as many samples of a session's paths are used


def next_experiment(evidence: LinearizedModel, first: Candidate, second: Candidate | None) -> str:
    """The cheapest experiment that separates two candidates, in words.

    For many pairs of one session, `Outlook` saves most of the work.

    Args:
        evidence: of the session; terms in its nuisance are not extended to new samples.
        first: candidate that is to be detected.
        second: candidate that it is to be separated from; None for the geometry alone.
    """
    effects = [c.effect for c in (first, second) if c is not None and c.effect is not None]
    robot = effects[0].robot if effects else None
    return Outlook.on(evidence, robot).next_experiment(first, second)


def further_experiment(
    evidence: LinearizedModel, first: Candidate, second: Candidate | None
) -> str:
    """The experiment for two candidates that the session did not separate; empty if none is known.

    Where it separates them at their typical sizes, it did not at the size that was found, such as
    a curve that contains what the other candidate does: more poses do not change that.
    """
    said = next_experiment(evidence, first, second)
    return Pair(first, second).outside if said == ALREADY else said


def visibility(evidence: LinearizedModel, effect: Effect) -> tuple[float, float]:
    """Signal (lambda) of an effect of typical size, beside the frame, and beside the geometry too.

    Each parameter is at its prior, with either sign if its bounds allow both.
    """
    rows = tuple(range(len(effect.parameters)))
    pair = Pair(Candidate(effect.cause, effect.kind, None, effect, rows), None)
    layout = evidence.chain.layout
    return pair.signals(
        pair.products(_filled(evidence)), evidence.precision[layout.base], layout.geometry
    )


@dataclass(frozen=True)
class Outlook:
    """A session and all experiments that could follow it, ready for any pair of candidates."""

    measured: LinearizedModel
    foreseen: LinearizedModel  # evidence of the samples of all experiments
    sentences: tuple[str, ...]  # description of each experiment, the cheapest first
    number: Index  # (n,) index of the experiment of each foreseen sample

    @classmethod
    def on(cls, evidence: LinearizedModel, robot: Robot | None = None) -> Outlook:
        """Outlook on the experiments that could follow a session.

        Args:
            evidence: linearized model of the session.
            robot: gives the joint limits; if None, the ranges of the session are the limits.
        """
        measured = prepared(evidence)
        if measured.further is not None:
            return cls._said(measured, measured.further)
        foresight = Foresight.about(measured)
        experiments = tuple(proposals(_session(measured, robot)))
        samples = stacked([experiment.samples for experiment in experiments])
        number = np.repeat(np.arange(len(experiments)), [len(e.samples) for e in experiments])
        x = foresight.pose(samples)
        reached = np.flatnonzero(np.isfinite(x).all(axis=1))
        return cls(
            measured,
            foresight.evidence(samples.take(reached), x[reached]),
            tuple(experiment.sentence for experiment in experiments),
            number[reached],
        )

    @classmethod
    def _said(
        cls, measured: LinearizedModel, further: Sequence[tuple[str, LinearizedModel]]
    ) -> Outlook:
        """Outlook on the measurements that the caller offers."""
        number = np.repeat(np.arange(len(further)), [len(evidence) for _, evidence in further])
        foreseen = pooled([evidence for _, evidence in further] or [measured])
        return cls(measured, foreseen, tuple(words for words, _ in further), number)

    def next_experiment(self, first: Candidate, second: Candidate | None) -> str:
        """The cheapest experiment that separates two candidates, in words.

        To separate a dimension from an effect, the experiment must show the effect: any single
        dimension can hide among the others within their tolerances.
        """
        pair = Pair(first, second)
        if first.effect is None and second is not None and second.effect is not None:
            pair = Pair(second, first)
        options = list(self.options(pair))
        parted = (sentence for sentence, contrast in options if contrast.parted)
        # If there is no second candidate, it is enough that the effect is detected.
        seen = (s for s, contrast in options if pair.second is None and contrast.signal >= NAMED)
        nothing = NOTHING
        if self.measured.further is not None:
            nothing = NONE_OF_IT if self.sentences else NOT_SAID
        return next(chain(parted, seen), pair.outside or nothing)

    def options(self, pair: Pair) -> Iterator[tuple[str, Contrast]]:
        """Contrast as measured, with each experiment, and with each repeated several times.

        The cosine is computed as if at least as many samples as in the session were measured this
        way: it tells what kind of difference an experiment makes, lambda how much. If the session
        cannot separate the two, its signal does not count, only what the experiment adds.
        """
        precision, geometry = self._shared
        measured = pair.products(self.measured)
        now = pair.contrast(measured, precision, geometry)
        yield ALREADY, now
        columns = pair.columns(self.foreseen)
        added = [self._added(columns, i) for i in range(len(self.sentences))]
        distrusted = 0.0 if now.cosine < SAME else now.signal
        for times, over in _OVER.items():
            for i, sentence in enumerate(self.sentences):
                much = max(times, len(self.measured) / int(np.sum(self.number == i)))
                alike = pair.contrast(measured + added[i].times(much), precision, geometry)
                after = pair.contrast(measured + added[i].times(times), precision, geometry)
                yield sentence + over, Contrast(alike.cosine, after.signal - distrusted)

    @property
    def _shared(self) -> tuple[Array, slice]:
        """Prior precision of the unknowns that all samples share, and the geometry's slice."""
        layout = self.measured.chain.layout
        return self.measured.precision[layout.base], layout.geometry

    def _added(self, columns: Array, number: int) -> Products:
        """Inner products of one experiment, from columns (d n, k) over all experiments."""
        rows = np.flatnonzero(self.number == number)
        own = Plain(columns).part(rows, self.foreseen.coordinates)
        return Products.of(self.foreseen.take(rows), own.values)


def prepared(evidence: LinearizedModel) -> LinearizedModel:
    """The evidence with unknown payloads set to zero and the samples of its paths thinned out."""
    return _thinned(_filled(evidence))


def _filled(evidence: LinearizedModel) -> LinearizedModel:
    """The evidence with unknown payloads set to zero."""
    at = evidence.at
    if np.isfinite(at.payload).all():
        return evidence
    filled = replace(
        at, payload=np.nan_to_num(at.payload), payload_centre=np.nan_to_num(at.payload_centre)
    )
    return replace(evidence, at=filled, stood=None)


def _thinned(evidence: LinearizedModel) -> LinearizedModel:
    """All accepted poses, and every k-th accepted path sample with k times the weight."""
    good = np.flatnonzero(evidence.believed)
    resting, moving = good[good < evidence.poses], good[good >= evidence.poses]
    every = max(1, len(moving) // _ON_PATHS)
    thin = evidence.take(np.concatenate([resting, moving[::every]]))
    root = np.ones((len(thin), 1, 1))
    root[thin.poses :] = np.sqrt(every)
    return replace(
        thin,
        whiten=root * thin.whiten,
        residual=root[..., 0] * thin.residual,
        nuisance=root * thin.nuisance,
        others=tuple(each.weighed(root) for each in thin.others),
        rest=thin.rest.scaled(root),
        by_joints=root * thin.by_joints,
        by_geometry=root * thin.by_geometry,
        by_mounts=root * thin.by_mounts,
    )


def _session(evidence: LinearizedModel, robot: Robot | None) -> Session:
    at = evidence.at.take(slice(0, evidence.poses or None))
    if robot is None:
        lower, upper = at.joint.min(axis=0), at.joint.max(axis=0)
    else:
        lower, upper = robot.joints.lower, robot.joints.upper
    end = float(evidence.at.time.max())
    return Session(at, end, evidence.chain.mechanism, lower, upper)
