"""The published shares of the study over many settings follow from the rows that are kept."""

from pathlib import Path

import pandas as pd

from experiments import cli, settings_study

PUBLISHED = Path(__file__).parents[2] / 'paper/settings'
# baseline, claim, holds, settings, intervals, undetermined, silent, median with interval, verdict;
# what the pages say of all rows: tests/docs/test_published_numbers.py
SHARES = """\
frenet_matched min_speed 83 222 0.313 0.439 0.204 0.318 0.479 0.609 64 29 0.182 0.078 0.378 open
frenet_matched conjunction 0 69 0.000 0.053 0.000 0.053 0.091 0.263 11 11 NaN NaN NaN open
frenet_lineage brake_onset 7 14 0.268 0.732 0.117 0.546 0.326 0.786 4 3 9.101 2.158 21.763 open
"""
# baseline, settings, both, earlier, later, mpcc_alone, baseline_alone
BRAKING = """\
frenet_matched 222 69 12 9 7 28
frenet_lineage 136 14 6 2 41 12
"""


def test_the_command_shows_the_published_shares_and_who_brakes(capsys):
    assert cli.main(['study', 'recompute', str(PUBLISHED)]) == 0
    shown = [' '.join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert {*SHARES.splitlines()} < {*shown[1:11]}
    assert shown[12:] == BRAKING.splitlines()


def test_the_kept_rows_are_those_of_the_accepted_settings():
    study = settings_study.read(PUBLISHED)
    accepted = pd.read_csv(PUBLISHED / 'confirmatory/accepted_settings.csv', index_col='setting')
    assert set(study.drives.index.get_level_values('setting')) == set(accepted.index)
    for baseline, at_P3 in accepted.items():
        reached = settings_study.reaching(study, baseline, 'P3')
        assert set(reached) == set(accepted.index[at_P3])


def test_rows_without_what_was_fixed_before_are_refused(tmp_path, capsys):
    file = tmp_path / settings_study.FILE
    file.parent.mkdir()
    pd.DataFrame({'setting': [1]}).to_parquet(file)
    for content in (file.read_bytes(), b'no table'):
        file.write_bytes(content)
        assert cli.main(['study', 'recompute', str(tmp_path)]) == 1
        assert f'{file}: holds no rows of the study' in capsys.readouterr().err
