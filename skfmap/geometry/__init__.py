"""Kernels on vertices and faces; no other code calls mesh libraries.

Kernels trust their input, which estimators have checked.
"""
