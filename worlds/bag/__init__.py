"""Robots' own logs as a world: rosbag2 and MCAP, one bag a robot, read without ROS."""
