"""The panel: a server on loopback that shows a run or the bench to a page, and passes on what that page asks for."""
