"""Pressures within a few contacts, 0 outside: what is known of them beforehand, and which of them explain readings.

- `contact`: one contact and its prior. `seen`: readings made linear and white, and the evidence of contacts.
- `climb`: the likeliest contacts. `mixture`: pressures averaged over them, with bands.
- `imagined`: pressures drawn from what contacts are like. `table`: their SED, weighed by how it explains readings.
- `smooth_fit`: where it begins, and the answer for few pressures. `felt_shape`: class and size of what pressed.
"""
