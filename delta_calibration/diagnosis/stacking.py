"""Operations on evidence: stack several kinds, split samples into numbers, set samples aside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import joined
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.shared_path_error import AT_REST, SharedPathError

Array = NDArray[np.float64]


def stacked(parts: Sequence[LinearizedModel]) -> LinearizedModel:
    """Stack evidence of several kinds about one fit, all with d coordinates and without paths."""
    first = parts[0]
    if len(parts) == 1:
        return first
    at = reduce(joined, [part.at for part in parts])

    def every(name: str) -> Array:
        return np.concatenate([getattr(part, name) for part in parts])

    by_joints = every("by_joints")
    return replace(
        first,
        at=at,
        pose=every("pose"),
        whiten=every("whiten"),
        residual=every("residual"),
        nuisance=every("nuisance"),
        rest=SharedPathError.of(np.full(len(at), AT_REST), at, by_joints),
        precision=np.min([part.precision for part in parts], axis=0),  # 1 where one shows nothing
        poses=len(at),
        by_joints=by_joints,
        by_geometry=every("by_geometry"),
        by_mounts=every("by_mounts"),
        seen=reduce(joined, [part.seen for part in parts]),
        stood=None,
    )


def apart(evidence: LinearizedModel) -> LinearizedModel:
    """Split the samples, so that each number is a sample by itself."""
    n, d = evidence.residual.shape
    row = np.repeat(np.arange(n), d)

    def each(columns: Array) -> Array:
        return np.asarray(columns.reshape(n * d, 1, -1))

    at, by_joints = evidence.at.take(row), each(evidence.by_joints)
    return replace(
        evidence,
        at=at,
        pose=evidence.pose[row],
        whiten=np.einsum("nii->ni", evidence.whiten).reshape(n * d, 1, 1),
        residual=evidence.residual.reshape(-1, 1),
        nuisance=each(evidence.nuisance),
        rest=SharedPathError.of(np.full(n * d, AT_REST), at, by_joints),
        poses=n * d,
        by_joints=by_joints,
        by_geometry=each(evidence.by_geometry),
        by_mounts=each(evidence.by_mounts),
        seen=at,
        stood=None,
    )


def weighted(evidence: LinearizedModel, kept: Array) -> LinearizedModel:
    """The evidence with some of its samples set aside, (N,) 1 or 0."""
    root = kept[:, None, None]
    by_joints = root * evidence.by_joints
    return replace(
        evidence,
        whiten=root * evidence.whiten,
        residual=root[..., 0] * evidence.residual,
        nuisance=root * evidence.nuisance,
        others=tuple(each.weighed(root) for each in evidence.others),
        rest=evidence.rest.scaled(root),
        by_joints=by_joints,
        by_geometry=root * evidence.by_geometry,
        by_mounts=root * evidence.by_mounts,
    )
