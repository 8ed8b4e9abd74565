"""What stands under a virtual indentor, on the clock of its devices."""
