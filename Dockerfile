# ROS 2 Jazzy with the packages built: docker build -t wattwalk . && docker run --rm -it wattwalk
FROM ros:jazzy
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
ENV RMW_IMPLEMENTATION=rmw_cyclonedds_cpp ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
WORKDIR /wattwalk
RUN apt-get update \
    && apt-get install -y --no-install-recommends make python3-venv ros-jazzy-rmw-cyclonedds-cpp \
    && rm -rf /var/lib/apt/lists/*
COPY src src
RUN apt-get update && rosdep update \
    && rosdep install --from-paths src --ignore-src -y \
    && rm -rf /var/lib/apt/lists/*
COPY . .
RUN . /opt/ros/jazzy/setup.bash && make build-ros
RUN printf '. /wattwalk/.ros/setup.sh\n' >> /etc/bash.bashrc
CMD ["bash", "-c", ". .ros/setup.sh && ros2 launch wattwalk_bringup sim.launch.py"]
