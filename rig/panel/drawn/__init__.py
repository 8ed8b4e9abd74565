"""What is drawn for a page, by a process of its own: sections, indentors, and what presses are expected to do."""
