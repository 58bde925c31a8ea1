"""The threshold of `make nightly`: what 99.5 % explains passes, one loss more does not."""

import nightly_survival
import pyarrow
import pytest
from pyarrow import parquet

DRIVES = 2000


@pytest.fixture
def table(tmp_path):
    """Return write(losses, drives): a folder with the table of drives of which some are lost."""

    def write(losses, drives=DRIVES, without_result=0):
        survived = [None] * without_result + [False] * losses
        survived += [True] * (drives - len(survived))
        path = tmp_path / nightly_survival.TABLE
        parquet.write_table(pyarrow.table({'survived': survived}), path)
        return tmp_path

    return write


def test_what_the_published_share_explains_passes_and_more_does_not(table):
    most = nightly_survival.most_losses(DRIVES)
    assert 10 < most < 20
    assert nightly_survival.judge(table(most), DRIVES) == 0
    assert nightly_survival.judge(table(most + 1), DRIVES) == 1


def test_drives_without_a_result_are_losses_and_missing_ones_fail(table):
    most = nightly_survival.most_losses(DRIVES)
    assert nightly_survival.judge(table(most, without_result=1), DRIVES) == 1
    assert nightly_survival.judge(table(0, DRIVES - 1), DRIVES) == 1
