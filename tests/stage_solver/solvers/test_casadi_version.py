import pytest

from stage_solver import casadi_version
from stage_solver.casadi_version import CasadiTooOldError


@pytest.mark.parametrize('version', ['3.7.0', '3.8.2', '3.10.0', '4.0.0+custom'])
def test_new_enough_versions_pass(version):
    casadi_version.check(version)


@pytest.mark.parametrize('version', ['3.6.7', '3.6.0', '2.9.1'])
def test_old_versions_are_refused_with_the_way_out(version):
    with pytest.raises(CasadiTooOldError, match=rf"CasADi {version}.*pip install .*'casadi>=3.7'"):
        casadi_version.check(version)
