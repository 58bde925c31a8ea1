"""The controller's health, told once per second."""

from mpcc_controller.driving.explain import ERROR, OK, WARN
from mpcc_controller.driving.health import TOLD, Monitor
from msgs_yaml.types import Why

TICK = 50_000_000


def why(k, rung='solved', level=OK):
    return Why(1_000_000_000 + k * TICK, level, '', {'rung': rung, 'gate.rejections': 0})


def test_health_is_told_once_per_second_with_the_worst_of_it():
    monitor = Monitor('controller')
    said = [monitor.on_step(why(0))]
    said += [monitor.on_step(why(k, 'shifted', WARN)) for k in range(1, 20)]
    said += [monitor.on_step(why(20, 'braking', ERROR)), monitor.on_step(why(40))]
    told = [health for health in said if health]
    assert [health.level for health in told] == [OK, ERROR, OK]
    assert told[1].message == TOLD[ERROR]
    assert told[1].values == {
        'rung.braking': 1,
        'rung.shifted': 19,
        'rung.solved': 1,
        'gate.rejections': 0,
    }
