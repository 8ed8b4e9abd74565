"""Pages and figures of runs, comparisons and speed against error: HTML that fetches nothing, and PDF."""
