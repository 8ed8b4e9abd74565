"""What an indentation is made of: the way down, the touch, the press, the hold."""
