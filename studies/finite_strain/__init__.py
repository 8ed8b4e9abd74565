"""Is small strain enough? Hyperelastic fingers on one mesh with linear ones (`docs/small_strain.md`).

`laws` and `bricks` are the tissue and its elements, `body` a finger or section of them, `rigid` what presses,
`equilibrium` and `press` how it comes to rest, `inside` what a receptor feels; `confirmed` has CalculiX say the same.
"""
