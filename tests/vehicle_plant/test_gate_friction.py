"""The friction that the gate of the plant takes each axle to have."""

import dataclasses

import pytest

from vehicle_plant.gate import axle_friction


def test_the_friction_of_the_axles_is_that_of_the_tyre_under_their_load(params):
    # by hand: 18148.5 N on 1.43 m and 1.46 m, CoG at 0.54 m; mu = 0.85 (1.21 - 0.037 dfz)
    def of_load(load):
        return 0.85 * (1.21 - 0.037 * (load / 2 - 4000) / 4000) * load

    moved = 0.54 * 10000 / 2.89
    front, rear = 18148.5 * 1.46 / 2.89, 18148.5 * 1.43 / 2.89
    for Fx, load_f, load_r in (
        (0.0, front, rear),
        (-10000.0, front + moved, rear - moved),
        (10000.0, front - moved, rear + moved),
    ):
        expected = of_load(load_f), of_load(load_r)
        assert axle_friction(Fx, params, 1.0) == pytest.approx(expected, rel=1e-12)
        twice = [2 * held for held in expected]
        assert axle_friction(Fx, params, 2.0) == pytest.approx(twice, rel=1e-12)


def test_no_more_load_moves_than_the_friction_of_the_whole_car_can_move(params):
    most = 1.21 * 18148.5
    assert axle_friction(-9e9, params, 1.0) == axle_friction(-most, params, 1.0)
    assert axle_friction(9e9, params, 1.0) == axle_friction(most, params, 1.0)
    assert axle_friction(-1.1 * most, params, 1.2) != axle_friction(-most, params, 1.2)
    assert axle_friction(-0.9 * most, params, 1.0) != axle_friction(-most, params, 1.0)


def test_each_axle_has_the_tyre_of_its_own_scaling(params):
    scaling = params.car.scaling
    for name, which in (('front', 0), ('rear', 1)):
        factors = dataclasses.replace(getattr(scaling, name), LMUX=1.7, LFZO=2.0)
        car = dataclasses.replace(
            params.car, scaling=dataclasses.replace(scaling, **{name: factors})
        )
        changed = axle_friction(0.0, dataclasses.replace(params, car=car), 1.0)
        before = axle_friction(0.0, params, 1.0)
        load = 18148.5 * (1.46, 1.43)[which] / 2.89
        assert changed[which] == pytest.approx(
            1.7 * (1.21 - 0.037 * (load / 2 - 8000) / 8000) * load, rel=1e-12
        )
        assert changed[1 - which] == before[1 - which]
