"""Parameters of real nodes: refused values, the time of refusal, and the messages."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from delta_calibration.errors import InputError
from delta_calibration.ros.parameters import ParameterTable, Spec, warn_of_unknown
from ros_helpers import Bench, bench_fixture  # noqa: F401

pytestmark = pytest.mark.ros

SPECS = (
    Spec("gain", 0.5, "share of the correction", range=(0.0, 1.0)),
    Spec("bound", 1.0, "largest correction [rad]"),
    Spec("count", 3, "repeats", range=(1, 10)),
    Spec("mode", "hold", "what to do on failure", choices=("hold", "pass_through")),
    Spec("axis", (0.0, 0.0, 1.0), "direction", range=(-1.0, 1.0)),
    Spec("robot", "srbd", "robot file", read_only=True),
    Spec("on", True, "whether to act"),
)


def table(bench: Bench, **given: object) -> ParameterTable:
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    return ParameterTable(bench.node("cell", parameter_overrides=overrides), SPECS)


def test_defaults_come_with_their_types(bench: Bench) -> None:
    parameters = table(bench)
    assert parameters.number("gain") == 0.5
    assert parameters.integer("count") == 3
    assert parameters.text("mode") == "hold"
    assert parameters.numbers("axis") == (0.0, 0.0, 1.0)
    assert parameters.flag("on") is True


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("gain", 1.5, r"^parameter gain: 1.5 is not in \[0.0, 1.0\]$"),
        ("gain", float("nan"), "gain"),
        ("gain", 1, "gain: 1 is not of type float; write 1.0"),
        ("bound", float("nan"), "bound: nan is not a finite number"),
        ("bound", float("inf"), "bound: inf is not a finite number"),
        ("count", 11, "count.*11"),
        ("count", 2.5, "count: 2.5 is not of type int"),
        ("mode", "guess", "mode: 'guess' is not one of hold, pass_through"),
        ("axis", [0.0, float("nan"), 1.0], "axis: nan is not a finite number"),
        ("axis", [0.0, 2.0, 1.0], r"axis: 2.0 is not in \[-1.0, 1.0\]"),
        ("axis", 1.0, "axis: 1.0 is not of type array"),
        ("on", "yes", "on: 'yes' is not of type bool"),
    ],
)
def test_a_wrong_value_at_the_start_is_an_input_error(
    bench: Bench, name: str, value: object, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        table(bench, **{name: value})


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("bound", float("nan"), "bound: nan is not a finite number"),
        ("gain", float("nan"), "gain"),
        ("mode", "guess", "mode: 'guess' is not one of hold, pass_through"),
        ("robot", "other", "read-only"),
        ("axis", [0.0, 0.0, -3.0], "axis: -3.0 is not in"),
    ],
)
def test_a_wrong_value_from_another_node_is_refused_with_the_reason(
    bench: Bench, name: str, value: object, said: str
) -> None:
    parameters = table(bench)
    before = parameters._value(name)
    client = bench.node("operator").create_client(SetParameters, "/cell/set_parameters")
    assert bench.until(client.service_is_ready)
    wanted = Parameter(name, value=value).to_parameter_msg()
    answer = client.call_async(SetParameters.Request(parameters=[wanted]))
    assert bench.until(answer.done)
    result = answer.result().results[0]
    assert not result.successful
    assert said in result.reason
    assert parameters._value(name) == before


def test_a_change_is_reported_once_it_stands(bench: Bench) -> None:
    node = bench.node("cell")
    seen: list[tuple[tuple[str, ...], float]] = []
    parameters = ParameterTable(
        node, SPECS, lambda names: seen.append((names, parameters.number("gain")))
    )
    assert seen == []
    node.set_parameters([Parameter("gain", value=0.75)])
    node.set_parameters([Parameter("gain", value=7.5)])
    assert seen == [(("gain",), 0.75)]


def test_what_is_declared_can_be_described(bench: Bench) -> None:
    node = bench.node("cell")
    ParameterTable(node, SPECS)
    gain, mode = node.describe_parameter("gain"), node.describe_parameter("mode")
    limits = gain.floating_point_range[0]
    assert (limits.from_value, limits.to_value) == (0.0, 1.0)
    assert gain.description == "share of the correction"
    assert "hold, pass_through" in mode.additional_constraints
    assert node.describe_parameter("robot").read_only


def test_a_mistyped_name_is_said(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    node = bench.node("cell", parameter_overrides=[Parameter("gian", value=0.1)])
    ParameterTable(node, SPECS)
    warn_of_unknown(node)
    said = capfd.readouterr().err
    assert "'gian'" in said
    assert "'gain'" in said
