"""DDS, the transport of Unitree's newer robots and ROS 2."""
