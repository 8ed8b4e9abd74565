"""What designed presses are worth."""
