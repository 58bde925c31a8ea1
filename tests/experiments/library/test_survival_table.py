"""Shares, their intervals, and the list of losses."""

from experiments.library import survival_table


def row(family='pop_up', controller='mpcc', survived=True, error='', **more):
    lost_by = None if survived else 'slid'
    base = {'scenario': f'{family}:0', 'family': family, 'controller': controller, 'error': error}
    return {**base, 'survived': survived, 'lost_by': lost_by, 'verdict': 'spun at 60 m', **more}


def test_drives_are_counted_by_family_and_controller_and_failed_ones_left_out():
    rows = [row(), row(survived=False), row(error='crashed'), row(family='slalom')]
    rows += [row(controller='frenet')]
    assert survival_table.count(rows, 'pop_up', 'mpcc') == (1, 2)
    assert survival_table.count(rows, survival_table.ALL, 'mpcc') == (2, 3)
    # whoever cannot be judged has not survived
    assert survival_table.count([row(survived=None)], 'pop_up', 'mpcc') == (0, 1)


def test_every_loss_has_its_cause_and_every_failure_its_reason():
    rows = [row(), row(survived=False), row(survived=None, error='too slow')]
    assert list(survival_table.describe_losses(rows)) == [
        'pop_up:0 mpcc: slid (spun at 60 m)',
        'pop_up:0 mpcc: no result: too slow',
    ]


def test_families_below_a_share_are_named():
    rows = [row(), row(survived=False), row(family='slalom')]
    assert survival_table.families_below(rows, 0.5) == []
    assert survival_table.families_below(rows, 0.51) == ['mpcc in pop_up: 1/2']
