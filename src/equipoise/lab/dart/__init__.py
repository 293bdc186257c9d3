"""The simulated robot in DART, the physics engine of Gazebo."""
