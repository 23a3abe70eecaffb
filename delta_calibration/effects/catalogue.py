"""Catalogue of all effects: each effect of the package has its own file and a line here."""

from __future__ import annotations

from collections.abc import Mapping

from delta_calibration.effects.backlash import Backlash
from delta_calibration.effects.ball_joint_clearance import BallJointClearance
from delta_calibration.effects.base import Effect, Setting
from delta_calibration.effects.base_compliance import BaseCompliance
from delta_calibration.effects.cable_elasticity import CableElasticity
from delta_calibration.effects.cable_sag import CableSag
from delta_calibration.effects.counter_zero_offset import CounterZeroOffset
from delta_calibration.effects.drum_build_up import DrumBuildUp
from delta_calibration.effects.drum_eccentricity import DrumEccentricity
from delta_calibration.effects.drum_scale import DrumScale
from delta_calibration.effects.dynamic_deflection import DynamicDeflection
from delta_calibration.effects.encoder_eccentricity import EncoderEccentricity
from delta_calibration.effects.encoder_interpolation import EncoderInterpolation
from delta_calibration.effects.flange_compliance import FlangeCompliance
from delta_calibration.effects.forearm_compliance import ForearmCompliance
from delta_calibration.effects.found_law import FOUND_LAW, FoundLaw
from delta_calibration.effects.gravity_sag import GravitySag
from delta_calibration.effects.joint_compliance import JointCompliance
from delta_calibration.effects.joint_curve import JointCurve
from delta_calibration.effects.joint_lag import JointLag
from delta_calibration.effects.joint_scale import JointScale
from delta_calibration.effects.joint_zero_drift import JointZeroDrift
from delta_calibration.effects.pretension_loss import PretensionLoss
from delta_calibration.effects.pulley_radius import PulleyRadius
from delta_calibration.effects.reducer_compliance import ReducerCompliance
from delta_calibration.effects.reflector_shift import ReflectorShift
from delta_calibration.effects.slider_pitch import SliderPitch
from delta_calibration.effects.stick_slip import StickSlip
from delta_calibration.effects.thermal_growth_arm import ThermalGrowthArm
from delta_calibration.effects.thermal_growth_base import ThermalGrowthBase
from delta_calibration.effects.thermal_growth_forearm import ThermalGrowthForearm
from delta_calibration.effects.thermal_growth_link import ThermalGrowthLink
from delta_calibration.effects.thermal_growth_screw import ThermalGrowthScrew
from delta_calibration.effects.timestamp_latency import TimestampLatency
from delta_calibration.effects.tracker_drift import TrackerDrift
from delta_calibration.effects.tracker_scale import TrackerScale
from delta_calibration.effects.transmission_error import TransmissionError
from delta_calibration.effects.unexplained import UNEXPLAINED, Unexplained
from delta_calibration.errors import InputError
from delta_calibration.mechanisms import Mechanism
from delta_calibration.registry import Registry
from delta_calibration.robot import Robot

EFFECTS: Registry[Effect] = Registry(
    Effect,  # type: ignore[type-abstract]
    "cause",
    "delta_calibration.effects",
    (
        TrackerScale,
        TrackerDrift,
        TimestampLatency,
        EncoderEccentricity,
        TransmissionError,
        JointScale,
        Backlash,
        JointCompliance,
        JointLag,
        JointZeroDrift,
        StickSlip,
        ThermalGrowthArm,
        ThermalGrowthBase,
        ThermalGrowthForearm,
        ForearmCompliance,
        DynamicDeflection,
        BallJointClearance,
        CableElasticity,
        CableSag,
        PulleyRadius,
        DrumBuildUp,
        DrumScale,
        DrumEccentricity,
        CounterZeroOffset,
        SliderPitch,
        ReducerCompliance,
        GravitySag,
        JointCurve,
        ThermalGrowthLink,
        ThermalGrowthScrew,
        BaseCompliance,
        FlangeCompliance,
        PretensionLoss,
        EncoderInterpolation,
        ReflectorShift,
    ),
)

USUAL_PAIR = (Backlash.cause, "geometry")  # that the plan `separate` distinguishes, if not told


def catalogue(robot: Robot, mechanism: Mechanism) -> tuple[Effect, ...]:
    """Every effect that this robot can have, with its default shape."""
    every = (effect(robot, mechanism) for effect in EFFECTS.values())
    return tuple(effect for effect in every if effect.suits)


def called() -> dict[str, str]:
    """Names of causes in sentences, for those causes that have such a name."""
    every: tuple[type[Effect], ...] = (*EFFECTS.values(), Unexplained, FoundLaw)
    return {effect.cause: effect.called for effect in every if effect.called}


def effect_named(
    cause: str, robot: Robot, mechanism: Mechanism, settings: Mapping[str, Setting]
) -> Effect:
    """Create an effect from its cause and the settings of its shape.

    Raises:
        InputError: an unknown cause, one that does not suit the machine, an unknown setting, or a
            value that is not allowed; states which are.
    """
    known: dict[str, type[Effect]] = {**EFFECTS, UNEXPLAINED: Unexplained, FOUND_LAW: FoundLaw}
    if cause not in known:
        raise InputError(f"no effect {cause!r}; choose from: {', '.join(known)}")
    effect = known[cause](robot, mechanism)
    if not effect.suits:
        fitting = ", ".join(each.cause for each in catalogue(robot, mechanism))
        raise InputError(
            f"effect {cause}: {effect.unsuited}; effects that {robot.name} can have: {fitting}"
        )
    own = effect.settings
    odd = sorted(set(settings) - set(own))
    if odd:
        allowed = ", ".join(own) or "none"
        raise InputError(f"effect {cause}: unknown setting {', '.join(odd)}; allowed: {allowed}")
    try:
        shape = {name: _like(own[name], settings[name], name) for name in settings}
        effect = known[cause].shaped(robot, mechanism, shape)
        if effect.wrong():
            raise InputError(effect.wrong())
    except InputError as error:
        raise InputError(f"effect {cause}: settings.{error}") from error
    return effect


def _like(usual: Setting, value: object, name: str) -> Setting:
    """The value, if it has the type of the setting's usual value; else an `InputError`."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(usual, str) and isinstance(value, str):
        return value
    if isinstance(usual, float) and number:
        return float(value)  # type: ignore[arg-type]
    if isinstance(usual, tuple) and isinstance(value, list | tuple):
        return tuple(float(_like(0.0, item, name)) for item in value)  # type: ignore[arg-type]
    kind = {str: "a text", float: "a number", tuple: "a list of numbers"}[type(usual)]
    raise InputError(f"{name}: {value!r} is not allowed; {kind} is expected")
