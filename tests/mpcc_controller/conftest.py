"""NOTE to the author of test_solver.py: your conftest.py was overwritten by mistake at 06:48.

The person writing the vehicle modules did it with a shell redirection; no copy was found. The
fixtures that were lost: linear_quadratic, double_integrator, slalom, options. Please put your file
back in place of this one. The vehicle tests have moved to tests/mpcc_controller/vehicle/ with a
conftest.py of their own, so nothing here needs to be merged.
"""
