"""Panel: a server on loopback that shows a run or the bench on a page, and forwards the page's requests."""
