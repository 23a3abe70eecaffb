from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.errors import InputError
from delta_calibration.parameters import Parameter, ParameterSet

ARM = Parameter("arm_1", "m", 0.32, 1e-4, "arm_length", "joint_1")
ZERO = Parameter("zero_1", "rad", 0.0, 8e-4, "joint_zero_offset", "joint_1")
TURN = Parameter("turn", "rad", 0.0, float("inf"))


def test_vector_order_is_the_order_given():
    both = ParameterSet((ARM, ZERO)) + ParameterSet((TURN,))
    assert both.names == ("arm_1", "zero_1", "turn")
    assert both.units == ("m", "rad", "rad")
    np.testing.assert_array_equal(both.nominal, [0.32, 0, 0])
    np.testing.assert_array_equal(both.prior, [1e-4, 8e-4, np.inf])
    assert [both.row(name) for name in both.names] == [0, 1, 2]
    assert list(both) == [ARM, ZERO, TURN]
    assert len(both) == 3


def test_nominal_and_prior_are_copies():
    both = ParameterSet((ARM, ZERO))
    both.nominal[1], both.prior[1] = 1e-3, 1e-3
    np.testing.assert_array_equal(both.nominal, [0.32, 0])
    np.testing.assert_array_equal(both.prior, [1e-4, 8e-4])


def test_names_must_be_unique_and_known():
    with pytest.raises(InputError, match="found twice: arm_1"):
        ParameterSet((ARM, ZERO)) + ParameterSet((ARM,))
    with pytest.raises(InputError, match="no parameter 'arm_9'; there are: arm_1, zero_1"):
        ParameterSet((ARM, ZERO)).row("arm_9")
