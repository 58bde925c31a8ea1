"""Drawn points become courses, plants, speeds and controllers that are what they say."""

import dataclasses
import math

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments import plant_limit
from experiments.batch import distributions
from experiments.settings import arms, course, demand, drive, plant_variants, setting
from experiments.settings.demand import Circle, Task
from experiments.settings.plan import Plan
from experiments.settings.plant_variants import Variant
from experiments.settings.setting import Rejected, Setting
from scenario_publisher import scenario
from vehicle_plant import parameters as plant_parameters

SHAPES = {
    'change_1_m': st.floats(14.0, 35.0),
    'change_2_m': st.floats(14.0, 35.0),
    'offset_m': st.floats(2.5, 4.0),
    'plateau_m': st.floats(10.0, 35.0),
    'obstacle_1_share': st.floats(0.7, 1.0),
    'obstacle_2_share': st.floats(0.7, 1.0),
    'clearance_1_m': st.floats(-0.3, 0.5),
    'clearance_2_m': st.floats(-0.3, 0.5),
    'radius_1_m': st.floats(0.5, 1.5),
    'radius_2_m': st.floats(0.5, 1.5),
    'room_left_m': st.floats(0.3, 2.0),
    'room_right_m': st.floats(0.3, 2.0),
}


@settings(max_examples=12, deadline=None)
@given(values=st.fixed_dictionaries(SHAPES), radius=st.floats(1.0, 1.3))
def test_a_car_on_the_path_passes_with_the_drawn_clearances(plan, values, radius):
    layout = course.lay_out(values, radius, 60.0)
    fine = course.document(layout, 20.0, plan.course) | {'sampling': {'path_m': 0.1}}
    scn = scenario.parse(yaml.safe_dump(fine), 'test')
    path = np.column_stack([scn.reference.X, scn.reference.Y])
    for number, disc in enumerate(scn.obstacles.items, start=1):
        gaps = np.hypot(*(path - (disc.X, disc.Y)).T) - disc.r_obs - radius
        # the path is sampled, and coordinates are rounded to 0.1 mm
        assert gaps.min() == pytest.approx(values[f'clearance_{number}_m'], abs=2e-3)
        nearest = path[np.argmin(gaps)]
        assert (nearest[1] > disc.Y) == (number == 1)  # on its left, then on its right
    left, right = scn.edges.left[0, 1], scn.edges.right[0, 1]
    assert left - path[:, 1].max() - radius == pytest.approx(values['room_left_m'], abs=1e-3)
    assert path[:, 1].min() - right - radius == pytest.approx(values['room_right_m'], abs=1e-3)


def test_the_speed_is_that_at_which_the_task_demands_the_drawn_share(plan, make_setting):
    """By the linear program at that very speed, on the scenario as it is driven."""
    made = make_setting(S=0.5)
    scn = scenario.parse(made.text, 'test')
    room = made.radius + 0.5
    begin = max(45.0, 2.5 * made.speed + 10.0) - 45.0
    x = np.arange(begin, begin + 200.0, 0.25)
    low = np.full(len(x), scn.edges.right[0, 1] + room)
    high = np.full(len(x), scn.edges.left[0, 1] - room)
    circles = tuple(
        Circle(disc.X, disc.Y, disc.r_obs + room, on_left)
        for disc, on_left in zip(scn.obstacles.items, (True, False))
    )
    assert scn.start.speed == pytest.approx(made.speed, abs=1e-3)
    required = demand.least_peak(Task(x, low, high, circles), scn.start.speed)
    assert required / made.plant.limit == pytest.approx(0.5, rel=5e-3)


def test_the_entry_grows_with_the_speed_and_the_demand_does_not(plan, make_setting):
    """A car that sees the change 2.5 s ahead has not begun it when it starts."""
    slow, fast = make_setting(S=0.15), make_setting(S=0.5)
    assert slow.curvature == fast.curvature
    assert fast.speed / slow.speed == pytest.approx(math.sqrt(0.5 / 0.15))
    first = []
    for made in (slow, fast):
        path = scenario.parse(made.text, 'test').reference
        first.append(path.X[np.argmax(np.abs(path.Y) > 1e-3)])
        expected = max(45.0, 2.5 * made.speed + 10.0)
        assert first[-1] == pytest.approx(expected, abs=2.0)  # a change begins gently
    assert first[1] > first[0]


def test_obstacle_2_has_a_station_beyond_its_x(make_setting):
    """Which is the length of the path up to the point nearest to it."""
    made = make_setting()
    scn = scenario.parse(made.text, 'test')
    path = np.column_stack([scn.reference.X, scn.reference.Y])
    lengths = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))
    disc = scn.obstacles.items[1]
    nearest = np.argmin(np.hypot(*(path - (disc.X, disc.Y)).T))
    assert made.second_at == pytest.approx(lengths[nearest], abs=0.5)
    assert made.second_at > path[nearest, 0] + 0.2


