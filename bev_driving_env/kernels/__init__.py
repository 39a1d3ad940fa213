"""Compiled (numba) kernels of the world: pure functions over flat arrays, batched over worlds."""
