"""The published shares of the study over many settings follow from the rows that are kept."""

from pathlib import Path

import pandas as pd

from experiments import cli, settings_study

PUBLISHED = Path(__file__).parents[2] / 'paper/settings'
# baseline, claim, holds, settings, intervals, undetermined, silent, median with interval, verdict
SHARES = """\
frenet_matched unsafe_area 1 222 0.001 0.025 0.000 0.017 0.096 0.186 30 29 -0.063 -0.079 -0.055 open
frenet_matched sideslip 1 222 0.001 0.025 0.001 0.025 0.096 0.186 29 29 -0.604 -0.900 -0.400 open
frenet_matched brake_onset 11 69 0.091 0.263 0.040 0.177 0.272 0.495 20 15 0.007 -0.426 0.811 open
frenet_matched min_speed 83 222 0.313 0.439 0.204 0.318 0.479 0.609 64 29 0.182 0.078 0.378 open
frenet_matched conjunction 0 69 0.000 0.053 0.000 0.053 0.091 0.263 11 11 NaN NaN NaN open
frenet_lineage unsafe_area 3 136 0.008 0.063 0.004 0.052 0.091 0.208 17 16 0.064 0.038 0.091 open
frenet_lineage sideslip 7 136 0.025 0.102 0.020 0.093 0.115 0.241 17 16 0.413 -0.368 0.855 open
frenet_lineage brake_onset 7 14 0.268 0.732 0.117 0.546 0.326 0.786 4 3 9.101 2.158 21.763 open
frenet_lineage min_speed 62 136 0.375 0.540 0.278 0.436 0.475 0.640 28 16 0.094 -0.141 0.649 open
frenet_lineage conjunction 0 14 0.000 0.215 0.000 0.215 0.040 0.399 2 2 NaN NaN NaN open
"""
# baseline, settings, both, earlier, later, mpcc_alone, baseline_alone
BRAKING = """\
frenet_matched 222 69 12 9 7 28
frenet_lineage 136 14 6 2 41 12
"""


def test_the_command_shows_the_published_shares_and_who_brakes(capsys):
    assert cli.main(['study', 'recompute', str(PUBLISHED)]) == 0
    shown = [' '.join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert shown[1:11] == SHARES.splitlines()
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
