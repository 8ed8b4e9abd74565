"""`python -m studies.identification`: the proof (`proof.py`)."""

from studies.identification.proof import main

if __name__ == "__main__":
    main()
