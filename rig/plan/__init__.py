"""What the finger model says of a script: the check before anything moves, and the answers afterwards."""
