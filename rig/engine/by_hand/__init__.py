"""Motions that a person asks for at the bench, one at a time, and what is felt on the way."""

from rig.engine.by_hand.by_hand import ByHand, Moved, Show
from rig.engine.by_hand.dead_man import Direction, dead_man_jog
from rig.engine.by_hand.guard import Guard

__all__ = ["ByHand", "Direction", "Guard", "Moved", "Show", "dead_man_jog"]
