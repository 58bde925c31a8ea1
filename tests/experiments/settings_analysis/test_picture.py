"""The paper's picture: bounds, features of three drives, the cube that is searched, neighbours."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bags.errors import BagError
from experiments.batch.distributions import Choice
from experiments.settings import preregistration
from experiments.settings_analysis import existence, picture_search
from experiments.settings_analysis import picture as pictures
from experiments.settings_analysis.existence import Judged
from experiments.settings_analysis.picture import Bound
from experiments.settings_analysis.picture_search import Candidate

CONFIG = Path(__file__).parents[3] / 'experiments/config'
PLAN = preregistration.load(CONFIG / 'settings_study.yaml')
PICTURE = pictures.load(CONFIG / 'paper_picture.yaml')
VALUES = {'safety_obstacle_m': 0.5, 'safety_edge_m': 0.5, 'plant_limit_mps2': 8.75}
DRIVE = {
    'completed': True,
    'outline_1_m': 0.4,
    'outline_edge_m': 0.9,
    'min_outline_gap_m': 0.4,
    'min_v2o_m': 0.55,
    'v2o_2_m': 0.6,
    'min_v2e_m': 0.6,
    'v2e_right_m': 0.6,
    'limit_share': 1.0,
    'peak_brake_mps2': 5.0,
    'peak_sideslip_deg': 3.0,
    'peak_sideslip_at_m': 60.0,
    'brake_onset_planned_at_m': 60.0,
    'braking_s': 0.5,
    'counter_steer_s': 0.0,
    'min_speed_mps': 20.0,
    'overshoots_at_m': [],
}
# what the paper's figures show of the other two
NO_CA = DRIVE | {'outline_1_m': -0.2, 'min_outline_gap_m': -0.2}
BASELINE = DRIVE | {
    'min_v2o_m': 0.3,
    'v2o_2_m': 0.3,
    'min_v2e_m': 0.2,
    'v2e_right_m': 0.2,
    'peak_sideslip_deg': 9.0,
    'peak_sideslip_at_m': 130.0,
    'brake_onset_planned_at_m': 80.0,
    'braking_s': 1.5,
    'counter_steer_s': 0.6,
    'min_speed_mps': 18.0,
    'overshoots_at_m': [125.0, 135.0],
}


def missed(no_ca=NO_CA, mpcc=DRIVE, baseline=BASELINE):
    """Return the items that three drives miss."""
    features = pictures.features(no_ca, mpcc, baseline, VALUES, PICTURE.stations)
    shortfalls = pictures.shortfalls(features, PICTURE)
    return {name for name, value in shortfalls.items() if value}


def test_what_the_paper_shows_is_the_whole_picture():
    assert missed() == set()


@pytest.mark.parametrize(
    ('car', 'changes', 'expected'),
    [
        ('no_ca', {'outline_1_m': 0.05}, {'no_ca_outline_1_m'}),
        ('no_ca', {'limit_share': 0.9}, {'least_limit_share'}),
        ('mpcc', {'brake_onset_planned_at_m': 75.0}, {'onset_lead_m'}),
        ('mpcc', {'brake_onset_planned_at_m': None}, {'onset_lead_m'}),
        ('mpcc', {'peak_sideslip_deg': 4.5}, {'mpcc_sideslip_deg'}),
        ('mpcc', {'min_v2o_m': 0.4}, {'mpcc_kept_m'}),
        ('mpcc', {'min_speed_mps': 17.0}, {'speed_gain_mps'}),
        ('mpcc', {'completed': False}, {'mpcc_clear_m'}),
        ('mpcc', {'peak_brake_mps2': 8.7}, {'greatest_brake_share'}),
        ('baseline', {'peak_sideslip_deg': 5.0}, {'baseline_sideslip_deg'}),
        ('baseline', {'peak_sideslip_at_m': 60.0}, {'baseline_sideslip_off_m'}),
        ('baseline', {'v2o_2_m': 0.55}, {'baseline_intrusion_2_m'}),
        ('baseline', {'v2e_right_m': 0.55}, {'baseline_intrusion_right_m'}),
        ('baseline', {'overshoots_at_m': [125.0]}, {'baseline_overshoot_far_m'}),
        ('baseline', {'min_outline_gap_m': -0.1}, {'baseline_clear_m'}),
        ('baseline', {'braking_s': 0.2}, {'braking_gain_s'}),
        ('baseline', {'counter_steer_s': -0.1}, {'counter_steer_gain_s'}),
    ],
)
def test_one_difference_misses_one_item(car, changes, expected):
    cars = {'no_ca': NO_CA, 'mpcc': DRIVE, 'baseline': BASELINE}
    assert missed(**cars | {car: cars[car] | changes}) == expected


@given(st.floats(-100.0, 100.0), st.floats(0.1, 10.0))
def test_a_shortfall_is_measured_in_scales_up_to_the_cap(value, scale):
    shortfall = Bound(scale, least=-1.0, most=2.0).shortfall(value, PICTURE.cap)
    assert (shortfall == 0.0) == (-1.0 <= value <= 2.0)
    assert shortfall <= PICTURE.cap
    outside = max(-1.0 - value, value - 2.0) / scale
    if 0.0 < outside < PICTURE.cap:
        assert shortfall == pytest.approx(outside)


def test_what_does_not_exist_misses_by_the_cap():
    assert Bound(1.0, least=0.0).shortfall(None, 3.0) == 3.0
    assert Bound(1.0, least=0.0).shortfall(math.nan, 3.0) == 3.0


def test_an_unknown_item_is_refused(tmp_path):
    text = (CONFIG / 'paper_picture.yaml').read_text()
    file = tmp_path / 'picture.yaml'
    file.write_text(text.replace('onset_lead_m', 'onset_lead'))
    with pytest.raises(BagError, match='onset_lead'):
        pictures.load(file)


SHARES = st.fixed_dictionaries(
    {
        name: st.sampled_from(range(len(kind.values)))
        if isinstance(kind, Choice)
        else st.floats(0.0, 1.0)
        for name, kind in PLAN.dimensions.items()
    }
)


@given(SHARES)
def test_the_cube_and_the_values_agree(shares):
    values = picture_search.from_cube(PLAN, shares)
    again = picture_search.from_cube(PLAN, picture_search.to_cube(PLAN, values))
    for name, kind in PLAN.dimensions.items():
        assert again[name] == pytest.approx(values[name], rel=1e-6, abs=1e-9)
        if not isinstance(kind, Choice):
            assert kind.ends()[0] <= values[name] <= kind.ends()[-1]


def make_candidate(number=1, distance=2.0):
    values = picture_search.from_cube(
        PLAN,
        {name: 0 if isinstance(k, Choice) else 0.5 for name, k in PLAN.dimensions.items()},
    )
    return Candidate(number, values, '', {}, {}, distance)


def test_neighbours_differ_by_at_most_the_ratio():
    candidate = make_candidate()
    found = existence.neighbours(PLAN, PICTURE, candidate)
    assert len(found) == PICTURE.hold_out.neighbours
    for values in found:
        for name, kind in PLAN.dimensions.items():
            if isinstance(kind, Choice):
                assert values[name] == candidate.values[name]
            else:
                off = abs(values[name] - candidate.values[name])
                assert off <= PICTURE.hold_out.ratio * abs(candidate.values[name]) + 1e-12
                assert kind.ends()[0] <= values[name] <= kind.ends()[-1]


@pytest.mark.parametrize(
    ('distances', 'text'),
    [
        ((0.0, 0.0), 'the whole picture exists'),
        ((0.0, 0.5), 'becomes the demo'),
        ((4.0, 5.0), 'no setting is near enough'),
    ],
)
def test_what_becomes_of_the_nearest_setting(distances, text):
    judged = [Judged(make_candidate(), distances, (1.0,), PICTURE.demo.near)]
    assert text in existence.demo_verdict(judged, PICTURE)


def test_nothing_found_is_said():
    assert existence.demo_verdict([], PICTURE) == 'no setting could be driven'
