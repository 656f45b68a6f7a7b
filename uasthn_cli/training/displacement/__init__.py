"""Training of the networks that regress corner displacements: dhn, ihn and sthn."""
