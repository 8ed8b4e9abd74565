"""What an indentation or a point load answers: arrays and numbers, which pickle small and know no model.

`indentation` and `point_load` are the answers, `indentations` many of them; `outline` is what they keep of the model
that gave them. `tables` hands their columns on, `pictures` draws them for a notebook.
"""
