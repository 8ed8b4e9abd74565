"""Published responses of afferents, as read from abstracts, figures and code; amplitudes are zero to peak."""

VIBRATION_50_HZ = {
    "SA1": ((52, 77, 112, 168, 251), (3, 6, 18, 30, 48)),
    "RA": ((16, 24, 35, 52, 77, 112, 168, 251), (3, 7, 23, 36, 57, 68, 89, 103)),
}
"""Amplitude (µm) and mean rate (impulses/s), of SA1 above the static rate; Muniak et al. (2007)."""

VIBRATION_300_HZ = (
    (0.1, 0.17, 0.27, 0.43, 0.69, 1.1, 1.8, 2.9, 4.6, 7.5, 12, 19, 49),
    (5, 18, 33, 62, 89, 112, 150, 170, 187, 238, 284, 303, 301),
)
"""The same of PC at 300 Hz."""

PC_THRESHOLDS = (
    (20, 30, 41, 61, 82, 100, 153, 250, 336, 422, 617, 822),
    (6.0, 2.2, 1.4, 0.58, 0.32, 0.18, 0.087, 0.052, 0.047, 0.054, 0.11, 0.19),
)
"""Frequency (Hz) and threshold (µm) of one PC; from a figure of a review whose source is not identified."""

FIELDS_MM2 = {"SA1": (5.1, 6.0, 7.1, 8.0, 8.8), "RA": (5.5, 8.1, 13.0, 18.0, 22.4)}
"""Areas of receptive fields at `PIN_UM`; Vega-Bermudez and Johnson (1999)."""

PIN_UM = (50, 100, 200, 350, 500)
"""Depths of one pin beyond the array (µm)."""

RA_THRESHOLDS = {"amplitude_mm": (0.05, 1.65), "speed_mm_s": (0.4, 39.3)}
"""Extreme thresholds of 39 RA units; Knibestöl (1973)."""
PC_RAMP_THRESHOLDS = {"amplitude_mm": (0.0, 1.95), "speed_mm_s": (0.5, 19.6)}
"""The same of 10 PC units; the smallest amplitude was below 0.05 mm."""
