"""Bearing stiffness that changes while the machine runs: followed sample by sample."""
