"""Kernels on vertices and faces, the only code that calls mesh libraries.

Kernels trust their input: estimators check it once before.
"""
