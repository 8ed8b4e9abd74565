"""Where the receptor is: depth and lateral place, and on request an offset of the field, as parameters of a fit."""
