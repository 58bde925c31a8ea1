import pytest

from scenario_publisher import scenario
from scenario_publisher.scenario import ScenarioError


def test_missing_file_and_folder_are_refused(tmp_path):
    for path in (tmp_path / 'none.yaml', tmp_path / '.yaml'):
        with pytest.raises(ScenarioError, match=str(path)):
            scenario.load(path)


def test_binary_file_is_refused(tmp_path):
    path = tmp_path / 'a.yaml'
    path.write_bytes(b'\x89PNG\xff\xfe')
    with pytest.raises(ScenarioError, match=r'is no UTF-8 text'):
        scenario.load(path)


def test_huge_file_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / 'a.yaml'
    with path.open('wb') as file:
        file.truncate(scenario.MAX_BYTES + 1)
    with pytest.raises(ScenarioError, match=r'allowed at most 8000000 bytes'):
        scenario.load(path)
