"""The programs `slide-plan`, `slide-run` and `slide-info`."""
