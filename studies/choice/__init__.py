"""How wrong each model and level is by what is pressed, how deep and where, and whether `auto` keeps its word."""
