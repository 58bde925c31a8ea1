# Ubuntu 24.04 with ROS 2 Jazzy from its packages, the packages of this repository built by colcon.
#
#   docker build -t mpcc .                        # builds
#   docker build -t mpcc-test --target test .     # builds and tests
#   docker run --rm -v "$PWD/runs:/runs" mpcc     # drives, compares, writes /runs
#
# --mode realtime takes --cap-add SYS_NICE.
ARG BASE=ros:jazzy-ros-base-noble
FROM ${BASE} AS build
SHELL ["/bin/bash", "-euo", "pipefail", "-c"]

# compiler and headers: controller and plant are generated as C and compiled
RUN apt-get update && apt-get install -y --no-install-recommends \
      gcc libc6-dev python3-dev python3-venv python3-pip python3-rosdep \
      python3-colcon-common-extensions ros-jazzy-rmw-fastrtps-cpp ros-jazzy-ros2launch \
    && rm -rf /var/lib/apt/lists/*

# a virtual environment over the packages of the system: pip may not change those
RUN python3 -m venv --system-site-packages /opt/venv
ENV VIRTUAL_ENV=/opt/venv PATH=/opt/venv/bin:$PATH
WORKDIR /ws

# what rosdep knows, from the manifests alone, so that a change of code does not install again; what
# only pip has is skipped, and comes next
COPY msgs_yaml/package.xml src/msgs_yaml/
COPY node_runtime/package.xml src/node_runtime/
COPY stage_solver/package.xml src/stage_solver/
COPY scenario_publisher/package.xml src/scenario_publisher/
COPY state_estimator/package.xml src/state_estimator/
COPY mpcc_controller/package.xml src/mpcc_controller/
COPY vehicle_plant/package.xml src/vehicle_plant/
COPY bags/package.xml src/bags/
COPY experiments/package.xml src/experiments/
RUN apt-get update && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src --ignore-src --rosdistro jazzy -y \
      --skip-keys 'casadi-pip python3-bokeh-pip' \
    && rm -rf /var/lib/apt/lists/*
RUN pip install casadi mcap zstandard lz4 scipy cmaes distributed pyarrow rich 'numpy<2' \
      matplotlib bokeh jinja2 pandas scikit-learn

COPY msgs_yaml src/msgs_yaml
COPY node_runtime src/node_runtime
COPY stage_solver src/stage_solver
COPY scenario_publisher src/scenario_publisher
COPY state_estimator src/state_estimator
COPY mpcc_controller src/mpcc_controller
COPY vehicle_plant src/vehicle_plant
COPY bags src/bags
COPY experiments src/experiments
RUN source /opt/ros/jazzy/setup.bash && python -m colcon build --base-paths src

# -- tests: the suite of the repository against what colcon installed
FROM build AS test
RUN pip install 'pytest<9' pytest-timeout pytest-xdist hypothesis rosbags mcap-ros2-support \
      commonroad-vehicle-models ruff
COPY . /repository
RUN source /opt/ros/jazzy/setup.bash && python -m colcon test --base-paths src \
    && python -m colcon test-result --verbose
RUN source install/setup.bash && cd /repository \
    && python -m pytest -m 'smoke and not alone' tests/ros tests/bags/storage

# -- the image that drives
FROM build AS run
ENV MPCC_CACHE_DIR=/var/cache/mpcc
RUN source install/setup.bash && ros2 run experiments experiments compile
VOLUME /runs
ENTRYPOINT ["/bin/bash", "-c", "source /ws/install/setup.bash && exec \"$@\"", "--"]
CMD ["ros2", "run", "experiments", "experiments", "run", "double_lane_change", "--out", "/runs"]
