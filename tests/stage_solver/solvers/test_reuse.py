"""What is made once for equal problems."""

import dataclasses

import casadi as ca
import pytest

from stage_solver import reuse


def doubled(problem):
    """Return the same problem at twice the cost."""
    xs, us, ps = problem.stage_cost.mx_in()
    cost = ca.Function('stage_cost', [xs, us, ps], [2 * problem.stage_cost(xs, us, ps)])
    return dataclasses.replace(problem, stage_cost=cost)


def longer(problem):
    """Return the same problem over one more interval."""
    return dataclasses.replace(problem, horizon=problem.horizon + 1)


def rescaled(problem):
    """Return the same problem in another unit."""
    first, *others = problem.scale_x
    return dataclasses.replace(problem, scale_x=(2 * first, *others))


def renamed(problem):
    """Return the same problem under another name."""
    return dataclasses.replace(problem, name='other')


def again(problem):
    """Return an equal problem with functions of its own."""
    facts = {field.name: getattr(problem, field.name) for field in dataclasses.fields(problem)}
    functions = {name: fact for name, fact in facts.items() if isinstance(fact, ca.Function)}
    copies = {n: ca.Function.deserialize(f.serialize()) for n, f in functions.items()}
    return dataclasses.replace(problem, **copies)


@pytest.fixture
def make():
    """Return a function that makes something new each time it is really called."""
    return reuse.once(lambda problem, *others: object())


def test_equal_problems_share_what_was_made(make, slalom):
    assert make(again(slalom.problem)) is make(slalom.problem)
    assert make(slalom.problem, 'fatrop') is not make(slalom.problem, 'ipopt')


@pytest.mark.parametrize('change', [doubled, longer, rescaled, renamed])
def test_another_problem_gets_its_own(make, slalom, change):
    assert make(change(slalom.problem)) is not make(slalom.problem)


def test_the_last_few_are_kept(make, slalom):
    first, second, *_ = (make(slalom.problem, number) for number in range(reuse.MOST))
    assert make(slalom.problem, 0) is first  # and is the latest again
    make(slalom.problem, 'one more')
    assert make(slalom.problem, 0) is first
    assert make(slalom.problem, 1) is not second
