"""`python -m studies.meeting`: the proof (`proof.py`)."""

from studies.meeting.proof import main

if __name__ == "__main__":
    main()
