"""The calibration file: identified parameters, which the node loads, and their provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration import __version__
from delta_calibration.calibration import Calibration
from delta_calibration.chain import Chain
from delta_calibration.data import Poses
from delta_calibration.documents import content_hash, load_schema, read_document, write_document
from delta_calibration.effects import Effect, effect_named
from delta_calibration.errors import ConfigError, InputError
from delta_calibration.estimation import Identification, Residuals, chain_of
from delta_calibration.mechanisms.possible import impossible
from delta_calibration.region import Region
from delta_calibration.robot import Robot
from delta_calibration.uncertainty import ModelError, Uncertainty

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_SEAL = "sha256"


def from_identification(found: Identification, robot: Robot, poses: Poses) -> Calibration:
    """Build the calibration that `save_calibration` would write and `load_calibration` return."""
    lower, upper = found.region_joints
    return Calibration(
        robot,
        found.chain,
        found.theta,
        found.region,
        lower,
        upper,
        found.noise.floor,
        poses.source,
        content_hash(_content(found, robot, poses)),
        found.full.held_out,
        found.uncertainty,
        poses.digest,
        _ended(found, poses),
    )


def save_calibration(path: Path, found: Identification, robot: Robot, poses: Poses) -> None:
    """Write a calibration file atomically.

    Args:
        path: the file.
        found: result of the fit: geometry, frame, and the effects in its chain.
        robot: the robot that was identified.
        poses: the poses that were fitted.

    Raises:
        ConfigError: the file cannot be written.
    """
    write_document(path, document_of(found, robot, poses))


def document_of(found: Identification, robot: Robot, poses: Poses) -> dict[str, Any]:
    """Content of a calibration file, as plain data."""
    content = _content(found, robot, poses)
    return {**content, _SEAL: content_hash(content)}


def require_ours(path: Path) -> None:
    """Refuse to overwrite an existing file that this package did not write.

    Raises:
        ConfigError: the file is no calibration, or was edited by hand.
    """
    if not path.exists():
        return
    try:
        data = read_document(path, lambda _: load_schema("calibration"))
    except ConfigError as error:
        raise ConfigError(
            f"{path}: exists and is not a calibration file: it is not overwritten"
        ) from error
    content = {key: value for key, value in data.items() if key != _SEAL}
    if content_hash(content) != data[_SEAL]:
        raise ConfigError(f"{path}: was edited by hand: it is not overwritten")


def load_calibration(path: Path, robot: Robot) -> Calibration:
    """Read a calibration made for this robot.

    Raises:
        ConfigError: missing, incomplete, changed after it was written, made for another robot,
            with parameters that its model does not have, or with dimensions of no machine.
    """
    data = read_document(path, lambda _: load_schema("calibration"))
    return calibration_of(data, robot, str(path))


def calibration_of(data: Mapping[str, Any], robot: Robot, source: str) -> Calibration:
    """Build the calibration from a document that was made for this robot.

    Args:
        data: a document as `document_of` returns it, valid under its schema.
        robot: the robot that was calibrated.
        source: name of the document in messages.

    Raises:
        ConfigError: incomplete, changed after it was made, made for another robot, with
            parameters that its model does not have, or with dimensions of no machine.
    """
    content = {key: value for key, value in data.items() if key != _SEAL}
    if content_hash(content) != data[_SEAL]:
        raise ConfigError(
            f"{source}: {_SEAL}: the file was changed or cut off after it was written; fit again"
        )
    made_for = data["robot"]
    # files written before 0.2.0 hold the hash of the whole robot file
    if made_for["sha256"] not in (robot.machine_hash, robot.hash):
        raise ConfigError(
            f"{source}: robot: made for {made_for['name']!r} with hash {made_for['sha256'][:12]}, "
            f"but {robot.source} is {robot.name!r} with hash {robot.machine_hash[:12]}; "
            "fit again with this robot file"
        )
    try:
        chain = chain_of(robot, data["model"])
    except ConfigError as error:
        raise ConfigError(f"{source}: model: {error}") from error
    chain, values = _with_effects(source, chain, robot, data.get("effects", []))
    try:
        parameters = chain.parameters
    except InputError as error:  # the same effect twice
        raise ConfigError(f"{source}: effects: {error}") from error
    try:
        rows = _rows_of(data["parameters"], chain)
    except ValueError as error:
        raise ConfigError(f"{source}: parameters: model {data['model']!r} {error}") from error
    theta = np.concatenate([parameters.nominal[chain.layout.base], values])
    theta[rows] = [entry["value"] for entry in data["parameters"]]
    if wrong := impossible(chain.mechanism, chain.split(theta)[0]):
        raise ConfigError(f"{source}: parameters: {wrong}")
    region = data["region"]
    lower, upper = _joint_range(source, region, robot)
    return Calibration(
        robot=robot,
        chain=chain,
        theta=theta,
        region=Region(np.array(region["vertices_m"], dtype=float)),
        joints_lower=lower,
        joints_upper=upper,
        noise_floor=float(data["noise"]["floor_mm"]) * 1e-3,
        held_out=float(data["residuals"]["full"]["error_left_rms_mm"]) * 1e-3,
        source=data["provenance"]["session"],
        seal=data[_SEAL],
        uncertainty=_uncertainty(source, data, parameters.prior, rows),
        measured=data["provenance"].get("measured_sha256", ""),
        ended=data["provenance"].get("session_end_s"),
    )


def _rows_of(entries: Sequence[Mapping[str, Any]], chain: Chain) -> Index:
    """Row of each entry among the parameters of mechanism, reflector and frame, (p,).

    A file may be older than the model: errors of parts that the model did not have then are zero.

    Raises:
        ValueError: says what is wrong with the entries.
    """
    found, known = [entry["name"] for entry in entries], chain.parameters.names[chain.layout.base]
    if unknown := [name for name in found if name not in known]:
        raise ValueError(f"has no {', '.join(unknown[:5])}; fit again")
    errors = {p.name for p in chain.mechanism.parameters if p.nominal == 0.0}
    if lacking := [name for name in known if name not in found and name not in errors]:
        raise ValueError(f"has {', '.join(lacking[:5])}, which the file lacks; fit again")
    rows = [known.index(name) for name in found]
    if sorted(set(rows)) != rows:
        raise ValueError("has its parameters in another order, each once; fit again")
    return np.array(rows, dtype=np.int64)


def _uncertainty(
    source: str, data: Mapping[str, Any], prior: Array, rows: Index
) -> Uncertainty | None:
    """Read the uncertainty; None if the file was written before this section existed.

    Args:
        source: name of the document in messages.
        data: the document.
        prior: standard deviations of all parameters before the fit, (P,).
        rows: of the file's parameters among those of mechanism, reflector and frame, (p,). What is
            not in the file is known to its prior.
    """
    if "uncertainty" not in data:
        return None
    told = data["uncertainty"]
    kept = np.concatenate([rows, np.arange(rows[-1] + 1, len(prior))])
    size = len(kept)
    factor = np.diag(prior)
    try:
        lines = [[float(number) for number in row.split()] for row in told["factor_lower"]]
    except ValueError as error:
        raise ConfigError(f"{source}: uncertainty: factor_lower: {error}") from error
    whole = [len(row) for row in lines] == list(range(1, size + 1))
    if not (whole and all(np.isfinite(row).all() for row in lines)):
        raise ConfigError(
            f"{source}: uncertainty: factor_lower: the lower triangle of {size} rows of finite "
            "numbers is expected"
        )
    for k, row in enumerate(lines):
        factor[kept[k], kept[: k + 1]] = row
    model = told["model"]
    joints = len(data["region"]["joints_lower_rad"])
    if len(model["play"]) != joints:
        raise ConfigError(
            f"{source}: uncertainty: model.play: {len(model['play'])} values found, {joints} are "
            "expected"
        )
    return Uncertainty(
        factor @ factor.T,
        1e-6 * float(told.get("repeatability_urad", data["noise"]["repeatability_urad"])),
        ModelError(
            1e-12 * np.array(model["covariance_um2"], dtype=float),
            np.array(model["middle_m"], dtype=float),
            np.array(model["shape_per_m2"], dtype=float),
            float(model["share"]),
            float(model["widen"]),
            np.array(model["play"], dtype=float),
            1e-12 * float(model.get("doubt_um2", 0.0)),
            float(model.get("kurtosis", 0.0)),
        ),
        float(told.get("repeatability_degrees_of_freedom", np.inf)),
    )


def _uncertainty_told(found: Identification) -> dict[str, Any]:
    """Section `uncertainty`, with the covariance as its factor L, C = L L^T.

    Rounded to eight figures, the factor still gives a valid covariance. Each row is one text: a
    document with so many separate entries would be slow to read.
    """
    model, rest = found.uncertainty.model, found.uncertainty.repeatability
    value, way = np.linalg.eigh(found.uncertainty.covariance)
    root = (way * np.sqrt(np.maximum(value, 0.0))).T
    factor = np.asarray(np.linalg.qr(root, mode="r")).T
    known = found.uncertainty.freedom
    return {
        "factor_lower": [
            " ".join(f"{entry:.8g}" for entry in row[: k + 1])
            for k, row in enumerate(factor.tolist())
        ],
        "model": {
            "covariance_um2": (1e12 * model.covariance).tolist(),
            "middle_m": model.middle.tolist(),
            "shape_per_m2": model.shape.tolist(),
            "share": model.share,
            "widen": model.widen,
            "play": model.play.tolist(),
            "doubt_um2": 1e12 * model.doubt,
            **({"kurtosis": model.kurtosis} if model.kurtosis else {}),
        },
        **({"repeatability_urad": 1e6 * rest} if rest != found.noise.repeatability else {}),
        **({"repeatability_degrees_of_freedom": known} if np.isfinite(known) else {}),
    }


def _joint_range(source: str, region: Mapping[str, Any], robot: Robot) -> tuple[Array, Array]:
    """Lowest and highest measured joint values, (m,) each [rad or m]."""
    ends = []
    for key in ("joints_lower_rad", "joints_upper_rad"):
        if len(region[key]) != len(robot.joints.names):
            raise ConfigError(
                f"{source}: region.{key}: {len(region[key])} values found, "
                f"{len(robot.joints.names)} are expected"
            )
        ends.append(np.array(region[key], dtype=float))
    if (ends[0] > ends[1]).any():
        raise ConfigError(f"{source}: region: joints_lower_rad is above joints_upper_rad")
    return ends[0], ends[1]


def _with_effects(
    source: str, chain: Chain, robot: Robot, entries: Sequence[Mapping[str, Any]]
) -> tuple[Chain, list[float]]:
    """The chain with the file's effects added, and their values in the order of theta."""
    effects: list[Effect] = []
    values: list[float] = []
    for number, entry in enumerate(entries):
        where = f"{source}: effects[{number}]: {entry['cause']}"
        effect = _effect(where, entry, chain, robot)
        effects.append(effect)
        values += [float(p["value"]) for p in entry["parameters"]]
    return chain.with_effects(tuple(effects)), values


