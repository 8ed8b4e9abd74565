"""A finger or its section of hyperelastic tissue, pressed by a rigid indentor; and friction at small strain.

`laws` (`ogden` by principal stretches) and `bricks` are the tissue and its elements, `scene` a specimen as a `body`
of them, `rigid` what presses, `equilibrium` and `press` how it comes to rest, `relaxing` a press in time,
`inside` what a receptor feels; `rubbing` is friction at small strain.
"""
