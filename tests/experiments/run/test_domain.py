"""ROS domains are reserved for one run at a time."""

import os
import socket

import pytest

from bags.errors import BagError
from experiments.run import domain


def test_two_runs_never_share_a_domain():
    with domain.reserved({}) as one, domain.reserved({}) as other:
        assert one != other
        assert {one, other} <= set(range(1, domain.LAST + 1))


def test_a_domain_with_a_participant_is_not_used(monkeypatch):
    with domain.reserved({}) as free:
        monkeypatch.setattr(os, 'getpid', lambda: free - 1)  # where the search begins
    with domain.reserved({}) as number:
        assert number == free
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(('', 7400 + 250 * free + 10))
        with domain.reserved({}) as number:
            assert number != free


def test_a_given_domain_is_used():
    with domain.reserved({'ROS_DOMAIN_ID': '157'}) as number:
        assert number == 157


def test_a_given_domain_may_have_other_participants():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as viewer:
        viewer.bind(('', 7400 + 250 * 157 + 10))
        with domain.reserved({'ROS_DOMAIN_ID': '157'}) as number:
            assert number == 157


def test_other_participants_of_a_given_domain_are_told():
    given = {'ROS_DOMAIN_ID': '157'}
    assert domain.describe_others({}) == domain.describe_others(given) == ''
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(('', 7400 + 250 * 157 + 10))
        assert 'other programs are in ROS_DOMAIN_ID=157' in domain.describe_others(given)


def test_a_given_domain_used_by_another_run_is_refused():
    given = {'ROS_DOMAIN_ID': '157'}
    with (
        domain.reserved(given),
        pytest.raises(BagError, match='ROS_DOMAIN_ID=157'),
        domain.reserved(given),
    ):
        pass


@pytest.mark.parametrize('given', ['abc', '-1', '233', '1.5'])
def test_a_domain_must_be_a_number_that_has_ports(given):
    wanted = 'from 0 to 232'
    with pytest.raises(BagError, match=wanted), domain.reserved({'ROS_DOMAIN_ID': given}):
        pass
