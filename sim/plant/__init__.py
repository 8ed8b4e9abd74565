"""What stands under a virtual indentor, on the clock of its devices.

`plant`: from the steps of a stage to the force of the finger; `relaxing_plant`: a finger whose tissue relaxes, on a
grid of instants (`sampled`).
"""
