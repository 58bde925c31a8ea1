"""The program in the README of the solver runs, and the help lists every public name."""

import re
from pathlib import Path

import pytest

import stage_solver

README = (Path(__file__).parents[2] / 'stage_solver/README.md').read_text()


@pytest.mark.needs('compiler')
def test_the_program_of_the_readme_pushes_with_full_force_at_first():
    (program,) = re.findall(r'```python\n(.*?)```', README, re.S)
    names = {}
    exec(program, names)
    assert names['force'] == pytest.approx([1.0], abs=1e-5)
    again = names['solver'].solve(
        names['solution'].plan.X[1], names['P'], names['bounds'], names['guess']
    )
    assert again.status == 'solved'
    assert again.iterations < names['solution'].iterations


def test_every_public_name_exists_and_is_in_the_help():
    for name in stage_solver.__all__:
        assert getattr(stage_solver, name) is not None
    documented = set(re.findall(r'\w+', stage_solver.__doc__))
    assert documented >= set(stage_solver.__all__)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'solve'"):
        stage_solver.solve  # noqa: B018
