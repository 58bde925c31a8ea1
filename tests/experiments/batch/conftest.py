"""A scenario of one second, and studies of it."""

import pytest
import yaml

from msgs_yaml import share


@pytest.fixture
def short_road(tmp_path):
    """Return the file of 15 m of straight road at 15 m/s."""
    road = yaml.safe_load(
        share.path('scenario_publisher', 'scenarios', 'straight.yaml').read_text()
    )
    road |= {'name': 'short_road', 'stop': {'progress_m': 15.0, 'time_s': 5.0}}
    path = tmp_path / 'short_road.yaml'
    path.write_text(yaml.safe_dump(road))
    return path


@pytest.fixture
def write_study(tmp_path, short_road):
    """Return write(...) -> path of a study of the short road; what is given replaces its fields."""

    def write(**given):
        fields = {
            'schema': 1,
            'scenarios': [f'./{short_road.name}'],
            'controllers': ['mpcc_no_ca'],
            'set': {'plant.friction': [0.8, 1.0]},
            'runs': 2,
            'seed': 1,
        }
        path = tmp_path / 'study.yaml'
        path.write_text(yaml.safe_dump(fields | given, sort_keys=False))
        return path

    return write
