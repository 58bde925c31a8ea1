"""Tables are read as drives: what tells them apart, and what came out."""

import pytest

from bags.errors import BagError
from experiments.results import drive_table


def test_drives_without_a_result_are_left_out(table, rows):
    assert len(table.rows) == len(rows) - 1
    assert table.failed == 1
    assert table.inputs == ('scenario', 'controller', 'family', 'draw', 'speed', 'friction', 'run')
    assert table.units(table.rows).nunique() == table.rows['draw'].nunique()


def test_a_file_is_a_table_as_well(folder):
    assert len(drive_table.load(folder / 'results.parquet').rows) == 799


@pytest.mark.parametrize(
    ('name', 'what'),
    [('surviving', "no such column; did you mean 'survived'"), ('lost_by', 'holds words')],
)
def test_a_metric_that_cannot_be_used_is_named(table, name, what):
    with pytest.raises(BagError, match=f'--metric {name}: .*{what}'):
        table.metric(name)


def test_a_folder_without_a_table_is_an_error(tmp_path, rows):
    with pytest.raises(BagError, match='there is no such table'):
        drive_table.load(tmp_path)
    (tmp_path / 'results.parquet').write_text('no table')
    with pytest.raises(BagError, match='no table'):
        drive_table.load(tmp_path)
    rows.drop(columns='error').to_parquet(tmp_path / 'results.parquet')
    with pytest.raises(BagError, match="no column 'error'"):
        drive_table.load(tmp_path)
    rows.assign(error='lost').to_parquet(tmp_path / 'results.parquet')
    with pytest.raises(BagError, match='no drive has a result'):
        drive_table.load(tmp_path)


def test_lists_are_groups_by_their_text(tmp_path, rows):
    rows = rows.copy()
    rows.insert(0, 'split', [[0.5, 0.5] if run == 1 else [0.4, 0.6] for run in rows['run']])
    rows.to_parquet(tmp_path / 'results.parquet')
    table = drive_table.load(tmp_path)
    assert set(table.rows['split']) == {'[0.5, 0.5]', '[0.4, 0.6]'}
