"""What the rig does when a wire, a device or its process fails."""