def test_a_point_is_no_setting_where_a_safety_distance_cannot_be_kept(make_setting):
    assert make_setting(room_right_m=0.4).reason == setting.TOO_NEAR
    assert make_setting(clearance_1_m=-0.3, room_left_m=0.5).reason == setting.TOO_NEAR
    assert make_setting(S=1.2).reason == setting.TOO_FAST
    assert make_setting(S=0.01).reason == setting.TOO_SLOW


def test_a_point_depends_on_seed_and_number_alone(plan):
    few, many = setting.draw(plan, 5, 0, 8), setting.draw(plan, 5, 0, 64)
    assert many[:8] == few
    assert setting.draw(plan, 5, 32, 4) == many[32:36]
    assert setting.draw(plan, 6, 0, 8) != few


@settings(max_examples=12, deadline=None)
@given(
    car=st.sampled_from(['bmw_545i.yaml', 'bmw_330i.yaml', 'vw_gti.yaml']),
    share_=st.floats(0.5, 0.65),
)
def test_the_front_axle_has_its_share_of_an_unchanged_roll_moment(car, share_):
    """The moment of springs and bars at a roll angle, wheel by wheel."""

    def moment(axle, bar, roll=0.02):
        travel = roll * axle.track_m / 2
        force = axle.ride_rate_npm * travel + bar * 2 * travel  # left against right
        return 2 * force * axle.track_m / 2

    suspension = plant_parameters.load(plant_parameters.car_file(car)).car.suspension
    changed = plant_variants.plant_settings(Variant(car, 1.0, share_))
    axles = {'front': suspension.front, 'rear': suspension.rear}
    before = {name: moment(axle, axle.antiroll_npm) for name, axle in axles.items()}
    after = {
        name: moment(axle, changed[f'car.suspension.{name}.antiroll_npm'])
        for name, axle in axles.items()
    }
    assert sum(after.values()) == pytest.approx(sum(before.values()))
    assert after['front'] / sum(after.values()) == pytest.approx(share_)


def test_a_share_that_the_springs_exceed_is_refused():
    with pytest.raises(ValueError, match=r'roll_share: is 0\.9; the springs of the rear axle'):
        plant_variants.plant_settings(Variant('bmw_545i.yaml', 1.0, 0.9))


def test_the_unchanged_car_holds_what_the_demand_of_the_paper_is_compared_with(make_setting):
    """Rear stiffness and roll share near those of the car: its limit within 1 %."""
    plant = plant_parameters.load(plant_parameters.car_file('bmw_545i.yaml'))
    assert make_setting().plant.limit == pytest.approx(plant_limit.lateral_limit(plant), rel=0.01)


def test_circles_stand_for_the_car(plan, plant):
    radius, offsets = setting.vehicle_circles(1, plant, plan.circles)
    assert (radius, offsets) == (1.1, (0.0,))
    radius, offsets = setting.vehicle_circles(2, plant, plan.circles)
    assert np.mean(offsets) == pytest.approx((plant.front - plant.rear) / 2)
    assert offsets[1] - offsets[0] == pytest.approx(2.2)
    radius, offsets = setting.vehicle_circles(3, plant, plan.circles)
    corners = [(x, plant.width / 2) for x in np.linspace(-plant.rear, plant.front, 50)]
    assert all(min(math.hypot(x - o, y) for o in offsets) <= radius + 1e-9 for x, y in corners)


def prepare(plan, made, arm):
    return drive.prepare(drive.plan_drive(plan, made, arm))


def test_the_matched_baseline_has_the_weights_of_the_mpcc(plan, make_setting):
    made = make_setting(contouring_tolerance_m=0.3, priority_edge_ratio=4.0, brake_split='fixed')
    mpcc, baseline = (prepare(plan, made, arm) for arm in (arms.MPCC, arms.MATCHED))
    for group in ('tolerances', 'priorities', 'safety', 'body', 'limits'):
        assert getattr(mpcc.params, group) == getattr(baseline.params, group)
    assert mpcc.params.tolerances.contouring_m == 0.3
    assert mpcc.params.priorities.edge == pytest.approx(4000.0)
    assert mpcc.params.limits.brake_front_share_min == mpcc.params.limits.brake_front_share_max
    assert (mpcc.plant, mpcc.vehicle, mpcc.scn.text) == (
        baseline.plant,
        baseline.vehicle,
        baseline.scn.text,
    )


def test_without_collision_avoidance_only_the_priorities_differ(plan, make_setting):
    made = make_setting()
    mpcc, no_ca = (prepare(plan, made, arm).params for arm in (arms.MPCC, arms.NO_CA))
    assert no_ca.priorities.obstacle == no_ca.priorities.edge == 0.0
    assert dataclasses.replace(no_ca, priorities=mpcc.priorities) == mpcc


