"""What a fingertip is made from: its configuration, measured skin, and the units of it all."""
