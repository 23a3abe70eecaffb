"""ROS 2 nodes around the calibration, the only place with rclpy: topics wired to pure logic."""
