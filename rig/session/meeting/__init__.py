"""`rig meet`: the rig learns which finger lies under it, press by press, and writes what it learned."""

SCRIPT = "meeting_script.py"
"""What the provenance of a meeting names as its script."""

MEETING_PAGE = "meeting.html"
"""In the folder of the run, once it has ended with something learned."""
