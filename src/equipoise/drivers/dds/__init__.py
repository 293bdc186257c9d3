"""DDS, which Unitree's newer robots and ROS 2 speak."""
