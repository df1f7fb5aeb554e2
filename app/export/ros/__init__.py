"""Recordings as messages of ROS 2: MCAP files for Foxglove, and bags."""
