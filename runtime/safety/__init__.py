"""Limits that hold on every sample: stops, and the governor that keeps one at hand."""
