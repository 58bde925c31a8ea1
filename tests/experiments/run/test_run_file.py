"""Run files say what is driven; options win over them. Mistakes: ../test_mistakes.py."""

from experiments.run import run_file
from msgs_yaml import share

GOOD = """scenario: ./road.yaml
controllers: [mpcc, ./mine.yaml]
settings:
  plant.friction: 0.9
  controller.safety.obstacle_m: 5e-1
labels: [a, b]
"""


def test_names_are_kept_files_are_found_from_the_folder_of_the_file_and_options_win(tmp_path):
    path = tmp_path / 'run.yaml'
    path.write_text(GOOD)
    run = run_file.load(str(path))
    assert (run.scenario, run.labels) == (str(tmp_path / 'road.yaml'), ('a', 'b'))
    assert run.controllers == ('mpcc', str(tmp_path / 'mine.yaml'))
    assert run.settings == {'plant': {'friction': 0.9}, 'controller': {'safety.obstacle_m': 0.5}}
    assert run_file.with_options(run, [], [], '') == run
    other = run_file.with_options(run, ['frenet'], ['plant.friction=0.7', 'plant.seed=1'], '')
    assert (other.controllers, other.labels) == (['frenet'], ())
    assert other.settings['plant'] == {'friction': 0.7, 'seed': 1}
    assert other.settings['controller'] == {'safety.obstacle_m': 0.5}
    assert run_file.with_options(run, [], [], 'c').labels == ('c',)
    for_all = run._replace(labels=('wet',))
    assert run_file.with_options(for_all, ['frenet'], [], '').labels == ('wet',)


def test_a_scenario_file_is_no_run_file_and_a_scenario_alone_is_driven_by_mpcc():
    road = str(share.path('scenario_publisher', 'scenarios', 'straight.yaml'))
    assert run_file.load(road) == run_file.RunFile(road)
    run = run_file.with_options(run_file.load('straight'), [], [], '')
    assert (run.scenario, run.controllers, run.settings) == ('straight', ('mpcc',), {})
