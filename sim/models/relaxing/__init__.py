"""A finger in time: tissue that relaxes, creeps and recovers, in the contact itself.

`prony`: the law and what is remembered of a load; `in_time`: an indentor along a path.
"""
