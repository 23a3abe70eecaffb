"""The layout of theta: every entry has one name, with one meaning in chain, fits and diagnosis."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from delta_calibration.chain import Chain
from delta_calibration.data import at_rest
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.fitted import theta_layout, without_effects
from delta_calibration.effects import effect_named
from delta_calibration.errors import InputError
from delta_calibration.estimation import HeightAtContact, Measured, PointMeasured, chain_of
from delta_calibration.estimation.mixed_measurements import problem_of
from delta_calibration.estimation.problem import MOUNT_NAMES
from delta_calibration.geometry import Frame, rotations
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.theta import Layout, Parts, entries, length

ROBOT = load_robot("srbd")
CAUSES = ("backlash", "thermal_growth_arm", "tracker_scale")
FULL = Layout(5, (("play", 2), ("map", 0), ("scale", 1)), has_mount=True)
LAYOUTS = {
    "full": FULL,
    "chain": Layout(5, (("play", 2), ("scale", 1))),
    "bare": Layout(5),
    "observations": Layout(5, has_offset=False),
    "no_geometry": Layout(0, (("play", 2),)),
}


def chain(*causes: str) -> Chain:
    bare = chain_of(ROBOT)
    return bare.with_effects(tuple(effect_named(c, ROBOT, bare.mechanism, {}) for c in causes))


def atoms(layout: Layout) -> tuple[slice, ...]:
    return (
        layout.geometry,
        layout.offset,
        layout.turn,
        layout.place,
        layout.mount,
        *layout.each,
    )


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_parts_lie_side_by_side_and_cover_theta(layout):
    ends = [0, *(part.stop for part in atoms(layout))]
    assert [(part.start, part.stop) for part in atoms(layout)] == list(pairwise(ends))
    assert ends[-1] == layout.size
    assert layout.mask(*atoms(layout)).all()


def test_places_by_hand():
    """Written by hand: five of geometry, then 3 + 3 + 3, 3, 2 + 0 + 1."""
    assert [(p.start, p.stop) for p in atoms(FULL)] == [
        (0, 5),
        (5, 8),
        (8, 11),
        (11, 14),
        (14, 17),
        (17, 19),
        (19, 19),
        (19, 20),
    ]
    assert (FULL.dimensions, FULL.frame, FULL.base) == (slice(0, 8), slice(8, 14), slice(0, 17))
    assert (FULL.effects, FULL.size) == (slice(17, 20), 20)
    assert FULL.chain.tolist() == [*range(14), 17, 18, 19]
    assert (FULL["play"], FULL["map"], FULL["scale"]) == FULL.each
    assert FULL.effect(2) == slice(19, 20)
    device = LAYOUTS["observations"]
    assert (length(device.offset), device.frame, device.size) == (0, slice(5, 11), 11)


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_join_undoes_split(layout):
    theta = np.random.default_rng(0).standard_normal(layout.size)
    parts = layout.split(theta)
    np.testing.assert_array_equal(layout.join(parts), theta)
    np.testing.assert_array_equal(parts.frame, theta[layout.mask(layout.turn, layout.place)])
    assert [len(values) for values in parts.effects] == [size for _, size in layout.effect_sizes]


def test_join_refuses_parts_of_another_size():
    parts = LAYOUTS["chain"].split(np.zeros(17))
    wrong = Parts(parts.geometry, parts.offset, np.zeros(3), parts.effects, parts.mount)
    with pytest.raises(InputError, match=r"frame of shape \(3,\); \(6,\)"):
        LAYOUTS["chain"].join(wrong)
    with pytest.raises(InputError, match="2 effects; it has 0"):
        LAYOUTS["bare"].join(parts)


def test_an_effect_is_asked_for_by_its_cause():
    with pytest.raises(InputError, match="no effect 'latency' in theta; it has: play, scale"):
        LAYOUTS["chain"]["latency"]
    twice = LAYOUTS["bare"].with_effects([("play", 2), ("play", 3)])
    with pytest.raises(InputError, match="several effects 'play'"):
        twice["play"]
    assert twice.effect(1) == slice(16, 19)


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_columns_stand_in_the_places_of_their_parts(layout):
    """Columns of each part hold its own number; parts that are not given hold zeros."""
    blocks = [
        np.full((4, 3, length(part)), number + 1.0) for number, part in enumerate(atoms(layout))
    ]
    geometry, offset, turn, place, mount, *effects = blocks
    whole = layout.columns(geometry, offset, turn, place, mount, effects)
    assert whole.shape == (4, 3, layout.size)
    for number, part in enumerate(atoms(layout)):
        assert (whole[..., part] == number + 1).all()
    some = layout.columns(geometry, place=place)
    own = layout.mask(layout.geometry, layout.place)
    np.testing.assert_array_equal(some, np.where(own, whole, 0.0))


@pytest.mark.parametrize("name", known_robots())
def test_a_chains_layout_names_the_parameters_of_each_mechanism(name):
    """Compared with the parameter names, which are assembled independently of the layout."""
    made = chain_of(load_robot(name))
    mechanism = made.mechanism
    names, layout = made.parameters.names, made.layout
    assert len(names) == layout.size
    assert names[layout.geometry] == mechanism.parameters.names
    assert names[layout.offset] == ("reflector_x", "reflector_y", "reflector_z")
    assert names[layout.turn] == ("tracker_turn_x", "tracker_turn_y", "tracker_turn_z")
    assert names[layout.place] == ("tracker_place_x", "tracker_place_y", "tracker_place_z")


def test_a_chains_layout_names_its_effects():
    made = chain(*CAUSES)
    names = made.parameters.names
    for number, (cause, effect) in enumerate(zip(CAUSES, made.effects, strict=True)):
        own = tuple(f"{cause}.{p.name}" for p in effect.parameters)
        assert names[made.layout[cause]] == names[made.layout.effect(number)] == own
    assert made.with_effects(()).layout == chain().layout != made.layout


def test_a_chain_reads_each_part_where_its_layout_says():
    """A shift of the tracker shifts the reading, a turn rotates it, as in the equation."""
    made, rng = chain("backlash", "tracker_scale"), np.random.default_rng(3)
    at = at_rest(rng.uniform(-0.2, 0.4, (6, 3)))
    frame = Frame(rotations.exp(np.array([0.3, -0.2, 0.5])), np.array([3.0, 0.1, -0.4]))
    offset = np.array([0.02, 0.01, -0.05])
    theta = made.join(made.mechanism.parameters.nominal, offset, frame)
    x, layout = made.pose(at, theta), made.layout
    other = theta.copy()
    other[layout.place] += (1.0, 2.0, 3.0)
    other[layout.offset] = 0.0
    other[layout.turn] = 0.0
    expected = made.mechanism.position(x) + frame.translation + (1.0, 2.0, 3.0)
    np.testing.assert_allclose(made.predict(at, other), expected, atol=1e-12)
    np.testing.assert_array_equal(theta[layout.geometry], made.mechanism.parameters.nominal)


def test_how_a_probe_is_mounted_stands_with_how_all_is_placed():
    """The mounting is behind the frame and before the effects, which a diagnosis changes."""
    layout = chain(*CAUSES).layout
    mounted, size = layout.mounted, len(MOUNT_NAMES)
    assert mounted.mount == slice(layout.place.stop, layout.place.stop + size)
    assert [part.start for part in mounted.each] == [part.start + size for part in layout.each]
    theta = np.arange(mounted.size)
    assert not np.isin(theta[mounted.mount], theta[mounted.chain]).any()
    assert length(layout.mount) == 0


def test_a_fit_of_observations_frees_geometry_and_where_it_matters_the_frame():
    mechanism = chain().mechanism
    joint = np.tile(mechanism.home, (4, 1))
    height = Measured(HeightAtContact(joint, np.zeros(4), 1e-3), at_rest(joint))
    point = Measured(PointMeasured(joint, np.ones((4, 3)), np.zeros(3), 1e-3), at_rest(joint))
    layout = chain().layout
    alone = problem_of([height], mechanism, None)
    assert (alone.free == layout.mask(layout.geometry)).all()
    placed = problem_of([height, point], mechanism, Frame.identity())
    assert (placed.free == layout.mask(layout.geometry, layout.frame)).all()


def test_terms_find_their_effects_in_theta():
    """A dimension among the terms takes no entry, so later entries do not move."""
    made = chain("backlash", "tracker_scale")
    terms = [Candidate(e.cause, e.kind, None, e, (0,)) for e in made.effects]
    terms.insert(1, Candidate("arm_length", "geometry", None, None, (2,)))
    layout = theta_layout(chain().layout, terms)
    assert layout.size == made.layout.size
    assert (layout.effect(0), layout.effect(2)) == made.layout.each
    assert length(layout.effect(1)) == 0
    theta = np.arange(1.0, made.layout.size + 1)
    without = without_effects(theta, layout)
    assert not without[made.layout.effects].any()
    np.testing.assert_array_equal(without[layout.base], theta[: len(chain().parameters)])
    np.testing.assert_array_equal(entries(layout.effect(2)), [len(theta) - 1])
