"""Pages and figures of runs, comparisons and benches: HTML that fetches nothing, and PDF."""
