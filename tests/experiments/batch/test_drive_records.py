"""Records of finished drives outlive their program, and what tore them."""

import pytest

from bags.errors import BagError
from experiments.batch.drive_records import DriveRecords


def test_records_are_kept(tmp_path):
    with DriveRecords(tmp_path) as records:
        records.add('a', '{"min_v2o_m": 0.1}')
    with DriveRecords(tmp_path) as records:
        assert 'a' in records
        assert records['a'] == '{"min_v2o_m": 0.1}'
        assert 'b' not in records


@pytest.mark.parametrize('kept', range(1, 20, 6))
def test_a_torn_last_record_is_left_out_and_costs_no_other(tmp_path, kept):
    with DriveRecords(tmp_path) as records:
        records.add('a', '{"ticks": 1}')
        whole = records.path.stat().st_size
        records.add('b', '{"ticks": 2}')
        path = records.path
    path.write_bytes(path.read_bytes()[: whole + kept])
    with DriveRecords(tmp_path) as records:
        assert records.damaged == 1
        assert 'a' in records
        assert 'b' not in records
        records.add('c', '{"ticks": 3}')
    with DriveRecords(tmp_path) as records:
        assert records.damaged == 0
        assert 'a' in records
        assert 'c' in records


@pytest.mark.parametrize('line', [b'{"key": "x"}\n', b'\0\0\0\n', b'[]\n', b'{"key": "x", "resu\n'])
def test_a_damaged_record_is_left_out(tmp_path, line):
    with DriveRecords(tmp_path) as records:
        records.add('a', '{}')
        path = records.path
    path.write_bytes(line + path.read_bytes())
    with DriveRecords(tmp_path) as records:
        assert records.damaged == 1
        assert 'a' in records
        assert 'x' not in records


def test_two_batches_do_not_write_one_folder(tmp_path):
    with DriveRecords(tmp_path), pytest.raises(BagError, match='another batch'):
        DriveRecords(tmp_path).__enter__()
