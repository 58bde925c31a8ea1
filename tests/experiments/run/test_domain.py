"""ROS domains are reserved for one run at a time."""

import os
import socket

import pytest

from bags.errors import BagError
from experiments.run import domain

GIVEN = {'ROS_DOMAIN_ID': '157'}


def participant(number):
    """Return a socket at the first discovery port of a domain."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.bind(('', 7400 + 250 * number + 10))
    return listener


def test_runs_share_no_domain_and_use_none_with_a_participant(monkeypatch):
    with domain.reserved({}) as one, domain.reserved({}) as other:
        assert one != other
        assert {one, other} <= set(range(1, domain.LAST + 1))
    monkeypatch.setattr(os, 'getpid', lambda: one - 1)  # where the search begins
    with domain.reserved({}) as number:
        assert number == one
    with participant(one), domain.reserved({}) as number:
        assert number != one


def test_a_given_domain_is_used_whoever_is_in_it_but_by_one_run():
    with domain.reserved(GIVEN) as number:
        assert number == 157
        with pytest.raises(BagError, match='ROS_DOMAIN_ID=157'):
            domain.reserved(GIVEN).__enter__()
    assert domain.describe_others({}) == domain.describe_others(GIVEN) == ''
    with participant(157), domain.reserved(GIVEN) as number:
        assert number == 157
        assert 'other programs are in ROS_DOMAIN_ID=157' in domain.describe_others(GIVEN)


@pytest.mark.parametrize('given', ['abc', '-1', '233', '1.5'])
def test_a_domain_must_be_a_number_that_has_ports(given):
    with pytest.raises(BagError, match='from 0 to 232'):
        domain.reserved({'ROS_DOMAIN_ID': given}).__enter__()
