"""Mutants of the kernels: whether a test notices that a comparison or a bound is another."""
