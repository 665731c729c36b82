"""What a stage said, as numpy (description), and as device arrays (device_scene)."""
