"""What to measure next so that two explanations part, by computation.

The samples that an experiment would add are put beside those of the session, and the contrast of
the two explanations is taken over all of them. The cheapest experiment that is enough is proposed.
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
_ON_PATHS = 400  # samples of a session's paths that are looked at


def next_experiment(evidence: LinearizedModel, first: Candidate, second: Candidate | None) -> str:
    """The cheapest experiment after which two explanations part, in words.

    For many pairs on one session `Outlook` saves most of the work.

    Args:
        evidence: of the session; what stands beside the geometry in it is not carried over.
        first: what is to be seen.
        second: what it is to be parted from; None for the geometry alone.
    """
    effects = [c.effect for c in (first, second) if c is not None and c.effect is not None]
    robot = effects[0].robot if effects else None
    return Outlook.on(evidence, robot).next_experiment(first, second)


def visibility(evidence: LinearizedModel, effect: Effect) -> tuple[float, float]:
    """Signal of an effect of typical size beside the frame alone, and beside the geometry too.

    Each parameter is at its prior, with either sign where it may have both.
    """
    rows = tuple(range(len(effect.parameters)))
    pair = Pair(Candidate(effect.cause, effect.kind, None, effect, rows), None)
    layout = evidence.chain.layout
    return pair.signals(
        pair.products(_filled(evidence)), evidence.precision[layout.base], layout.geometry
    )


@dataclass(frozen=True)
class Outlook:
    """A session and all that could be measured next, ready for any pair of explanations."""

    measured: LinearizedModel
    foreseen: LinearizedModel  # of all experiments
    sentences: tuple[str, ...]  # of each experiment, the cheapest first
    number: Index  # (n,) of the experiment that each foreseen sample belongs to

    @classmethod
    def on(cls, evidence: LinearizedModel, robot: Robot | None = None) -> Outlook:
        """What could be measured after a session.

        Args:
            evidence: of the session.
            robot: whose joint limits hold; where not given, joints go no farther than they did.
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
        """By what it was said could be measured."""
        number = np.repeat(np.arange(len(further)), [len(evidence) for _, evidence in further])
        foreseen = pooled([evidence for _, evidence in further] or [measured])
        return cls(measured, foreseen, tuple(words for words, _ in further), number)

    def next_experiment(self, first: Candidate, second: Candidate | None) -> str:
        """The cheapest experiment after which two explanations part, in words.

        A dimension is parted from an effect by what shows the effect: any one dimension can hide
        among the others within their tolerances.
        """
        pair = Pair(first, second)
        if first.effect is None and second is not None and second.effect is not None:
            pair = Pair(second, first)
        options = list(self.options(pair))
        parted = (sentence for sentence, contrast in options if contrast.parted)
        # Where nothing else is in question, an effect that is seen is enough.
        seen = (s for s, contrast in options if pair.second is None and contrast.signal >= NAMED)
        nothing = NOTHING
        if self.measured.further is not None:
            nothing = NONE_OF_IT if self.sentences else NOT_SAID
        return next(chain(parted, seen), pair.outside or nothing)

    def options(self, pair: Pair) -> Iterator[tuple[str, Contrast]]:
        """As measured, with each experiment, and with each done several times over.

        The cosine is the one that there would be if as much were measured this way as was so far:
        it says what kind of difference an experiment makes, lambda how much. A signal that was
        too much like the second explanation's does not count, only what the experiment adds.
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
        """Precision of what all samples share, and which of it is geometry."""
        layout = self.measured.chain.layout
        return self.measured.precision[layout.base], layout.geometry

    def _added(self, columns: Array, number: int) -> Products:
        """What one experiment tells of columns over all of them, (d n, k)."""
        rows = np.flatnonzero(self.number == number)
        own = Plain(columns).part(rows, self.foreseen.coordinates)
        return Products.of(self.foreseen.take(rows), own.values)


def prepared(evidence: LinearizedModel) -> LinearizedModel:
    """The evidence with what it lacks taken for none, and a part of its paths for all of them."""
    return _thinned(_filled(evidence))


def _filled(evidence: LinearizedModel) -> LinearizedModel:
    """The evidence as if an unknown payload were none."""
    at = evidence.at
    if np.isfinite(at.payload).all():
        return evidence
    filled = replace(
        at, payload=np.nan_to_num(at.payload), payload_centre=np.nan_to_num(at.payload_centre)
    )
    return replace(evidence, at=filled, stood=None)


def _thinned(evidence: LinearizedModel) -> LinearizedModel:
    """All believed poses, and every so many samples of the paths in place of as many."""
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
        by_base=root * thin.by_base,
    )


def _session(evidence: LinearizedModel, robot: Robot | None) -> Session:
    at = evidence.at.take(slice(0, evidence.poses or None))
    if robot is None:
        lower, upper = at.joint.min(axis=0), at.joint.max(axis=0)
    else:
        lower, upper = robot.joints.lower, robot.joints.upper
    end = float(evidence.at.time.max())
    return Session(at, end, evidence.chain.mechanism, lower, upper)
