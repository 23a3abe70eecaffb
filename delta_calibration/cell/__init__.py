"""What the calibration node does, without ROS: capture, fit, command path, health."""
