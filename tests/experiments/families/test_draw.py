"""Draws: every one is a scenario and depends on its four arguments alone."""

import itertools

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.families import emergencies, feasibility, scenario_document
from experiments.families.draw import DIFFICULTIES, HARD, LIBRARY, NOMINAL, draw
from scenario_publisher import scenario
from scenario_publisher.waypoint_track import motion_at

POP_UP_SPEED = 14.0133  # m/s, of draw 0 under seed 1000
numbers = st.integers(0, 10**6)


@pytest.mark.parametrize('family', LIBRARY)
def test_every_draw_is_a_scenario_in_which_nobody_is_beyond_the_friction(family):
    @settings(max_examples=6)
    @given(seed=numbers, index=numbers, difficulty=st.sampled_from(DIFFICULTIES))
    def example(seed, index, difficulty):
        one = draw(family, seed, index, difficulty)
        scn = one.scenario()
        assert scn.name == one.name
        # the controller sees its whole horizon of path when it crosses the finish
        for block in yaml.safe_load(one.text)['obstacles']:
            stations = [point['station_m'] for point in block.get('waypoints', ())]
            assert (np.diff(stations) > 0.0).all()
        ref = scn.reference
        finish = np.argmin(np.hypot(ref.X - scn.stop.X, ref.Y - scn.stop.Y))
        assert ref.t[-1] - ref.t[finish] >= 2.5
        assert scn.stop.time > 2.0 * ref.t[finish]
        # nobody corners or brakes beyond the friction of the road
        # 2 % for the difference between two ways of differencing
        t, most = np.arange(0.0, scn.stop.time, 0.05), 1.02 * scn.friction * feasibility.GRAVITY
        for track in (actor.track for actor in scn.actors if actor.track is not None):
            vX, vY = np.gradient(motion_at(track, t)[:2], 0.05, axis=1)
            aX, aY = np.gradient([vX, vY], 0.05, axis=1)
            turns_and_brakes = np.abs([vX * aY - vY * aX, vX * aX + vY * aY])
            assert (turns_and_brakes < most * np.maximum(np.hypot(vX, vY), 0.5)).all()

    example()


@pytest.mark.parametrize('family', ['hidden_pedestrian', 'unforeseen_pedestrian'])
@pytest.mark.parametrize('index', range(3))
def test_a_car_at_the_desired_speed_meets_who_comes_out_from_behind_a_van(family, index):
    scn = draw(family, 1, index).scenario()
    ref, walker = scn.reference, scn.actors[1]

    def at(t):
        car = (float(np.interp(t, ref.t, ref.X)), 0.0)
        (walks,) = scenario.obstacles_at(scn, t, 1).items[1:]
        seen = walks.id in (o.id for o in scenario.obstacles_at(scn, t, 1, car).items)
        return car[0], walks, seen

    assert not at(walker.appears)[2] or family == 'hidden_pedestrian'
    arrives = np.interp(walker.obstacle.X - feasibility.CAR_NOSE, ref.X, ref.t)
    x, walks, seen = at(float(arrives))
    assert seen
    assert x + feasibility.CAR_NOSE == pytest.approx(walks.X, abs=0.01)
    assert abs(walks.Y) <= 1.0 < abs(walker.obstacle.Y)
    least = np.min(np.diff(ref.X) / np.diff(ref.t))
    _, cruise = scn.speeds[-1]
    assert least < 0.7 * cruise if family == 'hidden_pedestrian' else least > 0.99 * cruise


def test_draws_of_a_pair_differ_in_who_is_foreseen_and_in_when_they_begin_alone():
    pair = [
        yaml.safe_load(draw(family, 1, 0).text)
        for family in ('hidden_pedestrian', 'unforeseen_pedestrian')
    ]
    for document in pair:
        del document['name'], document['sight']['emerging_mps']
    begins = [document['obstacles'][1].pop('appears_at_s') for document in pair]
    assert pair[0] == pair[1]
    assert begins[0] > begins[1]  # of whom a slower car meets


