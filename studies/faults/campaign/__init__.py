"""The fault campaign: every byte of every distinct message, and mechanical with sensor faults, in each phase.

`python -m studies.faults.campaign --help`; docs/validation/faults.md explains the result.
"""
