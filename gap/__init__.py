"""Diagnosis of the gap between a measured rotor and its model: where, which effect, how far it shrinks."""
