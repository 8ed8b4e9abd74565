"""Small parts that the program lacks: test_adding_a_part.py adds each, where docs/code_overview.md says it goes."""
