"""The controller of docs/ros2_control.md, compiled with stand-ins of ros2_control, and run.

The stand-ins follow the API documents and have only what the controller uses. The test does not
show that it builds with ros2_control itself.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from ruamel.yaml import YAML

from delta_calibration.compensation import JointCompensator
from delta_calibration.export import c_files
from delta_calibration.robot import load_robot
from export_bench import COMPILER, STRICT, machine

PAGE = Path(__file__).parents[1] / "docs" / "ros2_control.md"
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.S | re.M)
STAND_IN = r"""
#pragma once
#include <map>
#include <memory>
#include <string>
#include <vector>
namespace rclcpp {
struct Time {};
struct Duration { double s; double seconds() const { return s; } };
struct Parameter {
  std::vector<std::string> texts; double number = 0.0;
  std::vector<std::string> as_string_array() const { return texts; }
  double as_double() const { return number; }
};
}
namespace rclcpp_lifecycle {
struct State {};
struct LifecycleNode {
  std::map<std::string, rclcpp::Parameter> parameters;
  rclcpp::Parameter get_parameter(const std::string & name) const { return parameters.at(name); }
  const char * get_name() const { return "corrector"; }
};
}
namespace hardware_interface {
constexpr char HW_IF_POSITION[] = "position";
struct CommandInterface {
  CommandInterface(const std::string & prefix, const std::string & name, double * value)
  : full(prefix + "/" + name), value(value) {}
  std::string full; double * value;
};
struct LoanedCommandInterface {
  double value = 0.0;
  [[nodiscard]] bool set_value(double v) { value = v; return true; }
};
}
namespace controller_interface {
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration {
  interface_configuration_type type; std::vector<std::string> names = {};
};
class ChainableControllerInterface {
public:
  virtual ~ChainableControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) = 0;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual return_type update_reference_from_subscribers(
    const rclcpp::Time &, const rclcpp::Duration &) = 0;
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() const { return node_; }
  template <typename T> void auto_declare(const std::string & name, const T & value) {
    set(name, value);
  }
  std::vector<hardware_interface::CommandInterface> exported() {
    return on_export_reference_interfaces();
  }
  return_type cycle(double s) { return update_and_write_commands({}, {s}); }
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
  void set(const std::string & name, double value) { node_->parameters[name].number = value; }
  void set(const std::string & name, std::vector<std::string> value) {
    node_->parameters[name].texts = value;
  }
protected:
  virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() = 0;
  virtual return_type update_and_write_commands(
    const rclcpp::Time &, const rclcpp::Duration &) = 0;
  std::vector<double> reference_interfaces_;
private:
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_ =
    std::make_shared<rclcpp_lifecycle::LifecycleNode>();
};
}
"""
PROGRAM = r"""
#include "corrector_controller.cpp"
#include <cstdio>

int main()
{
  corrector::CorrectorController c;
  if (c.on_init() != controller_interface::CallbackReturn::SUCCESS) return 1;
  if (c.on_configure({}) != controller_interface::CallbackReturn::ERROR) return 2;  // no joints
  c.set("joints", std::vector<std::string>{"joint_1", "joint_2", "joint_3"});
  if (c.on_configure({}) != controller_interface::CallbackReturn::SUCCESS) return 3;
  auto references = c.exported();
  if (references[1].full != "corrector/joint_2/position") return 4;
  if (c.command_interface_configuration().names[2] != "joint_3/position") return 5;
  c.command_interfaces_.resize(3);
  c.on_activate({});
  c.cycle(0.001);  // nobody commands
  const auto show = [&c]() {
      for (auto & each : c.command_interfaces_) std::printf("%.17g ", each.value);
      std::printf("\n");
    };
  show();
  const double q[3] = {0.2, 0.1, 0.3};
  for (int i = 0; i < 3; ++i) *references[i].value = q[i];
  for (int n = 0; n < 400; ++n) { c.cycle(0.001); show(); }
  *references[0].value = 100.0;  // refused
  for (int n = 0; n < 400; ++n) { c.cycle(0.001); show(); }
  return 0;
}
"""


def block(language: str, begin: str = "") -> str:
    return next(text for kind, text in BLOCKS if kind == language and begin in text)


@pytest.mark.skipif(
    COMPILER is None or shutil.which("c++") is None, reason="no C and C++ compilers here"
)
def test_the_controller_corrects_over_a_ramp(tmp_path):
    calibration = machine(load_robot("srbd"), "rotary_delta")
    files = c_files(calibration, "machine")
    for name, text in (
        ("machine.h", files.header),
        ("machine.c", files.source),
        ("run.cpp", PROGRAM),
        ("corrector_controller.cpp", block("cpp")),
        ("stand_in.hpp", STAND_IN),
        ("controller_interface/chainable_controller_interface.hpp", '#include "stand_in.hpp"\n'),
        ("hardware_interface/types/hardware_interface_type_values.hpp", ""),
        ("pluginlib/class_list_macros.hpp", "#define PLUGINLIB_EXPORT_CLASS(a, b)\n"),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    subprocess.run([COMPILER, *STRICT, "-c", "machine.c"], cwd=tmp_path, check=True)
    strict = ["-std=c++17", "-O1", "-Wall", "-Wextra", "-Werror", "-I."]
    build = ["c++", *strict, "run.cpp", "machine.o", "-o", "run"]
    subprocess.run(build, cwd=tmp_path, check=True)
    said = subprocess.run(
        [str(tmp_path / "run")], check=True, capture_output=True, text=True
    ).stdout
    told = np.array([line.split() for line in said.splitlines()], dtype=float)
    q = np.array([[0.2, 0.1, 0.3]])
    expected = JointCompensator(calibration).compensate(q).joint[0]
    np.testing.assert_array_equal(told[0], 0.0)
    np.testing.assert_allclose(told[400], expected, atol=1e-10)
    steps = np.abs(np.diff(told[1:401], axis=0)).max()
    assert 0 < steps <= 0.5e-3 * (1 + 1e-9)
    np.testing.assert_allclose(told[-1], [100.0, 0.1, 0.3], atol=1e-12)


def test_its_other_files_can_be_read():
    for kind, text in BLOCKS:
        if kind == "xml":
            ElementTree.fromstring(text)
        elif kind == "yaml":
            names = YAML(typ="safe").load(text)["joint_trajectory_controller"]
            assert len(names["ros__parameters"]["command_joints"]) == 3
    assert "extended.yaml --format c --out machine.c" in PAGE.read_text(encoding="utf-8")
