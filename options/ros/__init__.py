"""What ROS 2 says, read without ROS: messages in CDR, and frames that move in each other."""
