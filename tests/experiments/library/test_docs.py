"""docs/library.md says what families, draws and entries are."""

import re
from pathlib import Path

from bags.evaluation.metrics import survival
from experiments import simulation
from experiments.commands import library
from experiments.families import draw, feasibility
from experiments.library import catalogue

ROOT = Path(__file__).parents[3]
TEXT = ' '.join((ROOT / 'docs/library.md').read_text().split())


def test_every_family_has_a_row_and_no_other():
    rows = re.findall(r'^\| ((?:`\w+`(?:, )?)+) \|', (ROOT / 'docs/library.md').read_text(), re.M)
    assert set(re.findall(r'`(\w+)`', ' '.join(rows))) == set(draw.FAMILIES)


def test_documented_numbers_are_those_of_the_code():
    low, high = draw.HARD_FRICTION
    for text in (
        f'a friction of {low:g} to {high:g} that it believes to be {draw.BELIEVED_FRICTION:g}',
        f'up to {draw.HARD_DELAY_MS[1]} ms late',
        f'up to {draw.HARD_BIASES["left_bias_m"]:g} m to the side',
        f'{draw.HARD_BIASES["ahead_bias_m"]:g} m ahead',
        f'{100 * draw.HARD_BIASES["speed_error"]:g} % of error of the speed',
        f'missed for {100 * draw.HARD_NOISE["obstacle_dropout"]:g} %',
        f'with {feasibility.GRIP_SHARE:g} of the friction, {feasibility.DELAY_S:g} s late',
        f'and {feasibility.CLEARANCE:g} m',
        f'further than {survival.SHOULDER_M:g} m off the road',
        f'above {survival.SLIDING_FROM_MPS:g} m/s',
        f'from {library.SEED} on**, which is the default',
    ):
        assert text in TEXT


def test_every_entry_has_a_drawing_and_no_other():
    drawings = {path.stem for path in (ROOT / 'docs/scenarios').iterdir()}
    assert drawings == set(catalogue.entries_of_library())


def test_sizes_of_the_car_in_the_closed_forms_are_those_of_the_plant():
    car = simulation.prepare('straight', 'mpcc').plant.car
    nose = car.body.cog_to_front_m + car.outline.front_overhang_m
    # rounded up: a draw that is possible for a larger car is for this one
    assert 0.0 <= feasibility.CAR_WIDTH - car.outline.width_m < 0.02
    assert 0.0 <= feasibility.CAR_NOSE - nose < 0.2