def _effect(where: str, entry: Mapping[str, Any], chain: Chain, robot: Robot) -> Effect:
    """Build one effect with the settings of the file; refuse parameters that it does not have."""
    try:
        effect = effect_named(entry["cause"], robot, chain.mechanism, entry["settings"])
        expected = effect.parameters
    except InputError as error:
        raise ConfigError(f"{where}: {error}") from error
    for what, known in (("name", expected.names), ("unit", expected.units)):
        found = [p[what] for p in entry["parameters"]]
        if found != list(known):
            raise ConfigError(
                f"{where}: parameters: {what}s {', '.join(found)}; it has {', '.join(known)}"
            )
    return effect


def _effects(found: Identification) -> list[dict[str, Any]]:
    """Section `effects`: settings and identified parameters of each effect of the chain."""
    chain = found.chain
    each = zip(
        chain.effects,
        chain.effect_values(found.theta),
        chain.effect_values(found.std),
        strict=True,
    )
    return [
        {
            "cause": effect.cause,
            "settings": {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in effect.settings.items()
            },
            "parameters": [
                dict(name=p.name, unit=p.unit, value=float(v), std=float(s))
                for p, v, s in zip(effect.parameters, values, std, strict=True)
            ],
        }
        for effect, values, std in each
    ]


def _content(found: Identification, robot: Robot, poses: Poses) -> dict[str, Any]:
    lower, upper = found.region_joints
    base = found.chain.layout.base
    fitted = zip(found.parameters.items[base], found.theta[base], found.std[base], strict=True)
    content = {
        "schema": 1,
        "robot": {"name": robot.name, "sha256": robot.machine_hash},
        "model": found.chain.mechanism.name,
        "provenance": _provenance(found, poses),
        "noise": {
            "floor_mm": found.noise.floor * 1e3,
            "degrees_of_freedom": found.noise.degrees,
            "measured": found.noise.measured,
            "repeatability_urad": found.noise.repeatability * 1e6,
            "radial_scale": found.noise.radial_scale,
            "transverse_scale": found.noise.transverse_scale,
        },
        "residuals": {"frame_only": _residuals(found.frame_only), "full": _residuals(found.full)},
        "parameters": [
            dict(name=p.name, unit=p.unit, nominal=p.nominal, value=float(v), std=float(s))
            for p, v, s in fitted
        ],
        "observability": {
            "rank": found.observability.rank,
            "columns": found.observability.columns,
            "indices": dict(found.observability.indices),
            "not_set_by_the_data": [r.sentence() for r in found.observability.redundancies],
            "correlated": [f"{a} with {b}: {value:+.3f}" for a, b, value in found.correlations],
        },
        "region": {
            "vertices_m": found.region.vertices.tolist(),
            "joints_lower_rad": lower.tolist(),
            "joints_upper_rad": upper.tolist(),
        },
        "uncertainty": _uncertainty_told(found),
    }
    return {**content, "effects": _effects(found)} if found.chain.effects else content


