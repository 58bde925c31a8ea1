"""The faults of `faults.yaml`."""

from pathlib import Path
from typing import Any, NamedTuple

import yaml

HERE = Path(__file__).parent
TELEMETRY = (
    '/vehicle/actuators',
    '/vehicle/imu',
    '/vehicle/wheels',
    '/controller/stop_plan',
    '/controller/prediction',
    '/controller/why',
    '/diagnostics',
)
SUBSCRIBERS = {  # the node that receives the damaged messages; of telemetry every node does
    '/scenario/reference': 'controller',
    '/scenario/road_edges': 'controller',
    '/scenario/obstacles': 'controller',
    '/vehicle/odometry': 'controller',
    '/vehicle/run_start': 'scenario',
    '/controller/command': 'plant',
    '/clock': 'scenario',
}
FOR_S = 0.5  # a fault lasts, unless it says how long


class Fault(NamedTuple):
    """One fault and the state that it must lead to."""

    name: str
    expect: str  # of states.STATES
    within_s: float
    mode: str
    road: str  # of the file, '' for fault_road.yaml
    scenario: dict[str, Any]  # the scenario file
    action: str  # what is done
    target: Any  # topics, role or amount
    settings: dict[str, Any]  # of the action

    @property
    def lasts_s(self) -> float:
        """How long it lasts."""
        return float(self.settings.get('for_s', FOR_S))


def load() -> list[Fault]:
    """Return every fault in the order of the file."""
    document = yaml.safe_load((HERE / 'faults.yaml').read_text())
    road = yaml.safe_load((HERE / 'fault_road.yaml').read_text())
    return [_fault(road, document['roads'], **entry) for entry in document['faults']]


def _fault(
    straight, roads, *, name, expect, within_s, fault, mode='realtime', road='', scenario=()
):
    (action, target), *settings = fault.items()
    if action == 'relay':
        target = TELEMETRY if target == ['telemetry'] else tuple(target)
    document = straight | roads.get(road, {}) | dict(scenario) | {'name': f'fault_{name}'}
    return Fault(
        name, expect, float(within_s), mode, road, document, action, target, dict(settings)
    )
