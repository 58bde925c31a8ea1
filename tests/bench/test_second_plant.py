"""The double track and the multi-body model side by side."""

import pytest
import second_plant

pytest.importorskip('vehiclemodels')


def test_both_plants_brake_alike_and_part_in_a_turn():
    names = ('straight_braking', 'turn_braking')
    driven = second_plant.perform(names)
    straight, turn = (
        {plant: driven[name][plant].numbers[key].value for plant in second_plant.PLANTS}
        for name, key in zip(names, ('full_braking_distance', 'yaw_rate_ratio_at_4'), strict=True)
    )
    assert straight['double track'] == pytest.approx(straight['multi-body'], rel=1e-3)
    assert turn['double track'] - turn['multi-body'] > 0.2