def _provenance(found: Identification, poses: Poses) -> Mapping[str, Any]:
    effort = found.effort
    counted = {} if effort.evaluations is None else {"evaluations": effort.evaluations}
    ended = _ended(found, poses)
    start = datetime.fromtimestamp(poses.start_ns * 1e-9, tz=timezone.utc)
    return {
        "package_version": __version__,
        "session": Path(poses.source).name,
        "session_start": start.isoformat(timespec="seconds"),
        **({} if ended is None else {"session_end_s": ended}),
        "method": effort.method,
        **counted,
        **effort.settings,
        "seed": found.seed,
        "poses": len(poses),
        "readings": poses.readings,
        "measured_sha256": poses.digest,
        "rejected": poses.rejected.counts(),
        "notes": list(poses.notes),
    }


def _ended(found: Identification, poses: Poses) -> float | None:
    """Last pose [s] on the clock of effects that are bound to the session; None without any."""
    bound = any(effect.bound_to_session for effect in found.chain.effects)
    return float(poses.time.max()) if bound else None


def _residuals(residuals: Residuals) -> dict[str, float]:
    return {
        "in_sample_rms_mm": residuals.in_sample * 1e3,
        "error_left_rms_mm": residuals.held_out * 1e3,
        "error_left_max_mm": residuals.held_out_max * 1e3,
        "error_left_whitened": residuals.held_out_whitened,
    }
