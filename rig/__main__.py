"""`python -m rig`: the program, where its folder is not among those that are looked through for commands."""

from rig.cli import main

main()
