"""A recording by hand with every topic that is evaluated, and the same time as all other topics."""

import numpy as np
import pytest
from one_second import every_message
from straight_drive import obstacle, straight_scene

import bags
from bags.run import Run
from bags.storage import columns
from msgs_yaml import flat_fields


@pytest.fixture(scope='session')
def recorded(make_drive, write_bag_into, tmp_path_factory):
    """Return recordings of 2.5 s past an obstacle: of mpcc, and of own, 1 m left of the path."""

    def make(name, y):
        scene = straight_scene([obstacle(7, 40.0, -3.5)])
        one = make_drive(scene=scene, controller=name, y=y, vy=lambda x: np.sin(x / 9), metres=50.0)
        return bags.load(write_bag_into(folder, one, name))

    folder = tmp_path_factory.mktemp('recorded')
    return make('mpcc', 0.2), make('own', 1.0)


@pytest.fixture
def run(recorded):
    """Return the run of mpcc."""
    return recorded[0]


@pytest.fixture(scope='session')
def second():
    """Return a run of one second with messages of every topic, and nothing about its nodes."""
    tables = {}
    for topic, values in every_message().items():
        stamps = np.array([getattr(value, 'stamp_ns', value) for value in values])
        t_s = (stamps - stamps[0]) * 1e-9
        if topic in flat_fields.TYPES:
            _, *fields = zip(*values)
            named = dict(zip(columns.names(topic)[2:], map(np.array, fields)))
            tables[topic] = columns.Columns(stamps, t_s, **named)
        else:
            tables[topic] = columns.Columns(stamps, t_s, values=tuple(values))
    return Run(tables, 'one second', {})
