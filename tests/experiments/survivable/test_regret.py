"""What counts as lost though possible, and the paired comparison, on tables made by hand."""

import io
import json
import math
from argparse import Namespace

import pandas
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from bags.errors import BagError
from experiments import cli, row_runner
from experiments.drive_row import Row
from experiments.survivable import report
from experiments.survivable.survival_search import POSSIBLE

FAULTS = ('plant.faults.front_force_share', 0.5), ('plant.sensors', 'sensors_consumer.yaml')
AFTER = ('error', 'survived', 'lost_by', 'verdict')


def row(index, controller, survived, family='pop_up', error='', **settings):
    return {
        'scenario': f'{family}:{index}',
        'family': family,
        'difficulty': 'nominal',
        'seed': 7,
        'draw': index,
        'controller': controller,
        **settings,
        'error': error,
        'survived': survived,
        'lost_by': None if survived else 'touched obstacle 1',
        'verdict': '',
    }


def written(folder, *rows):
    """Write a table of `experiments library`; return its folder."""
    folder.mkdir()
    names = dict.fromkeys(name for row in rows for name in row)
    table = pandas.DataFrame(rows, columns=sorted(names, key=lambda name: name in AFTER))
    table.to_parquet(folder / row_runner.TABLE)
    return folder


def shown(*folders, base='mpcc', budget=0):
    console = Console(record=True, width=200, file=io.StringIO())
    options = {'folders': folders, 'base': base, 'budget': budget, 'jobs': 1}
    assert report.run(Namespace(**options, preview=False, table=None), console) == 0
    return console.export_text()


def lines(text):
    """Return the words of each line by its first one."""
    return {words[0]: words for words in map(str.split, text.splitlines()) if words}


def test_a_draw_that_any_controller_survived_is_possible_and_others_count_strictly(tmp_path):
    rows = [row(i, name, (i, name) in {(0, 'a'), (1, 'b')}) for name in 'ab' for i in range(4)]
    text = shown(written(tmp_path / 'library', *rows), base='a')
    assert ' '.join(lines(text)['pop_up']) == 'pop_up 2 0 2 1/2 50% (9–91) 25% 1/2 50% (9–91) 25%'
    losses = [line for line in text.splitlines() if 'touched' in line]
    assert losses == [
        'possible: pop_up:1 a: touched obstacle 1 ()',
        'undecided: pop_up:2 a: touched obstacle 1 ()',
        'undecided: pop_up:3 a: touched obstacle 1 ()',
    ]


def test_a_drive_without_a_result_is_no_loss_of_its_controller(tmp_path):
    rows = [row(0, 'a', None, error='ended'), row(0, 'b', True)]
    text = lines(shown(written(tmp_path / 'library', *rows), base='b'))
    assert text['pop_up'][4:6] == ['–', '–']
    assert text['a'][1:] == ['0'] * 5 + ['–', '–']


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=40))
def test_a_pair_counts_every_draw_once_and_turns_around(outcomes):
    drives = pandas.DataFrame(
        [
            {'what': i, 'name': name, 'survived': survived, 'error': ''}
            for i, pair in enumerate(outcomes)
            for name, survived in zip('ab', pair)
        ]
    )
    split, turned = report.split_pairs(drives, 'a', 'b'), report.split_pairs(drives, 'b', 'a')
    assert sum(split) == len(outcomes)
    both, one, other, neither = split
    assert turned == (both, other, one, neither)
    shares = [sum(column) / len(outcomes) for column in zip(*outcomes)]
    assert (one - other) / sum(split) == pytest.approx(shares[0] - shares[1])


def test_the_p_value_is_that_of_a_fair_coin():
    """10 against 2: the chance that a coin is as uneven, 2 (1 + 12 + 66) / 2^12."""
    expected = 2 * sum(math.comb(12, k) for k in range(3)) / 2**12
    assert report.pair_cells(50, 10, 2, 0)[-1] == f'{expected:.2g}'
    assert report.pair_cells(5, 0, 0, 5)[-1] == '1'


