import runtime.interrupt  # noqa: F401 (Ctrl-C is answered by it, also while the rest is imported)
