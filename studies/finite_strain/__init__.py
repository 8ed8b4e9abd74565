"""Is small strain enough? Hyperelastic fingers on one mesh with linear ones (`docs/small_strain.md`).

`solver` presses, `states` and `worlds` are the presses that are wanted, `confirmed` has CalculiX say the same,
`ratios` and `judged` read them, `tables` keeps and prints what they come to.
"""
