"""Bags of ROS 1 and ROS 2 and MCAP files, without ROS: events, pictures, calibration and poses of their cameras."""

from core.recordings.sources.ros.bag_sources import open_bag

__all__ = ["open_bag"]
