"""Whatever happens to a scenario, it is one that can be driven or a named error."""

import copy

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scenario_publisher.scenario import ScenarioError


def nodes(tree):
    """Return (container, key) of everything in a tree."""
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, inside in list(pairs):
        yield tree, key
        if isinstance(inside, dict | list):
            yield from nodes(inside)


odd_values = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.lists(st.floats(-50, 50), max_size=4),
    st.lists(st.lists(st.floats(-50, 50), min_size=2, max_size=2), max_size=5),
    st.dictionaries(st.sampled_from(['x_m', 'offset_m', 'points_m', 'arc']), st.floats(0, 9)),
    st.sampled_from([-1.0, 0.0, 0.5, 1.0, 3.0, 9.0, 39.0, 1e3, 1e4]),
)


def examples(number):
    """Return the settings of a test of so many examples, whose fixtures hold no state."""
    return settings(
        max_examples=number,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )


@examples(300)
@given(data=st.data())
def test_any_corruption_is_a_scenario_or_a_named_error(make, tree, data):
    corrupted = copy.deepcopy(tree)
    for _ in range(data.draw(st.integers(1, 3))):
        container, key = data.draw(st.sampled_from(list(nodes(corrupted))))
        container[key] = data.draw(odd_values)
    try:
        scn = make(corrupted)
    except ScenarioError as caught:
        message = str(caught)
    else:
        assert np.all(np.isfinite(np.concatenate([*scn.reference[1:]])))
        assert np.all(np.diff(scn.reference.t) > 0.0)
        message = 'bend.yaml'
    assert message.startswith('bend.yaml')


@examples(200)
@given(data=st.data())
def test_any_damage_to_the_text_is_a_scenario_or_a_named_error(make, text, data):
    place = data.draw(st.integers(0, len(text) - 1))
    damage = data.draw(
        st.sampled_from(['', ' ', '\n', ':', '-', '[', '{', '*', '&', '!', '9', 'e'])
    )
    length = data.draw(st.integers(0, 4))
    try:
        make(text[:place] + damage + text[place + length :])
    except ScenarioError as caught:
        message = str(caught)
    else:
        message = 'bend.yaml'
    assert message.startswith('bend.yaml')
