"""Which finger lies there: a prior, quick forces over its parameters, what presses say of them, which comes next.

`prior`: the parameters and their ranges; `shape_table` and `foreseen`: force of any finger of the prior; `learned`:
the posterior; `next_press`: what tells most; `misfit`: what is no finger of the prior.
"""
