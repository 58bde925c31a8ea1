"""Compiled functions of the NLP: same results as interpreted, compiled once, optional."""

import dataclasses

import numpy as np
import pytest

from stage_solver import compiled_functions, nlp_functions


@pytest.fixture
def functions(slalom):
    return nlp_functions.build(slalom.problem, 'fatrop')


@pytest.fixture
def arguments(slalom):
    rng = np.random.default_rng(5)
    v = np.concatenate(
        [np.hstack([slalom.guess.X[:-1], slalom.guess.U]).ravel(), slalom.guess.X[-1]]
    )
    v = v + 0.1 * rng.standard_normal(v.shape)
    return v, slalom.P.ravel(), 0.8, rng.standard_normal(30 * 6 + 1)


def test_every_function_computes_what_the_interpreter_computes(functions, arguments):
    compiled = compiled_functions.compile_functions(functions, 'slalom')
    assert compiled.keys() == functions.keys()
    for name, function in functions.items():
        assert compiled[name].class_name() != function.class_name()
        given = arguments[: function.n_in()]
        for mine, reference in zip(compiled[name].call(given), function.call(given)):
            assert mine.sparsity() == reference.sparsity()
            assert np.allclose(mine.full(), reference.full(), rtol=1e-14, atol=1e-14)


def test_same_problem_is_compiled_once_and_another_build(slalom, double_integrator, own_cache):
    def libraries():
        return {f.name: f.stat().st_mtime_ns for f in own_cache.glob('*.so')}

    build = nlp_functions.build.__wrapped__  # without its cache, as in another process
    compiled_functions.compile_functions(build(slalom.problem, 'fatrop'), 'a')
    first = libraries()
    compiled_functions.compile_functions(build(slalom.problem, 'fatrop'), 'a')
    assert libraries() == first
    assert len(first) == 1
    compiled_functions.compile_functions(
        nlp_functions.build(double_integrator.problem, 'fatrop'), 'a'
    )
    assert len(libraries()) == 2


def test_code_does_not_grow_with_the_horizon(slalom):
    def length(horizon):
        problem = dataclasses.replace(slalom.problem, horizon=horizon)
        functions = nlp_functions.build(problem, 'fatrop').values()
        return len(compiled_functions.c_source(tuple(functions), 'a'))

    # patterns do grow; the expanded graph would double
    assert length(50) < 1.35 * length(25)
