"""A live ROS 2 robot as a world: its scans and poses over rmw_zenoh, without ROS."""
