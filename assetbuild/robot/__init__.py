"""The robot, free of files and formats: what every target and check reads."""
