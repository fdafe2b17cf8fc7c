"""The intervals that all estimates give."""

# Half a 90 % interval, in standard errors.
Z90 = 1.6449

# By what two codes with fine meshes make of the same rig, ln k_b differs by so much, whatever else is known exactly.
BETWEEN_CODES = 1.2e-4