@pytest.mark.parametrize('name', ['controller.limits.drive_n', 'estimator.fix_s'])
def test_drives_of_other_settings_are_neither_mixed_nor_paired_with_themselves(tmp_path, name):
    """Without the settings in the key the later table would replace the rows of the first."""
    faster = {name: 3000.0}
    plain = written(tmp_path / 'a', *(row(i, 'mpcc', i < 4) for i in range(4)))
    other = written(tmp_path / 'b', *(row(i, 'mpcc', i < 1, **faster) for i in range(4)))
    text = shown(plain, other)
    assert f'mpcc {name}=3000.0' in text
    assert '4/4 100%' in text
    assert '1/4 25%' in text
    assert '+75.0%' in text


def test_a_table_of_drives_and_verdicts_says_the_same_without_a_search(tmp_path, capsys):
    ice = {'plant.friction': 0.05}
    rows = [row(2, name, name == 'a', **s) for name in 'ab' for s in ({}, ice)]
    folder, table = written(tmp_path / 'library', *rows), tmp_path / 'paper' / 'drives.parquet'
    command = ['survivable', '--base', 'a', '--budget', '0']
    assert cli.main([*command, str(folder), '--table', str(table)]) == 0
    first = capsys.readouterr().out.replace(str(table), '').strip()
    assert '+100.0%' in first
    assert cli.main([*command, str(table)]) == 0
    assert capsys.readouterr().out.strip() == first


@pytest.mark.usefixtures('tasks_here')
def test_a_draw_of_another_plant_is_another_draw_and_searched_with_that_plant(tmp_path):
    """On ice nobody survives what is possible on a dry road: one answer must not serve both."""
    ice = {'plant.friction': 0.05}
    dry = written(tmp_path / 'a', row(2, 'mpcc', True))
    slippery = written(tmp_path / 'b', row(2, 'mpcc', False, **ice))
    text = shown(dry, slippery)
    assert 'possible: pop_up:2 mpcc' not in text
    assert 'undecided: pop_up:2 mpcc' in text
    on_ice = written(tmp_path / 'c', row(1, 'mpcc', False, **ice))
    # dry the same search finds a way: see above
    assert 'possible: pop_up:1 mpcc' not in shown(on_ice, budget=20)


def test_a_verdict_is_that_of_a_car_with_the_same_faults_and_sensors():
    sound = Row('pop_up:2', '')
    cars = [sound, *(sound._replace(settings=(pair,)) for pair in FAULTS)]
    assert len({report._key(car, 20, False) for car in cars}) == len(cars)


def test_an_unknown_base_is_named(tmp_path):
    folder = written(tmp_path / 'library', row(1, 'mpcc', True))
    with pytest.raises(BagError, match="no drives by 'mpcc_road'; there are mpcc"):
        shown(folder, base='mpcc_road')


@pytest.mark.usefixtures('tasks_here')
def test_a_draw_that_all_lost_is_searched_once_and_its_verdict_kept(tmp_path, capsys, monkeypatch):
    """The table says that it was lost: an MPCC with hindsight survives it."""
    folder = written(tmp_path / 'library', row(1, 'mpcc', False), row(2, 'mpcc', True))
    table = tmp_path / 'drives.parquet'
    command = ['survivable', '--base', 'mpcc', '--jobs', '1', '--table', str(table)]

    def shows_it(budget, place):
        assert cli.main([*command, '--budget', str(budget), str(place)]) == 0
        return 'possible: pop_up:1 mpcc: touched obstacle 1' in capsys.readouterr().out

    assert not shows_it(0, folder)
    # undecided is no answer to a larger budget; what is found is kept in folder and table
    assert shows_it(20, table)
    for _ in range(2):
        assert shows_it(20, folder)
    (line,) = (folder / report.FOLDER / 'drives.jsonl').read_text().splitlines()
    assert json.loads(line)['results']['answer'] == POSSIBLE
    assert shows_it(0, table)
    monkeypatch.setattr(report, 'SEARCH_VERSION', report.SEARCH_VERSION + 1)
    assert not shows_it(0, table)
