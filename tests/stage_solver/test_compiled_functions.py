"""Compiled functions: the same results as interpreted, and compiled once."""

import numpy as np

from stage_solver.compiled_functions import BufferedFunction, compile_functions


def test_machine_code_computes_what_the_interpreter_computes(slalom, own_cache):
    dynamics = slalom.problem.dynamics
    for _ in range(2):
        compiled = compile_functions({dynamics.name(): dynamics}, 'slalom_dynamics')
    assert len(list(own_cache.glob('*.so'))) == 1
    (machine_code,) = compiled.values()
    assert machine_code.class_name() != dynamics.class_name()
    arguments = slalom.guess.X[7], np.array([0.3, -0.2]), slalom.P[7]
    expected = dynamics(*arguments).full()
    assert np.allclose(machine_code(*arguments).full(), expected, rtol=1e-14, atol=1e-14)


def test_a_buffered_function_keeps_what_it_is_not_given(slalom):
    dynamics = slalom.problem.dynamics
    names = dynamics.name_in()
    arguments = dict(zip(names, (slalom.guess.X[7], np.array([0.3, -0.2]), slalom.P[7])))
    buffered = BufferedFunction(dynamics)
    (result,) = buffered(**arguments).values()
    assert np.array_equal(result, dynamics(*arguments.values()).full().ravel())
    arguments[names[0]] = slalom.guess.X[9]
    (result,) = buffered(**{names[0]: slalom.guess.X[9]}).values()
    assert np.array_equal(result, dynamics(*arguments.values()).full().ravel())