def test_a_draw_depends_on_its_family_seed_index_and_difficulty_alone():
    asked = list(itertools.product(LIBRARY, (1, 2), (0, 1), DIFFICULTIES))
    forwards = {arguments: draw(*arguments) for arguments in asked}
    assert forwards == {arguments: draw(*arguments) for arguments in reversed(asked)}
    assert len({one.text for one in forwards.values()}) == len(asked)
    # results of a seed are compared over time: the numbers must not move
    document = yaml.safe_load(draw('pop_up', 1000, 0).text)
    assert document['speed'] == {'constant_mps': POP_UP_SPEED}


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (('popup', 1, 0), "no family 'popup'; there are pop_up"),
        (('pop_up', 1, 0, 'harder'), "no difficulty 'harder'; there are nominal, hard"),
        (('pop_up', -1, 0), 'must be 0 or more'),
        (('pop_up', 1, -1), 'must be 0 or more'),
    ],
)
def test_what_is_no_draw_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        draw(*arguments)


def test_hard_roads_are_slippery_and_controllers_are_not_told():
    frictions = []
    for index in range(40):
        one = draw('pop_up', 5, index, HARD)
        frictions.append(yaml.safe_load(one.text)['friction'])
        assert one.settings['controller']['model.friction'] == 1.0
        assert 0 <= one.settings['plant']['command_delay_ms'] <= 40
    assert 0.5 <= min(frictions) < 0.6
    assert 0.9 < max(frictions) <= 1.0
    assert not draw('pop_up', 5, 0, NOMINAL).settings


def test_both_sides_are_drawn():
    left = [yaml.safe_load(draw('oncoming', 1, i).text)['road']['edges'] for i in range(20)]
    wide = sum(edges['left']['offset_m'] > -edges['right']['offset_m'] for edges in left)
    assert 4 <= wide <= 16


def test_a_barrier_closes_the_whole_road():
    scn = draw('closed_road', 1, 0).scenario()
    places = sorted(o.obstacle.Y for o in scn.actors)
    radius = scn.actors[0].obstacle.r_obs
    assert max(np.diff(places)) < 2 * radius
    assert places[0] - radius < scn.edges.right[0, 1] + feasibility.CAR_WIDTH / 2
    assert places[-1] + radius > scn.edges.left[0, 1] - feasibility.CAR_WIDTH / 2


def test_lanes_of_iso_3888_have_the_widths_and_places_of_the_standard():
    width = feasibility.CAR_WIDTH
    scn = draw('iso_3888_2', 1, 0).scenario()
    begin = emergencies.RUN_IN
    # x at the middle of lanes 1, 3 and 5
    for x, lane in (
        (begin + 6.0, 1.1 * width + 0.25),
        (begin + 12.0 + 13.5 + 5.5, width + 1.0),
        (begin + 12.0 + 13.5 + 11.0 + 12.5 + 6.0, max(3.0, 1.3 * width + 0.25)),
    ):
        left, right = (np.interp(x, edge[:, 0], edge[:, 1]) for edge in scn.edges[1:])
        assert left - right == pytest.approx(lane, abs=2e-3)
    first, third = begin + 6.0, begin + 12.0 + 13.5 + 5.5
    left_of_first = np.interp(first, *scn.edges.left.T)
    right_of_third = np.interp(third, *scn.edges.right.T)
    assert right_of_third - left_of_first == pytest.approx(1.0, abs=2e-3)


def test_a_mirrored_document_is_the_mirror_image():
    document = yaml.safe_load(draw('bend_inside', 1, 3).text)
    original, image = (
        scenario.parse(yaml.safe_dump(d), 'a.yaml')
        for d in (document, scenario_document.mirrored(document))
    )
    assert np.allclose(original.reference.Y, -image.reference.Y, atol=1e-9)
    assert np.allclose(original.edges.left[:, 1], -image.edges.right[:, 1], atol=1e-9)
    mirrored = -image.actors[0].obstacle.Y
    assert mirrored == pytest.approx(original.actors[0].obstacle.Y)
    assert scenario_document.mirrored(scenario_document.mirrored(document)) == document
