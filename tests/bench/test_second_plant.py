"""The double track and the multi-body model side by side, and the study with the latter alone."""

import pytest
import second_plant
import second_plant_settings
import yaml

from experiments.settings import preregistration

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


def test_only_the_plant_of_the_study_is_another_one(tmp_path):
    usual = preregistration.load()
    path = tmp_path / second_plant_settings.PLAN
    path.write_text(second_plant_settings.with_second_plant(usual.text))
    changed = preregistration.load(path)
    before, after = (yaml.safe_load(plan.text) for plan in (usual, changed))
    for name in second_plant_settings.ONLY:
        assert len(after['dimensions'].pop(name)['choice']) == 1
        del before['dimensions'][name]
    assert after == before


def test_a_plan_without_these_dimensions_is_refused():
    with pytest.raises(ValueError, match=r'dimensions\.car: is in the file 0 times'):
        second_plant_settings.with_second_plant('schema: 1\n')