def test_the_factorial_begins_at_the_mpcc_and_switches_one_factor_per_digit(plan, make_setting):
    made = make_setting()
    mpcc = prepare(plan, made, arms.MPCC).params
    assert prepare(plan, made, 'factorial:00000').params == mpcc
    assert len(set(arms.COMBINATIONS)) == 32
    switched = {
        '10000': ('formulation', {'distance': 'path'}),
        '01000': ('formulation', {'lag': False}),
        '00100': ('formulation', {'priority': 'step'}),
        '00010': ('priorities', {'obstacle': 250.0, 'edge': 75.0}),
        '00001': ('formulation', {'heading': True}),
    }
    for digits, (group, changed) in switched.items():
        expected = dataclasses.replace(
            mpcc, **{group: dataclasses.replace(getattr(mpcc, group), **changed)}
        )
        assert prepare(plan, made, f'factorial:{digits}').params == expected


def test_the_plant_is_late_and_the_controller_wrong_as_drawn(plan, make_setting):
    late = prepare(plan, make_setting(latency_ms=50, friction_error=-0.1), arms.MPCC)
    assert late.plant.car.steering.delay_ms == 50
    assert late.params.model.friction == pytest.approx(0.9)
    assert late.friction == 1.0


def test_a_perturbation_moves_the_start_alone(plan, make_setting):
    made = make_setting()
    nominal, faster = (
        drive.prepare(drive.plan_drive(plan, made, arms.MPCC, number)) for number in (0, 1)
    )
    moved = drive.plan_drive(plan, made, arms.MPCC)._replace(start=Plan(speed_mps=0.0, y_m=0.01))
    aside = drive.prepare(moved)
    assert faster.scn.start.speed == pytest.approx(nominal.scn.start.speed + 0.05)
    assert pytest.approx(nominal.scn.start.Y + 0.01) == aside.scn.start.Y
    unmoved = faster._replace(scn=faster.scn._replace(start=nominal.scn.start))
    assert repr(unmoved.params) == repr(nominal.params)
    assert unmoved.scn.reference.t.tolist() == nominal.scn.reference.t.tolist()


def test_different_drives_have_different_keys(plan, make_setting):
    made, other = make_setting(), make_setting(latency_ms=25)
    tasks = [drive.plan_drive(plan, made, arm) for arm in (arms.MPCC, arms.NO_CA, arms.MATCHED)]
    tasks += [drive.plan_drive(plan, made, arms.MPCC, 2), drive.plan_drive(plan, other, arms.MPCC)]
    keys = [drive.key(task) for task in tasks]
    assert len(set(keys)) == len(keys)
    assert drive.key(drive.plan_drive(plan, made, arms.MPCC)) == keys[0]


def test_some_drawn_points_are_settings_and_the_others_have_a_reason(plan):
    one_plant = {'car': 'bmw_545i.yaml', 'rear_cornering': 0.944, 'roll_share': 0.6}
    fixed = {name: distributions.Choice((value,)) for name, value in one_plant.items()}
    narrow = Plan(**{**vars(plan), 'dimensions': plan.dimensions | fixed})
    built = setting.build_range(narrow, 1, 0, 48)
    found = [one for one in built if isinstance(one, Setting)]
    assert found
    assert all(one.reason for one in built if isinstance(one, Rejected))
    assert all(14.0 <= one.speed <= 45.0 for one in found)


def test_a_changed_controller_file_is_another_drive(plan, make_setting, tmp_path):
    """Although it has the same name, and no parameter of the arm is another one."""
    file, keys = tmp_path / 'own.yaml', []
    task = drive.plan_drive(plan, make_setting(), arms.MPCC)
    task = task._replace(arm=task.arm._replace(controller=str(file)))
    for horizon in (50, 52, 50):
        parameters = {'base': 'mpcc.yaml', 'model': {'horizon': horizon}}
        file.write_text(yaml.safe_dump({'/**': {'ros__parameters': parameters}}))
        drive.controller_digest.cache_clear()
        keys.append(drive.key(task))
    assert keys[0] == keys[2] != keys[1]


def test_a_changed_plant_file_is_another_drive_and_another_draw(plan, make_setting, tmp_path):
    text = plant_parameters.car_file('bmw_545i.yaml').read_text()
    made, found = make_setting(), []
    for name, own in (('a', text), ('b', text.replace('mass_kg: 1850', 'mass_kg: 1860'))):
        file = tmp_path / f'{name}.yaml'
        file.write_text(own)
        found.append(plant_variants.digest(str(file)))
    assert found[0] == plant_variants.digest('bmw_545i.yaml') != found[1]
    task = drive.plan_drive(plan, made, arms.MPCC)
    other = made._replace(values=made.values | {'car': str(tmp_path / 'b.yaml')})
    assert drive.key(task) != drive.key(task._replace(setting=other))
