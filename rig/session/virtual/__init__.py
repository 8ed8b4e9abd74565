"""The virtual bench: real drivers and real bytes, with virtual devices and the fingertip behind them."""
