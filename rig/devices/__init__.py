"""What stands on the ports: stages, force sensors, and the bench that they make."""
