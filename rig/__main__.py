"""`python -m rig`: the program, for a system whose PATH does not contain its folder."""

from rig.cli import main

main()
