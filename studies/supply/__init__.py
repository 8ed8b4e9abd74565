"""Supply chain: locked versions, wheels of other systems, licenses, vendored files, and the bill of materials."""
