"""A recording by hand with every topic that is evaluated, and the same time as all other topics."""

import numpy as np
import pytest
from example_messages import encoded
from one_second import every_message, in_memory, recording
from straight_drive import obstacle, straight_scene

import bags
from bags.run import Run
from bags.storage import read


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
    sent = every_message().items()
    made = (recording(topic, [encoded(topic, v) for v in values]) for topic, values in sent)
    return Run(read.columns(in_memory(*made)), 'one second', {})
