"""Speed against error of the models, what `rig bench` measures.

`scenes` are solved by `candidates`; `measure` says what that costs, `reference` how wrong it is, `rows` prints both;
`choice` picks the cheapest model within a tolerance. `calculix` solves one scene with another program.
"""
