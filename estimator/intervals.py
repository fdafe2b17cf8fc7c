"""The intervals that all estimates give."""

# Half a 90 % interval, in standard errors.
Z90 = 1.6449
